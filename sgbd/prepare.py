"""python -m sgbd.prepare: make the superpixel graphs of a dataset, once, and say where they are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig

from sgbd.configuration import count_workers, entry_point
from sgbd.preparation import prepare
from sgbd.sources import FrameSource


def frame_source(dataset: DictConfig, workers: int, split: str | None = None) -> FrameSource:
    """Open a split of the configured dataset; an embedded dataset that is not on disk yet is generated first.

    Args:
        dataset: What to instantiate.
        workers: Processes for generating.
        split: Which split; None for the dataset's own default.

    Returns:
        The frames.
    """
    options: dict[str, Any] = {} if split is None else {"split": split}
    source: FrameSource = instantiate(dataset, **options)
    generate = getattr(source, "generate", None)
    if generate is not None:
        generate(workers=max(workers, 1))
    return source


def prepare_splits(config: DictConfig, splits: Sequence[str]) -> Path:
    """Prepare the graphs of some splits as configured, or find them prepared.

    Args:
        config: A configuration with the keys of conf/prepare.yaml.
        splits: Their names.

    Returns:
        The folder of the recipe, which holds a folder for each split.
    """
    workers = count_workers(config.workers)
    superpixels, graph = instantiate(config.superpixels), instantiate(config.graph)
    folders = [
        prepare(
            frame_source(config.dataset, workers, split),
            superpixels,
            graph,
            config.cache_dir,
            workers=workers,
            on_error=config.on_error,
        )
        for split in splits
    ]
    # All splits of a dataset have one recipe, and so one folder.
    return folders[-1]


@entry_point("prepare")
def main(config: DictConfig) -> None:
    """Prepare the splits of a dataset and print how to load them."""
    workers = count_workers(config.workers)
    source = frame_source(config.dataset, workers)
    # Without any split the source says what it misses when its own is read.
    splits = config.splits or source.splits or (source.split,)
    folder = prepare_splits(config, splits)
    print(f"\nPrepared {', '.join(splits)} in {folder}. To load them:\n")
    print("from sgbd.data import SuperpixelGraphDataset")
    print(f'graphs = SuperpixelGraphDataset("{folder}", split="{splits[0]}")')


if __name__ == "__main__":
    main()
