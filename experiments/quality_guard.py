"""Compare the compiled SLIC with the published superpixels: score the same weights on the superpixels of both.

    python experiments/quality_guard.py checkpoint=FILE dataset=tabletop
    python experiments/quality_guard.py checkpoint=FILE dataset=mosd dataset.root=FOLDER

`checkpoint` is a model trained with the compiled SLIC (`superpixels=slic_fast`). The frames are over-segmented by the
compiled SLIC and by that of scikit-image, with the same settings; graph, features, weights and partition are the same.
All other arguments are overrides of conf/evaluate.yaml. The exit status is 1 if the compiled SLIC scores worse than
scikit-image's by more than `tolerance` points (default 0.3).
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import pandas as pd
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from sgbd.checkpoint import Checkpoint, find_checkpoint
from sgbd.evaluation import Evaluator
from sgbd.jobs.configuration import config_folder, count_workers
from sgbd.jobs.pipeline import checkpoint_graphs, frame_source_of_split
from sgbd.recipe import describe
from sgbd.segmenter import Segmenter

REFERENCE, FAST = "slic_reference", "slic_fast"
"""Options of the group superpixels: scikit-image's SLIC and the compiled one."""

SCORES = {
    "overlap F": "all/overlap_f",
    "F@.75": "all/f75",
    "boundary F": "all/boundary_f",
    "unaided overlap F": "unaided/overlap_f",
    "unaided boundary F": "unaided/boundary_f",
    "oracle overlap F": "oracle/overlap_f",
    "oracle boundary F": "oracle/boundary_f",
}
GUARDED = ("overlap F", "boundary F", "unaided overlap F", "unaided boundary F")


def with_superpixels(checkpoint: Checkpoint, option: Any) -> Checkpoint:
    """Return the checkpoint with different superpixels.

    Args:
        checkpoint: The trained model.
        option: Configuration of the superpixels; options that the model's superpixels also have keep their values.
    """
    own = checkpoint.recipe["superpixels"]
    kept = {key: value for key, value in own.items() if key in option and key != "_target_"}
    # `describe` normalises the class name to the form used in recipes.
    superpixels = describe(instantiate({**option, **kept}))
    return replace(checkpoint, recipe={**checkpoint.recipe, "superpixels": superpixels})


def evaluated(config: DictConfig, checkpoint: Checkpoint) -> dict[str, float]:
    """Prepare the frames and return the scores of the model on them, in per cent."""
    segmenter = Segmenter(checkpoint)
    source = frame_source_of_split(config.dataset, count_workers(config.workers), config.split)
    dataset = checkpoint_graphs(config, checkpoint, segmenter, source)
    evaluator = Evaluator(segmenter.partition, segmenter.rule, calibration=segmenter.calibration)
    scores = evaluator(dataset, segmenter.model, segmenter.objectness, progress=True).scores
    found = {name: 100 * scores[key] for name, key in SCORES.items() if key in scores}
    return {"frames": len(dataset), "superpixels": dataset.statistics()["nodes_per_graph"], **found}


def main() -> None:
    """Print the table and exit with status 1 if scores are worse than the tolerance allows."""
    arguments = dict(argument.split("=", 1) for argument in sys.argv[1:])
    tolerance = float(arguments.pop("tolerance", 0.3))
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("evaluate", [f"{key}={value}" for key, value in arguments.items()])
        options = {
            name: OmegaConf.to_container(compose("prepare", [f"superpixels={name}"]).superpixels)
            for name in (REFERENCE, FAST)
        }
    checkpoint = Checkpoint.load(find_checkpoint(config.checkpoint, config.output_dir), tuple(config.trust))
    table = pd.DataFrame(
        {name: evaluated(config, with_superpixels(checkpoint, option)) for name, option in options.items()}
    ).T
    table.loc["difference"] = table.loc[FAST] - table.loc[REFERENCE]
    table.loc["difference", "frames"] = float("nan")
    table.index.name = "superpixels="
    print(table.to_markdown(floatfmt=("", ".0f", ".0f", *[".1f"] * len(SCORES)), missingval=""))
    worse = {name: table.loc["difference", name] for name in GUARDED if name in table}
    worse = {name: change for name, change in worse.items() if change < -tolerance}
    if worse:
        sys.exit(f"the fast way is worse by more than {tolerance} points: {worse}")
    print(f"\nThe fast way is no more than {tolerance} points worse, or better.")


if __name__ == "__main__":
    main()
