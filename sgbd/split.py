"""python -m sgbd.split: split the categories and frames of a dataset in TOD's layout into seen and unseen."""

from __future__ import annotations

import shlex
from pathlib import Path

from omegaconf import DictConfig

from sgbd.jobs.configuration import ConfigurationError, count_workers, entry_point, output_folder
from sgbd.jobs.pipeline import frame_source
from sgbd.sources.categories import TOD_GROUPS
from sgbd.sources.split_report import write_split
from sgbd.sources.tod import Tod
from sgbd.sources.zero_shot_split import catalog, draw_seen, zero_shot_split


@entry_point("split")
def main(config: DictConfig) -> None:
    """Build the split, write its lists, its report and a dataset option, and print the report."""
    workers = count_workers(config.workers)
    source = frame_source(config.dataset, workers)
    if not isinstance(source, Tod):
        raise ConfigurationError(f"{type(source).__name__} is not in TOD's layout, the only one that can be split")
    groups = {group: tuple(names) for group, names in (config.groups or TOD_GROUPS).items()}
    members = [name for names in groups.values() for name in names]
    if sorted(members) != sorted(source.category_names):
        raise ConfigurationError(
            f"groups must hold each of the categories once: {', '.join(source.category_names)}; got {groups}"
        )
    frames = catalog(source, config.min_object_pixels, workers)
    split = zero_shot_split(
        frames,
        seen=frozenset(config.seen or draw_seen(groups, config.seed)),
        sizes={
            "train": config.train_frames,
            "val": config.val_frames,
            "test_closed": config.test_closed_frames,
            "test_open": config.test_open_frames,
        },
        shares=dict(config.scene_shares),
        min_objects=config.min_objects,
        seed=config.seed,
    )
    folder = output_folder() if config.output is None else Path(config.output).expanduser()
    report = write_split(folder, source, frames, split, groups, config.name)
    print(f"\n{report}\nLists, report and dataset option: {folder}\nTo use it:\n")
    print(shlex.join(["python", "-m", "sgbd.train", "--config-dir", str(folder), f"dataset={config.name}"]))


if __name__ == "__main__":
    main()
