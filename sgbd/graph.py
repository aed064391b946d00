"""The superpixel graph of a frame as PyG `Data`, and its conversion to NetworkX."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from sgbd.adjacency import Adjacency, LabelMap, border_pairs
from sgbd.features import EDGE_NAMES, NODE_NAMES
from sgbd.frame import Frame
from sgbd.graph_arrays import CUT, MERGE, UNKNOWN, GraphArrays, graph_arrays, overlap_table
from sgbd.regions import Borders, Regions

if TYPE_CHECKING:  # imported in the functions that need them: importing PyG takes seconds and hundreds of MiB
    import networkx as nx
    from torch import Tensor
    from torch_geometric.data import Data

__all__ = [
    "CUT",
    "MERGE",
    "UNKNOWN",
    "GraphBuilder",
    "as_data",
    "build_graph",
    "edge_positions",
    "overlap_table",
    "to_networkx",
]


class GraphBuilder:
    """Builds the graph of one frame; see `build_graph`.

    Args:
        adjacency: Finds the pairs of adjacent superpixels: `sgbd.adjacency.border_pairs`,
            `sgbd.adjacency.bounding_box_pairs`, or any function with the same signature.
    """

    def __init__(self, adjacency: Adjacency = border_pairs) -> None:
        # A configuration gives the function as a partial without arguments. Unwrap it: `graph_arrays` recognises
        # `border_pairs` itself, whose pairs it already has from the pass over the borders.
        bare = isinstance(adjacency, functools.partial) and not (adjacency.args or adjacency.keywords)
        self.adjacency: Adjacency = adjacency.func if bare else adjacency  # type: ignore[attr-defined]

    def arrays(
        self,
        frame: Frame,
        label_map: LabelMap,
        category_names: Sequence[str] = (),
        *,
        store_maps: bool = True,
        sums: tuple[Regions, Borders] | None = None,
    ) -> GraphArrays:
        """Build the graph of a frame without PyTorch; see `sgbd.graph_arrays.graph_arrays`."""
        return graph_arrays(frame, label_map, self.adjacency, category_names, store_maps=store_maps, sums=sums)

    def __call__(
        self, frame: Frame, label_map: LabelMap, category_names: Sequence[str] = (), *, store_maps: bool = True
    ) -> Data:
        """Build the graph of a frame; see `build_graph`."""
        return build_graph(frame, label_map, self.adjacency, category_names, store_maps=store_maps)


def array_builder(graph: object) -> Callable[..., GraphArrays] | None:
    """Return the method that builds a frame's graph without PyG, or None if the builder has none.

    Args:
        graph: Graph builder. Builders of this package have a method `arrays`. A user's subclass may override only
            `__call__`, so its `arrays` is not returned.
    """
    if not type(graph).__module__.startswith("sgbd."):
        return None
    return getattr(graph, "arrays", None)


def build_graph(
    frame: Frame,
    label_map: LabelMap,
    adjacency: Adjacency = border_pairs,
    category_names: Sequence[str] = (),
    *,
    store_maps: bool = True,
) -> Data:
    """Build the superpixel graph of a frame with all features, and with labels if the frame has ground truth.

    Args:
        frame: The frame.
        label_map: int32 [H, W], ids 0..N-1, each present.
        adjacency: Finds the pairs of adjacent superpixels in a label map.
        category_names: All categories of the dataset. The category of each instance is stored as its 1-based position
            in this list.
        store_maps: Whether to pack the label map and the ground-truth instances into the graph, for evaluation and
            pictures.

    Returns:
        A plain `Data` with

        - x: float32 [N, F], node features, columns as in `sgbd.features.NODE_NAMES`.
        - edge_index: int64 [2, 2E], the E pairs with i < j, then the same pairs reversed.
        - edge_attr: float32 [2E, D], edge features, columns as in `sgbd.features.EDGE_NAMES`.
        - edge_label_index: int64 [2, E], each pair once, i < j: the first half of `edge_index`.
        - border_length: float32 [E], pixels; 0 for pairs that do not touch.
        - area: int64 [N], pixels.
        - image_size: int64 [1, 2], height and width.
        - name: the frame's name.
        - label_map: uint8 [B], the packed label map (`sgbd.label_map.unpack`), if `store_maps`.

        and, for a frame with ground truth,

        - edge_label: float32 [E], 1 if both superpixels belong to the same instance (background and supporting surface
          count as instances), 0 if not, -1 unknown, if more than half of either superpixel is ignored.
        - node_instance: int64 [N], the instance with the most pixels in the superpixel (ties go to the smaller id); -1
          unknown, if more than half of its pixels are ignored.
        - overlap_index, overlap_instance, overlap_count: int64 [M], superpixel, instance and the number of pixels they
          share; ignored pixels are not counted.
        - instance_id, instance_category: int64 [K], the instances of the frame and the 1-based position of their
          category in `category_names`; 0 if they have none.
        - truth_map: uint8 [B'], the packed instances, if `store_maps`.

    Raises:
        ValueError: If the label map does not have the frame's size, skips ids or holds negative ones, if `adjacency`
            does not give pairs i < j, each once, or an instance has a category that is not in `category_names`.
    """
    return as_data(graph_arrays(frame, label_map, adjacency, category_names, store_maps=store_maps))


def as_data(graph: GraphArrays) -> Data:
    """Convert a graph of NumPy arrays to PyG `Data`; the tensors share the arrays' memory."""
    import torch
    from torch_geometric.data import Data

    return Data.from_dict(
        {key: value if isinstance(value, str) else torch.from_numpy(value) for key, value in graph.items()}
    )


def edge_positions(edge_index: Tensor, pairs: Tensor, num_nodes: int) -> Tensor:
    """Find the positions of directed pairs in `edge_index`, and thus in `edge_attr`.

    Args:
        edge_index: int64 [2, 2E].
        pairs: int64 [2, P].
        num_nodes: Number of nodes.

    Returns:
        int64 [P].

    Raises:
        ValueError: If a pair is not an edge of the graph.
    """
    import torch

    keys, wanted = edge_index[0] * num_nodes + edge_index[1], pairs[0] * num_nodes + pairs[1]
    if keys.numel() == 0:
        if wanted.numel():
            raise ValueError("the graph has no edges, so its pairs have no edge features")
        return wanted
    ordered, order = keys.sort()
    place = torch.searchsorted(ordered, wanted).clamp(max=keys.numel() - 1)
    if not torch.equal(ordered[place], wanted):
        first = int((ordered[place] != wanted).nonzero()[0])
        raise ValueError(f"the pair {tuple(pairs[:, first].tolist())} of edge_label_index is no edge of edge_index")
    return order[place]


def to_networkx(
    data: Data, node_names: Sequence[str] | None = None, edge_names: Sequence[str] | None = None
) -> nx.Graph:
    """Convert a graph to NetworkX, for analysis.

    Args:
        data: A graph of `build_graph`, with any selection of feature columns.
        node_names: Names of the columns of `x`, such as `sgbd.data.SuperpixelGraphDataset.node_names`. By default
            those of `sgbd.features.NODE_NAMES` if there are as many columns, and otherwise none.
        edge_names: Names of the columns of `edge_attr`, likewise.

    Returns:
        An undirected graph. Nodes have the attributes `x` (a list of features), `area` and, with ground truth,
        `instance`. Edges have `edge_attr` (of the direction i to j, i < j), `border_length` and, with ground truth,
        `label`. Every named feature is also an attribute under its own name. The graph has `name`, `height` and
        `width`.
    """
    import networkx as nx

    height, width = data.image_size[0].tolist()
    graph = nx.Graph(name=data.name, height=height, width=width)
    labeled = "edge_label" in data
    if node_names is None and data.x.shape[1] == len(NODE_NAMES):
        node_names = NODE_NAMES
    if edge_names is None and data.edge_attr.shape[1] == len(EDGE_NAMES):
        edge_names = EDGE_NAMES
    for node, (x, area) in enumerate(zip(data.x.tolist(), data.area.tolist(), strict=True)):
        features = {} if node_names is None else dict(zip(node_names, x, strict=True))
        graph.add_node(node, **(features | {"x": x, "area": area}))
        if labeled:
            graph.nodes[node]["instance"] = int(data.node_instance[node])
    pairs = data.edge_label_index.t().tolist()
    attributes = data.edge_attr[: len(pairs)].tolist()
    for edge, ((i, j), attribute, length) in enumerate(
        zip(pairs, attributes, data.border_length.tolist(), strict=True)
    ):
        features = {} if edge_names is None else dict(zip(edge_names, attribute, strict=True))
        graph.add_edge(i, j, **(features | {"edge_attr": attribute, "border_length": length}))
        if labeled:
            graph.edges[i, j]["label"] = float(data.edge_label[edge])
    return graph
