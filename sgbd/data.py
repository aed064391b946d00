"""The PyG dataset of prepared superpixel graphs."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from torch_geometric.data import Data, Dataset

from sgbd.features import EDGE_GROUPS, EDGE_NAMES, NODE_GROUPS, NODE_NAMES, edge_columns, node_columns
from sgbd.graph_file import FORMAT_VERSION, read_graph, stored_fields
from sgbd.node_block import split_groups
from sgbd.node_block_cache import find_node_block, is_complete, node_block_names, read_node_block
from sgbd.own_columns import with_own_columns
from sgbd.preparation import INDEX_FILE, RECIPE_FILE, graph_file_name, read_index
from sgbd.recipe import Recipe

HOW_TO_PREPARE = "python -m sgbd.prepare dataset=<name>"


class GraphCacheError(RuntimeError):
    """Raised if a folder does not contain the requested prepared graphs; the message says what to do."""


class SuperpixelGraphDataset(Dataset):
    """The prepared graphs of one split, as a PyG dataset.

    ``dataset[i]`` is a plain `torch_geometric.data.Data` as described in `sgbd.graph.build_graph`, with the selected
    feature columns. Slices, index lists, masks and ``shuffle()`` give sub-datasets. PyG's `DataLoader` makes batches.

    Args:
        root: Recipe folder (as returned by `sgbd.preparation.prepare`), or a folder that contains only one of these.
        split: Name of the split.
        node_features: Groups of `sgbd.features.NODE_GROUPS` to keep as columns of `x`; None for all. The columns keep
            their declared order. The group of a node block that was added to the graphs (`sgbd.node_block_cache`), such
            as `dino`, appends its columns.
        edge_features: Groups of `sgbd.features.EDGE_GROUPS` to keep as columns of `edge_attr`; None for all.
        in_memory: Keep every graph in memory after it was first read. Sub-datasets share these graphs. Worker processes
            of a `DataLoader` would keep copies of their own, so do not combine them with this option.
        fields: Fields of the graphs to read; None for all. Training needs no label maps or overlap tables, and reads
            faster without them.
        transform: Applied to each graph on access.
        node_block: Folder name of the node block to append, if its group has several.

    Raises:
        GraphCacheError: If there are no such graphs; the message says how to prepare them.
        ValueError: If a feature group is unknown; the message lists the choices.
    """

    def __init__(
        self,
        root: str | Path,
        split: str = "train",
        node_features: Collection[str] | None = None,
        edge_features: Collection[str] | None = None,
        in_memory: bool = False,
        fields: Collection[str] | None = None,
        transform: Callable[[Data], Data] | None = None,
        node_block: str | None = None,
    ) -> None:
        self.folder = find_recipe_folder(Path(root).expanduser())
        self.split = split
        self.recipe: Recipe = _read_recipe(self.folder)
        self._index = _read_split(self.folder, split)
        self.node_features = None if node_features is None else tuple(node_features)
        self.edge_features = None if edge_features is None else tuple(edge_features)
        self.fields = None if fields is None else tuple(fields)
        stored, others = split_groups(self.node_features)
        self._block = self._find_block(others, node_block)
        self._node_columns = node_columns(stored)
        self._edge_columns = edge_columns(self.edge_features)
        self.in_memory = in_memory
        self._graphs: dict[int, Data] = {}
        super().__init__(root=str(self.folder), transform=transform)

    def len(self) -> int:
        """Return the number of graphs of the whole split, also for a sub-dataset."""
        return len(self._index["names"])

    def get(self, idx: int) -> Data:
        """Read graph `idx` of the split."""
        if idx in self._graphs:
            # Return a shallow copy, so that a transform cannot change the graph in memory.
            return self._graphs[idx].__copy__()
        data = read_graph(self.folder / self.split / graph_file_name(self._index["names"][idx]), self.fields)
        if self.node_features is not None and "x" in data:
            data.x = data.x[:, with_own_columns(self._node_columns, len(NODE_NAMES), data.x.size(1))]
            if self._block is not None:
                block = read_node_block(self._block, self.split, self._index["names"][idx])
                data.x = torch.cat([data.x, block], dim=1)
        if self.edge_features is not None and "edge_attr" in data:
            columns = with_own_columns(self._edge_columns, len(EDGE_NAMES), data.edge_attr.size(1))
            data.edge_attr = data.edge_attr[:, columns]
        if self.in_memory:
            self._graphs[idx] = data
            return data.__copy__()
        return data

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the frames, in the order of the dataset."""
        return tuple(self._index["names"][index] for index in self.indices())

    @property
    def skipped(self) -> Mapping[str, str]:
        """Frames of the split without a graph, each with the reason."""
        return {entry["name"]: entry["reason"] for entry in self._index["skipped"]}

    @property
    def category_names(self) -> tuple[str, ...]:
        """All categories of the dataset; `instance_category` counts them from 1."""
        return tuple(self._index["category_names"])

    @property
    def seen(self) -> frozenset[str]:
        """The categories seen in training; empty if the dataset has no seen/unseen split of its categories."""
        return frozenset(self._index["seen"])

    @property
    def node_names(self) -> tuple[str, ...]:
        """Names of the columns of `x`: selected features, own columns of the graph builder, columns of a node block."""
        own = self.recipe.get("own_node_columns", ())
        block = () if self._block is None else node_block_names(self._block)
        return (*(NODE_NAMES[column] for column in self._node_columns), *own, *block)

    @property
    def edge_names(self) -> tuple[str, ...]:
        """Names of the columns of `edge_attr`: selected features, then own columns of the graph builder."""
        own = self.recipe.get("own_edge_columns", ())
        return (*(EDGE_NAMES[column] for column in self._edge_columns), *own)

    @property
    def node_channels(self) -> int:
        """Number of node features."""
        return len(self.node_names)

    @property
    def edge_channels(self) -> int:
        """Number of edge features."""
        return len(self.edge_names)

    def _find_block(self, groups: list[str], name: str | None) -> Path | None:
        if not groups:
            return None
        block = find_node_block(self.folder, groups[0], name) if len(groups) == 1 else None
        if block is None:
            raise ValueError(
                f"unknown node feature group {', '.join(groups)}; choose from {', '.join(NODE_GROUPS)}, or the group "
                f"of a block that was added to the graphs in {self.folder}. To add DINO's attention: "
                f"{HOW_TO_PREPARE} node_block=dino_vits16"
            )
        if not is_complete(block / self.split, self._index):
            raise GraphCacheError(
                f"the block {block} is not complete for {self.split}, or of other frames. Prepare it again: "
                f"{HOW_TO_PREPARE} node_block=<its option>"
            )
        return block

    def labeled(self) -> SuperpixelGraphDataset:
        """Return the sub-dataset of graphs with ground truth, reading only the header of each file."""
        folder, names = self.folder / self.split, self._index["names"]
        indices = list(self.indices())
        kept = [k for k, at in enumerate(indices) if "edge_label" in stored_fields(folder / graph_file_name(names[at]))]
        return self if len(kept) == len(indices) else self.index_select(kept)

    def statistics(self) -> dict[str, Any]:
        """Return the statistics that the preparation recorded for the whole split.

        Returns:
            `graphs`, their number; the means `nodes_per_graph`, `edges_per_graph` (each adjacency once) and
            `bytes_per_graph`; `merge_share`, the fraction of labelled edges that are merges (None without labels);
            `seconds_per_frame` of each stage of the last preparation.
        """
        return dict(self._index["statistics"])

    def __copy__(self) -> SuperpixelGraphDataset:
        # PyG makes sub-datasets with this: they share the graphs in memory.
        copied = type(self).__new__(type(self))
        copied.__dict__.update(self.__dict__)
        return copied

    def __getstate__(self) -> dict[str, Any]:
        # A process that receives this dataset reads the graphs again, which is cheaper than pickling them.
        return {**self.__dict__, "_graphs": {}}


