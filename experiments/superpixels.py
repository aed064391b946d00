"""Compare superpixel methods: number of superpixels, cost, and the quality of the best partition they allow.

    python experiments/superpixels.py dataset=mosd dataset.root=FOLDER [frames=20] \
        methods='{fast: "superpixels=slic_fast superpixels.n_segments=512", planes: superpixels=plane_slic}'

`methods` maps names to overrides of the configuration; all other arguments are overrides for all methods. All methods
take turns on every frame, in one thread. The cost is the processor time relative to the first method, as the median
over frames. Scores are means over frames, in per cent.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
import pandas as pd
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from omegaconf import OmegaConf

from sgbd.frame import Frame
from sgbd.jobs.configuration import config_folder
from sgbd.metrics import ContingencyTable, match_objects, oracle_segments, overlap_scores
from sgbd.metrics.boundary import boundary_scores
from sgbd.metrics.superpixel import achievable_segmentation_accuracy, boundary_recall, undersegmentation_error
from sgbd.superpixels import Superpixels

METHODS = {
    "slic_fast, n=128": "superpixels=slic_fast superpixels.n_segments=128",
    "slic_fast, n=512": "superpixels=slic_fast superpixels.n_segments=512",
    "slic_fast, n=1024": "superpixels=slic_fast superpixels.n_segments=1024",
    "slic_sensor, n=512": "superpixels=slic_sensor superpixels.n_segments=512",
    "plane_slic, at most 150": "superpixels=plane_slic superpixels.n_segments=150",
    "plane_slic, at most 300": "superpixels=plane_slic superpixels.n_segments=300",
    "plane_slic": "superpixels=plane_slic",
}


def scores(superpixels: Superpixels, frame: Frame) -> dict[str, float]:
    """Over-segment a frame and score the result.

    Args:
        superpixels: The method.
        frame: A frame with ground truth.

    Returns:
        A row of the table; `seconds` is processor time.
    """
    assert frame.instances is not None
    start = time.process_time()
    label_map = superpixels(frame)
    seconds = time.process_time() - start
    table = ContingencyTable.from_label_maps(label_map, frame.instances)
    overlap, instance = np.nonzero(table.counts)
    segments = oracle_segments(
        table.segments[overlap],
        table.instances[instance],
        table.counts[overlap, instance],
        int(label_map.max()) + 1,
    )
    partition = segments[label_map]
    best = ContingencyTable.from_label_maps(partition, frame.instances)
    matching = match_objects(best)
    found = overlap_scores(best, matching)
    return {
        "superpixels": label_map.max() + 1,
        "seconds": seconds,
        "oracle F": 100 * found.f_measure,
        "oracle F@.75": 100 * found.detected_share,
        "oracle boundary F": 100 * boundary_scores(partition, frame.instances, matching).f_measure,
        "boundary recall": 100 * boundary_recall(label_map, frame.instances),
        "undersegm. error": 100 * undersegmentation_error(table),
        "achievable acc.": 100 * achievable_segmentation_accuracy(table),
    }


def composed(overrides: list[str]) -> Any:
    """Compose the configuration of sgbd.prepare with overrides."""
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        return compose("prepare", overrides)


def in_one_thread(overrides: list[str]) -> Superpixels:
    """Create the configured superpixels, limited to one thread if they are multi-threaded."""
    superpixels: Superpixels = instantiate(composed(overrides).superpixels)
    if hasattr(superpixels, "threads"):
        superpixels.threads = 1
    return superpixels


def main() -> None:
    """Print the table."""
    options = {"frames": "0", "methods": ""}
    overrides = []
    for argument in sys.argv[1:]:
        key, _, value = argument.partition("=")
        if key in options:
            options[key] = value
        else:
            overrides.append(argument)
    methods = OmegaConf.to_container(OmegaConf.create(options["methods"])) if options["methods"] else METHODS
    assert isinstance(methods, dict)
    config = composed(overrides)
    source = instantiate(config.dataset, split="test")
    count = min(int(options["frames"]) or len(source), len(source))
    chosen = np.linspace(0, len(source) - 1, count).round().astype(int)
    made = {str(name): in_one_thread([*overrides, *str(given).split()]) for name, given in methods.items()}
    rows = []
    for place, index in enumerate(chosen):
        frame = source[int(index)]
        for name, superpixels in made.items():
            if place == 0:
                superpixels(frame)
            rows.append({"method": name, "frame": frame.name, **scores(superpixels, frame)})
    table = pd.DataFrame(rows)
    seconds = table.pivot(index="frame", columns="method", values="seconds")
    means = table.drop(columns=["frame", "seconds"]).groupby("method", sort=False).mean()
    means.insert(1, "cost", seconds.div(seconds[next(iter(made))], axis=0).median())
    print(f"{count} frames\n")
    print(means.to_markdown(floatfmt=("", ".0f", ".2f", *[".1f"] * 5, ".2f", ".2f")))


if __name__ == "__main__":
    main()
