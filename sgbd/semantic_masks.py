"""python -m sgbd.semantic_masks: write the missing semantic masks of a dataset in TOD's layout."""

from __future__ import annotations

from omegaconf import DictConfig

from sgbd.jobs.configuration import ConfigurationError, count_workers, entry_point
from sgbd.jobs.pipeline import frame_source, splits_of
from sgbd.sources.semantic_masks import write_semantic_masks
from sgbd.sources.tod import Tod


@entry_point("semantic_masks")
def main(config: DictConfig) -> None:
    """Write the masks of the chosen splits and print a summary."""
    workers = count_workers(config.workers)
    for split in config.splits or splits_of(frame_source(config.dataset, workers)):
        source = frame_source(config.dataset, workers, split)
        if not isinstance(source, Tod):
            raise ConfigurationError(f"{type(source).__name__} is not in TOD's layout, the only one with such masks")
        done = write_semantic_masks(source, workers)
        print(f"{split}: " + ", ".join(f"{count} frames {state}" for state, count in sorted(done.frames.items())))
        if done.unknown:
            named = ", ".join(f"{count} {name}" for name, count in done.unknown.most_common())
            print(f"{split}: objects of none of the categories, 0 in the masks: {named}")


if __name__ == "__main__":
    main()
