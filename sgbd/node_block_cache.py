"""Cached node blocks beside prepared graphs: added without preparing the graphs again, resumable, never stale.

Layout, in the folder of the graphs' recipe (see `sgbd.preparation`)::

    <dataset>-<hash>/node_blocks/<group>-<hash of the block's recipe>/recipe.json
                                                                     /<split>.lock
                                                                     /<split>/<name>.safetensors   x [N, M] of a frame
                                                                     /<split>/index.json           written last

A different block, different weights or different code have a different hash. Each file stores the fingerprint of its
frame, and the index stores the fingerprint of all frames of the split. If frames change and their graphs are rebuilt,
their blocks are rebuilt too. The superpixels are those of the graphs.
"""

from __future__ import annotations

import contextlib
import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch_geometric.data import Data

from sgbd.graph_file import (
    FORMAT_VERSION,
    SUFFIX,
    GraphFileError,
    GraphSummary,
    cannot_write,
    read_graph,
    read_summary,
    write_graph,
)
from sgbd.label_map import unpack
from sgbd.machine.atomic_file import write_whole
from sgbd.machine.one_process_at_a_time import one_process_at_a_time
from sgbd.machine.progress_bar import ProgressBar
from sgbd.node_block import NodeBlock
from sgbd.preparation import INDEX_FILE, RECIPE_FILE, PreparationError, frame_fingerprint, graph_file_name, read_index
from sgbd.recipe import recipe_hash
from sgbd.sources.source import FrameSource

log = logging.getLogger(__name__)

BLOCKS_FOLDER = "node_blocks"
LABEL_MAP_FIELDS = ("label_map", "image_size")
AT_ONCE = 8
"""Number of frames that are read, computed and written together."""


def prepare_node_block(folder: Path, source: FrameSource, block: NodeBlock, *, progress: bool = True) -> Path:
    """Compute a node block for those prepared graphs of a split that lack it.

    After an interruption, the next run continues. Two processes may do this at the same time.

    Args:
        folder: The recipe folder that `sgbd.preparation.prepare` returned for this source.
        source: The frames of the split.
        block: The block to compute.
        progress: Whether to show a progress bar.

    Returns:
        The block's folder, below `folder`.

    Raises:
        PreparationError: If the split is not prepared, or its frames have changed since.
        GraphFileError: If a file cannot be written, for example because the disk is full.
        sgbd.node_block.MissingWeightsError: If the block's weights are missing.
    """
    graphs = read_index(folder / source.split)
    if graphs is None or graphs["fingerprint"] != source.fingerprint():
        raise PreparationError(
            f"the graphs of {source.split} in {folder} are not prepared, or of other frames: prepare them first "
            "(python -m sgbd.prepare), then the block"
        )
    recipe = _block_recipe(block)
    target = folder / BLOCKS_FOLDER / node_block_folder(block)
    split = target / source.split
    if is_complete(split, graphs):
        return target
    try:
        split.mkdir(parents=True, exist_ok=True)
        with one_process_at_a_time(target / f"{source.split}.lock", log, f"computes {split}"):
            if not is_complete(split, graphs):
                _compute(folder, split, graphs, source, block, progress)
                write_whole(target / RECIPE_FILE, (json.dumps(recipe, indent=2) + "\n").encode())
                write_whole(split / INDEX_FILE, json.dumps(_index(graphs)).encode())
    except OSError as error:
        raise PreparationError(cannot_write(split, error)) from error
    return target


def node_block_folder(block: NodeBlock) -> str:
    """Return the name of a block's folder: its group and ten digits of its recipe's hash."""
    return f"{block.group}-{recipe_hash(_block_recipe(block))[:10]}"


