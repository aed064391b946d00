"""From a frame and its superpixels to a PyG graph, and from there to NetworkX."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from sgbd.adjacency import Adjacency, LabelMap, border_pairs
from sgbd.features import EDGE_NAMES, NODE_NAMES
from sgbd.frame import Frame
from sgbd.graph_arrays import CUT, MERGE, UNKNOWN, GraphArrays, graph_arrays, overlap_table

if TYPE_CHECKING:  # imported where they are needed: to import PyG takes seconds and hundreds of MiB
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
        adjacency: Which superpixels are paired: `sgbd.adjacency.border_pairs`, `sgbd.adjacency.bounding_box_pairs`, or
            any function of the same form.
    """

    def __init__(self, adjacency: Adjacency = border_pairs) -> None:
        # A configuration names a function by a partial without arguments; only the function itself is recognised as the
        # adjacency that the pass over the borders gives anyway.
        bare = isinstance(adjacency, functools.partial) and not (adjacency.args or adjacency.keywords)
        self.adjacency: Adjacency = adjacency.func if bare else adjacency  # type: ignore[attr-defined]

    def arrays(
        self, frame: Frame, label_map: LabelMap, category_names: Sequence[str] = (), *, store_maps: bool = True
    ) -> GraphArrays:
        """Build the graph of a frame without PyTorch; see `sgbd.graph_arrays.graph_arrays`."""
        return graph_arrays(frame, label_map, self.adjacency, category_names, store_maps=store_maps)

    def __call__(
        self, frame: Frame, label_map: LabelMap, category_names: Sequence[str] = (), *, store_maps: bool = True
    ) -> Data:
        """Build the graph of a frame; see `build_graph`."""
        return build_graph(frame, label_map, self.adjacency, category_names, store_maps=store_maps)


def array_builder(graph: object) -> Callable[..., GraphArrays] | None:
    """Return what builds a frame's graph without PyG, or None if there is no such thing.

    Args:
        graph: Frame and label map to graph. A builder of this package has a method `arrays`; that of a user's subclass
            may not do what its `__call__` does, and is not returned.
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
    """Build the superpixel graph of a frame, with all features, and with labels where the frame has instances.

    Args:
        frame: The frame.
        label_map: int32 [H, W], ids 0..N-1, each present.
        adjacency: Label map to pairs of superpixels.
        category_names: All categories of the dataset; the categories of the frame's instances are stored as 1-based
            positions in it.
        store_maps: Pack the label map and the truth into the graph, for evaluation and pictures.

    Returns:
        A plain `Data` with

        - x: float32 [N, F], node features, columns as `sgbd.features.NODE_NAMES`.
        - edge_index: int64 [2, 2E], the E pairs i < j, then the same reversed.
        - edge_attr: float32 [2E, D], edge features, columns as `sgbd.features.EDGE_NAMES`.
        - edge_label_index: int64 [2, E], each pair once, i < j: the first half of `edge_index`.
        - border_length: float32 [E], pixels; 0 for pairs that do not touch.
        - area: int64 [N], pixels.
        - image_size: int64 [1, 2], height and width.
        - name: the frame's name.
        - label_map: uint8 [B], the packed label map (`sgbd.label_map.unpack`), unless `store_maps` is off.

        and, for a frame with instances,

        - edge_label: float32 [E], 1 both ends belong to the same instance (background and supporting surface count as
          instances), 0 they don't, -1 unknown, because an end lies mostly in ignored pixels.
        - node_instance: int64 [N], the instance with most pixels in the superpixel, the smaller id if several have;
          -1 unknown, where more than half of its pixels are ignored.
        - overlap_index, overlap_instance, overlap_count: int64 [M], superpixel, instance, and pixels they share;
          ignored pixels are left out.
        - instance_id, instance_category: int64 [K], the instances of the frame and the position of their category in
          `category_names`, counted from 1; 0 none.
        - truth_map: uint8 [B'], the packed instances, unless `store_maps` is off.

    Raises:
        ValueError: If the label map is not of the frame's size, or an instance has a category that is not in
            `category_names`.
    """
    return as_data(graph_arrays(frame, label_map, adjacency, category_names, store_maps=store_maps))


def as_data(graph: GraphArrays) -> Data:
    """Return a graph of arrays as PyG's `Data`, whose tensors share the arrays' memory."""
    import torch
    from torch_geometric.data import Data

    return Data.from_dict(
        {key: value if isinstance(value, str) else torch.from_numpy(value) for key, value in graph.items()}
    )


def edge_positions(edge_index: Tensor, pairs: Tensor, num_nodes: int) -> Tensor:
    """Find where directed pairs stand in `edge_index`, and so in `edge_attr`.

    Args:
        edge_index: int64 [2, 2E].
        pairs: int64 [2, P].
        num_nodes: Number of nodes.

    Returns:
        int64 [P].

    Raises:
        ValueError: If a pair is no edge of the graph.
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


def to_networkx(data: Data) -> nx.Graph:
    """Give the graph to NetworkX, for analysis.

    Args:
        data: A graph of `build_graph`, with any selection of feature columns.

    Returns:
        An undirected graph. Nodes have `x` (a list of features; the named columns where all are there), `area` and,
        with truth, `instance`. Edges have `edge_attr` of the direction i to j, i < j (named columns where all are
        there), `border_length` and, with truth, `label`. The graph has `name`, `height` and `width`.
    """
    import networkx as nx

    height, width = data.image_size[0].tolist()
    graph = nx.Graph(name=data.name, height=height, width=width)
    labeled = "edge_label" in data
    named = data.x.shape[1] == len(NODE_NAMES)
    for node, (x, area) in enumerate(zip(data.x.tolist(), data.area.tolist(), strict=True)):
        graph.add_node(node, x=x, area=area, **(dict(zip(NODE_NAMES, x, strict=True)) if named else {}))
        if labeled:
            graph.nodes[node]["instance"] = int(data.node_instance[node])
    pairs = data.edge_label_index.t().tolist()
    attributes = data.edge_attr[: len(pairs)].tolist()
    named = data.edge_attr.shape[1] == len(EDGE_NAMES)
    for edge, ((i, j), attribute, length) in enumerate(
        zip(pairs, attributes, data.border_length.tolist(), strict=True)
    ):
        names = dict(zip(EDGE_NAMES, attribute, strict=True)) if named else {}
        graph.add_edge(i, j, edge_attr=attribute, border_length=length, **names)
        if labeled:
            graph.edges[i, j]["label"] = float(data.edge_label[edge])
    return graph