def find_recipe_folder(root: Path) -> Path:
    """Return `root` if it is a recipe folder, else the only recipe folder in it.

    Raises:
        GraphCacheError: If `root` is missing, or contains no recipe folder or several.
    """
    if not root.is_dir():
        raise GraphCacheError(f"there are no prepared graphs in {root}: no such folder. Make them: {HOW_TO_PREPARE}")
    if (root / RECIPE_FILE).is_file():
        return root
    recipes = sorted(path.parent for path in root.glob(f"*/{RECIPE_FILE}"))
    if not recipes:
        raise GraphCacheError(
            f"there are no prepared graphs in {root}: neither it nor a folder in it holds {RECIPE_FILE}. "
            f"Make them: {HOW_TO_PREPARE}"
        )
    if len(recipes) > 1:
        lines = "\n".join(f"  {path}  (prepared: {', '.join(_finished_splits(path)) or 'nothing'})" for path in recipes)
        raise GraphCacheError(f"{root} holds graphs of several recipes; give the folder of one:\n{lines}")
    return recipes[0]


def _read_recipe(folder: Path) -> Recipe:
    path = folder / RECIPE_FILE
    try:
        recipe = json.loads(path.read_text(encoding="utf-8"))
        version, groups = recipe["format_version"], (recipe.get("node_groups"), recipe.get("edge_groups"))
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise GraphCacheError(f"{path} is not the recipe of prepared graphs ({error}): {HOW_TO_PREPARE}") from error
    if version != FORMAT_VERSION:
        raise GraphCacheError(
            f"the graphs in {folder} have format version {version}; this version of sgbd reads {FORMAT_VERSION}. "
            f"Prepare them again: {HOW_TO_PREPARE}"
        )
    if groups != tuple({group: list(names) for group, names in table.items()} for table in (NODE_GROUPS, EDGE_GROUPS)):
        raise GraphCacheError(
            f"the graphs in {folder} have other feature columns than this version of sgbd. "
            f"Prepare them again: {HOW_TO_PREPARE}"
        )
    return dict(recipe)


def _read_split(folder: Path, split: str) -> dict[str, Any]:
    index = read_index(folder / split)
    if index is not None:
        return index
    finished = ", ".join(_finished_splits(folder)) or "none"
    if (folder / split).is_dir():
        raise GraphCacheError(
            f"the preparation of split {split!r} in {folder} is not finished (it has no readable {INDEX_FILE}); "
            f"finished splits: {finished}. Run it again, it goes on where it stopped: {HOW_TO_PREPARE}"
        )
    raise GraphCacheError(
        f"{folder} has no split {split!r}; prepared splits: {finished}. If the dataset has it: {HOW_TO_PREPARE}"
    )


def _finished_splits(folder: Path) -> Iterator[str]:
    return (path.parent.name for path in sorted(folder.glob(f"*/{INDEX_FILE}")))