def find_node_block(folder: Path, group: str, name: str | None = None) -> Path | None:
    """Find the folder of a node block beside the graphs in `folder`.

    Args:
        folder: Recipe folder of the graphs.
        group: The block's group.
        name: The block's folder name; None if the group has only one block.

    Returns:
        The folder, or None if there is no such block.

    Raises:
        PreparationError: If there are several and no name is given.
    """
    if name is not None:
        found = [folder / BLOCKS_FOLDER / name] if (folder / BLOCKS_FOLDER / name / RECIPE_FILE).is_file() else []
    else:
        found = sorted(path.parent for path in (folder / BLOCKS_FOLDER).glob(f"{group}-*/{RECIPE_FILE}"))
    if len(found) > 1:
        names = ", ".join(path.name for path in found)
        raise PreparationError(
            f"{folder} has several blocks of the group {group}: {names}. Give node_block=<one of them>."
        )
    return found[0] if found else None


def node_block_names(target: Path) -> tuple[str, ...]:
    """Return the names of a block's columns."""
    recipe: Mapping[str, Any] = json.loads((target / RECIPE_FILE).read_text(encoding="utf-8"))
    return tuple(recipe["names"])


def is_complete(split: Path, graphs: Mapping[str, Any]) -> bool:
    """Return whether a block's folder of a split is complete for the graphs with the index `graphs`."""
    try:
        index = json.loads((split / INDEX_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    if index != _index(graphs):
        return False
    present = {path.name for path in split.iterdir() if path.name.endswith(SUFFIX)}
    return {graph_file_name(name) for name in graphs["names"]} <= present


def read_node_block(target: Path, split: str, name: str) -> torch.Tensor:
    """Read the block's columns of one frame.

    Returns:
        float32 [N, M].

    Raises:
        GraphFileError: If the file is missing or damaged.
    """
    x: torch.Tensor = read_graph(target / split / graph_file_name(name)).x
    return x


def _block_recipe(block: NodeBlock) -> dict[str, Any]:
    return {"format_version": FORMAT_VERSION, "group": block.group, **block.cache_key()}


def _compute(
    folder: Path,
    split: Path,
    graphs: Mapping[str, Any],
    source: FrameSource,
    block: NodeBlock,
    progress: bool,
) -> None:
    for path in split.glob("*.tmp"):
        path.unlink()  # left by a process that was killed while writing
    place = {name: index for index, name in enumerate(source.names)}
    pending = [name for name in graphs["names"] if not _is_current(split, folder / source.split, name)]
    made = len(graphs["names"]) - len(pending)
    with ProgressBar(
        total=len(graphs["names"]),
        initial=made,
        desc=f"{block.group} of {source.split}",
        unit="frame",
        disable=not progress,
    ) as bar:
        for start in range(0, len(pending), AT_ONCE):
            names = pending[start : start + AT_ONCE]
            images, label_maps = [], []
            for name in names:
                images.append(source[place[name]].rgb)
                graph = read_graph(folder / source.split / graph_file_name(name), LABEL_MAP_FIELDS)
                # It shows the nodes, also if they are segments of a first stage.
                label_maps.append(unpack(graph.label_map, tuple(graph.image_size[0].tolist())))
            for name, x in zip(names, block(images, label_maps), strict=True):
                made_from = frame_fingerprint(source, place[name])
                write_graph(split / graph_file_name(name), Data(x=torch.from_numpy(x)), made_from)
            bar.update(len(names))


def _is_current(split: Path, graphs: Path, name: str) -> bool:
    """Return whether a frame's block exists, is readable, and was made from the same frame as the graph."""
    file = graph_file_name(name)
    if not (split / file).is_file():
        return False
    block: GraphSummary | None = None
    with contextlib.suppress(GraphFileError):  # a damaged block is computed again
        block = read_summary(split / file)
    graph = read_summary(graphs / file)
    return block is not None and (block.made_from, block.nodes) == (graph.made_from, graph.nodes)


def _index(graphs: Mapping[str, Any]) -> dict[str, Any]:
    return {"format_version": FORMAT_VERSION, "fingerprint": graphs["fingerprint"], "names": graphs["names"]}
