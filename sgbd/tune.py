"""python -m sgbd.tune: tune the thresholds of a trained model and calibrate its scores on validation frames."""

from __future__ import annotations

from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from sgbd.checkpoint import CHECKPOINT_FILE, Checkpoint, find_checkpoint
from sgbd.jobs.configuration import ConfigurationError, count_workers, entry_point, output_folder
from sgbd.jobs.pipeline import checkpoint_graphs, frame_source_of_split
from sgbd.machine.atomic_file import write_whole
from sgbd.reporting.score_titles import score_title
from sgbd.segmenter import Segmenter
from sgbd.tuning import TUNING_FILE


@entry_point("tune")
def main(config: DictConfig) -> None:
    """Prepare validation frames with the checkpoint's recipe, tune on them, and write a new checkpoint."""
    if config.tuning is None:
        raise ConfigurationError("there is nothing to try with tuning=none; use tuning=validation")
    tuning = instantiate(config.tuning)
    path = find_checkpoint(config.checkpoint, config.output_dir)
    out = output_folder()
    target = out if config.output is None else Path(config.output).expanduser()
    if target.is_dir():
        target = target / CHECKPOINT_FILE
    if target.resolve() == path.resolve():
        raise ConfigurationError(f"output={config.output} is the checkpoint that is to be tuned; name another file")
    trust = tuple(config.trust)
    checkpoint = Checkpoint.load(path, trust)
    segmenter = Segmenter(checkpoint, node_block=instantiate(config.node_block), trust=trust)
    source = frame_source_of_split(config.dataset, count_workers(config.workers), config.split)
    graphs = checkpoint_graphs(config, checkpoint, segmenter, source)
    start = {
        section: checkpoint.recipe[section]
        if config[section] is None
        else OmegaConf.to_container(config[section], resolve=True)
        for section in ("partition", "objects")
    }
    tuned = tuning(graphs, checkpoint.model, checkpoint.objectness, start["partition"], start["objects"], trust)
    checkpoint.recipe |= tuned.sections
    write_whole(out / TUNING_FILE, tuned.table.to_csv(index=False).encode())
    OmegaConf.save(config, out / "config.yaml")
    checkpoint.save(target)
    before, after = (100 * tuned.summary[when] for when in ("before", "after"))
    scores = ", ".join(map(score_title, tuned.summary["scores"]))
    frames = f"{len(graphs)} frame{'s'[: len(graphs) != 1]} of {source.split}"
    print(f"\n{path} on {frames}: mean of {scores} {before:.1f} % before, {after:.1f} % now")
    print(f"Scores are {'calibrated' if tuned.calibration else 'not calibrated'}. Tuned checkpoint: {target}")


if __name__ == "__main__":
    main()
