"""The configured frames and their prepared graphs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from sgbd.data import SuperpixelGraphDataset
from sgbd.evaluation import with_truth
from sgbd.jobs.configuration import ConfigurationError, count_workers
from sgbd.jobs.own_classes import require_kind
from sgbd.jobs.untrained import configured_graph
from sgbd.node_block import NodeBlock
from sgbd.node_block_cache import node_block_folder, prepare_node_block
from sgbd.preparation import prepare
from sgbd.recipe import graph_recipe
from sgbd.sources import FrameSource

if TYPE_CHECKING:
    from sgbd.checkpoint import Checkpoint
    from sgbd.segmenter import Segmenter


def frame_source(dataset: DictConfig, workers: int, split: str | None = None) -> FrameSource:
    """Open a split of the configured dataset; a synthetic dataset that is not on disk yet is generated first.

    Args:
        dataset: Configuration of the dataset.
        workers: Number of processes that generate frames; 0 generates in this process.
        split: Name of the split; None for the dataset's default.

    Returns:
        The frames.

    Raises:
        ConfigurationError: If the dataset is not a `FrameSource`, or a required value is missing.
    """
    for key in sorted(OmegaConf.missing_keys(dataset)):
        # Hydra silently drops missing keys of a dataset that is nested in another one.
        raise ConfigurationError(f"{key} is not set. Give it on the command line: {key}=<value>")
    options: dict[str, Any] = {} if split is None else {"split": split}
    source: FrameSource = instantiate(dataset, **options)
    require_kind(source, FrameSource, "dataset")
    generate = getattr(source, "generate", None)
    if generate is not None:
        generate(workers=workers)
    return source


def splits_of(source: FrameSource) -> tuple[str, ...]:
    """Return the splits of a dataset; if it has none, its current one, whose reading then reports what is missing."""
    return source.splits or (source.split,)


def frame_source_of_split(dataset: DictConfig, workers: int, split: str) -> FrameSource:
    """Open one split of the configured dataset, as `frame_source` does.

    Raises:
        ConfigurationError: If the dataset has no such split.
    """
    source = frame_source(dataset, workers, split)
    splits = splits_of(source)
    if split not in splits:
        raise ConfigurationError(f"the dataset has no split {split!r}; choose from {', '.join(splits)}")
    return source


def prepare_splits(config: DictConfig, splits: Sequence[str], block: NodeBlock | None = None) -> Path:
    """Prepare the graphs of some splits as configured, unless they are already prepared.

    Args:
        config: A configuration with the keys of conf/prepare.yaml.
        splits: Names of the splits.
        block: Node block to add to the graphs.

    Returns:
        The recipe folder, which contains a folder for each split.

    Raises:
        ConfigurationError: If the splits have different recipes, because a dataset's options depend on its split.
    """
    workers = count_workers(config.workers)
    superpixels, graph = instantiate(config.superpixels), configured_graph(config)
    sources = [frame_source(config.dataset, workers, split) for split in splits]
    _check_same_recipe(sources, superpixels, graph)
    for source in sources:
        folder = prepare(source, superpixels, graph, config.cache_dir, workers=workers, on_error=config.on_error)
        if block is not None:
            prepare_node_block(folder, source, block)
    return folder


def _check_same_recipe(sources: Sequence[FrameSource], superpixels: object, graph: object) -> None:
    """Reject splits that would be prepared in different folders, in which the training would not find them."""
    recipes = [graph_recipe(source, superpixels, graph)["dataset"] for source in sources]
    for source, recipe in zip(sources, recipes, strict=True):
        different = [key for key in recipe if recipe[key] != recipes[0][key]]
        if different:
            changes = "; ".join(f"{key} is {recipes[0][key]} and {recipe[key]}" for key in different)
            raise ConfigurationError(
                f"{type(source).__name__} must read all splits in the same way, but from {sources[0].split} to "
                f"{source.split} its {changes}. In a dataset class of your own, root, options(), category_names and "
                "seen must not depend on the split; with labels=auto, state the meaning of the labels instead."
            )


def open_graphs(
    folder: Path, split: str, features: Mapping[str, Any], block: NodeBlock | None, **options: Any
) -> SuperpixelGraphDataset:
    """Open prepared graphs with selected feature columns.

    Args:
        folder: The recipe folder.
        split: Name of the split.
        features: Feature groups under the keys `node` and `edge`, as in a configuration or a checkpoint's recipe.
        block: The node block that provides additional columns; None if no feature group needs it.
        **options: Further arguments of `sgbd.data.SuperpixelGraphDataset`.

    Returns:
        The graphs.
    """
    name = None if block is None else node_block_folder(block)
    return SuperpixelGraphDataset(folder, split, features["node"], features["edge"], node_block=name, **options)


def graphs_for(
    segmenter: Segmenter, source: FrameSource, cache_dir: str | Path, workers: int, on_error: Literal["skip", "fail"]
) -> SuperpixelGraphDataset:
    """Prepare a dataset's graphs with a trained model's recipe, unless they are already prepared.

    Args:
        segmenter: The model.
        source: The frames.
        cache_dir: Folder of prepared graphs.
        workers: Number of worker processes.
        on_error: What to do if a frame cannot be used: `skip` or `fail`.

    Returns:
        The graphs, with the feature columns that the model was trained on.
    """
    folder = prepare(source, segmenter.superpixels, segmenter.graph, cache_dir, workers=workers, on_error=on_error)
    if segmenter.node_block is not None:
        prepare_node_block(folder, source, segmenter.node_block)
    return open_graphs(folder, source.split, segmenter.recipe["features"], segmenter.node_block)


def checkpoint_graphs(
    config: DictConfig, checkpoint: Checkpoint, segmenter: Segmenter, source: FrameSource
) -> SuperpixelGraphDataset:
    """Prepare graphs with a checkpoint's recipe, unless they are already prepared; return those with ground truth.

    Args:
        config: A configuration with cache_dir, workers and on_error.
        checkpoint: The checkpoint.
        segmenter: The segmenter made from it.
        source: The frames.

    Returns:
        The graphs with ground truth and the feature columns of the checkpoint's model.
    """
    prepared = graphs_for(segmenter, source, config.cache_dir, count_workers(config.workers), config.on_error)
    dataset = with_truth(prepared, config.on_error)
    # Holds by construction; a difference would mean that the graphs differ from those that the model was trained on.
    checkpoint.require(superpixels=dataset.recipe["superpixels"], graph=dataset.recipe["graph"])
    return dataset
