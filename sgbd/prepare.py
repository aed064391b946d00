"""python -m sgbd.prepare: build and cache the superpixel graphs of a dataset, and print their folder."""

from __future__ import annotations

from hydra.utils import instantiate
from omegaconf import DictConfig

from sgbd.jobs.configuration import count_workers, entry_point
from sgbd.jobs.pipeline import frame_source, prepare_splits, splits_of


@entry_point("prepare")
def main(config: DictConfig) -> None:
    """Prepare the splits of a dataset and print how to load them."""
    workers = count_workers(config.workers)
    source = frame_source(config.dataset, workers)
    splits = config.splits or splits_of(source)
    block = None if config.node_block is None else instantiate(config.node_block)
    folder = prepare_splits(config, splits, block)
    print(f"\nPrepared {', '.join(splits)} in {folder}. To load them:\n")
    print("from sgbd.data import SuperpixelGraphDataset")
    chosen = "" if block is None else f', node_features=["rgb", "position", "depth", "normal", "{block.group}"]'
    print(f'graphs = SuperpixelGraphDataset("{folder}", split="{splits[0]}"{chosen})')


if __name__ == "__main__":
    main()
