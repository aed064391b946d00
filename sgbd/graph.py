"""From a frame and its superpixels to a PyG graph, and on to NetworkX."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import networkx as nx
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor
from torch_geometric.data import Data

from sgbd.adjacency import Adjacency, LabelMap, Pairs, border_pairs
from sgbd.features import EDGE_NAMES, NODE_NAMES, Geometry, edge_features, node_features, sums_of_pairs
from sgbd.frame import IGNORE, Frame
from sgbd.label_map import pack
from sgbd.majority import majority_instance
from sgbd.regions import PAIRS, border_sums, region_sums

MERGE, CUT, UNKNOWN = 1.0, 0.0, -1.0
"""Values of `edge_label`."""


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

    def __call__(
        self, frame: Frame, label_map: LabelMap, category_names: Sequence[str] = (), *, store_maps: bool = True
    ) -> Data:
        """Build the graph of a frame; see `build_graph`."""
        return build_graph(frame, label_map, self.adjacency, category_names, store_maps=store_maps)


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
          instances), 0 they don't, -1 unknown, because an end lies wholly in ignored pixels.
        - node_instance: int64 [N], the instance with most pixels in the superpixel, the smaller id if several have;
          -1 unknown.
        - overlap_index, overlap_instance, overlap_count: int64 [M], superpixel, instance, and pixels they share;
          ignored pixels are left out.
        - instance_id, instance_category: int64 [K], the instances of the frame and the position of their category in
          `category_names`, counted from 1; 0 none.
        - truth_map: uint8 [B'], the packed instances, unless `store_maps` is off.

    Raises:
        ValueError: If the label map is not of the frame's size, or an instance has a category that is not in
            `category_names`.
    """
    if label_map.shape != frame.depth.shape:
        raise ValueError(
            f"the label map has shape {label_map.shape}, the frame {frame.depth.shape}: over-segment this very frame"
        )
    regions = region_sums(frame, label_map)
    if not (regions.pixels > 0).all():
        raise ValueError("the label map skips ids: number its superpixels 0..N-1 (sgbd.superpixels.connect.renumber)")
    borders = border_sums(frame, label_map)
    geometry = Geometry(regions, borders, frame.camera)
    pairs = borders.pairs if adjacency is border_pairs else adjacency(label_map)
    forward, backward = edge_features(pairs, borders, regions, geometry)
    edge_label_index = torch.from_numpy(np.ascontiguousarray(pairs))
    data = Data(
        x=torch.from_numpy(node_features(frame, regions, geometry)),
        edge_index=torch.cat([edge_label_index, edge_label_index.flip(0)], dim=1),
        edge_attr=torch.from_numpy(np.concatenate([forward, backward])),
        edge_label_index=edge_label_index,
        border_length=torch.from_numpy(sums_of_pairs(pairs, borders)[:, PAIRS].astype(np.float32)),
        area=torch.from_numpy(regions.pixels.astype(np.int64)),
        image_size=torch.tensor([[frame.height, frame.width]]),
        name=frame.name,
    )
    if store_maps:
        data.label_map = pack(label_map)
    if frame.instances is not None:
        _add_truth(data, frame, frame.instances, label_map, pairs, category_names)
        if store_maps:
            data.truth_map = pack(frame.instances)
    return data


def _add_truth(
    data: Data,
    frame: Frame,
    instances: npt.NDArray[np.int32],
    label_map: LabelMap,
    pairs: Pairs,
    category_names: Sequence[str],
) -> None:
    superpixel, instance, count = overlap_table(label_map, instances)
    majority = majority_instance(superpixel, instance, count, int(data.x.shape[0]))
    known = (majority[pairs[0]] != IGNORE) & (majority[pairs[1]] != IGNORE)
    same = np.where(majority[pairs[0]] == majority[pairs[1]], MERGE, CUT)
    ids = np.unique(instance)
    position = {name: place for place, name in enumerate(category_names, start=1)}
    names = [frame.categories.get(int(key)) for key in ids]
    unknown = sorted({name for name in names if name is not None and category_names and name not in position})
    if unknown:
        raise ValueError(
            f"frame {frame.name!r}: unknown category {', '.join(unknown)}; the dataset has {', '.join(category_names)}"
        )
    data.edge_label = torch.from_numpy(np.where(known, same, UNKNOWN).astype(np.float32))
    data.node_instance = torch.from_numpy(majority)
    data.overlap_index = torch.from_numpy(superpixel)
    data.overlap_instance = torch.from_numpy(instance)
    data.overlap_count = torch.from_numpy(count)
    data.instance_id = torch.from_numpy(ids)
    data.instance_category = torch.tensor([position.get(name or "", 0) for name in names], dtype=torch.int64)


def overlap_table(
    label_map: LabelMap, instances: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Count the pixels that every superpixel shares with every instance; ignored pixels are left out.

    Args:
        label_map: int32 [H, W], ids 0..N-1.
        instances: int32 [H, W], -1 ignore.

    Returns:
        Superpixel, instance and number of pixels, int64 [M] each, sorted by superpixel, then by instance.
    """
    counted = instances != IGNORE
    width = int(instances.max(initial=0)) + 1
    keys = label_map[counted].astype(np.int64) * width + instances[counted]
    counts = np.bincount(keys)
    present = np.nonzero(counts)[0]
    return present // width, present % width, counts[present].astype(np.int64)


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
    height, width = data.image_size[0].tolist()
    graph = nx.Graph(name=data.name, height=height, width=width)
    labelled = "edge_label" in data
    named = data.x.shape[1] == len(NODE_NAMES)
    for node, (x, area) in enumerate(zip(data.x.tolist(), data.area.tolist(), strict=True)):
        graph.add_node(node, x=x, area=area, **(dict(zip(NODE_NAMES, x, strict=True)) if named else {}))
        if labelled:
            graph.nodes[node]["instance"] = int(data.node_instance[node])
    pairs = data.edge_label_index.t().tolist()
    attributes = data.edge_attr[: len(pairs)].tolist()
    named = data.edge_attr.shape[1] == len(EDGE_NAMES)
    for edge, ((i, j), attribute, length) in enumerate(
        zip(pairs, attributes, data.border_length.tolist(), strict=True)
    ):
        names = dict(zip(EDGE_NAMES, attribute, strict=True)) if named else {}
        graph.add_edge(i, j, edge_attr=attribute, border_length=length, **names)
        if labelled:
            graph.edges[i, j]["label"] = float(data.edge_label[edge])
    return graph
