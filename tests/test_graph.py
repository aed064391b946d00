import functools
from collections.abc import Mapping

import networkx as nx
import numpy as np
import numpy.typing as npt
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch_geometric.data import Data
from torch_geometric.loader import DataLoader
from torch_geometric.nn import GCNConv, GINEConv, TransformerConv

from sgbd.adjacency import border_pairs, bounding_box_pairs
from sgbd.features import EDGE_NAMES, NODE_NAMES
from sgbd.frame import Frame
from sgbd.graph import GraphBuilder, build_graph, edge_positions, to_networkx
from sgbd.graph_arrays import overlap_table
from sgbd.label_map import unpack
from tests.label_maps import frames, label_maps

LABEL_MAP = np.repeat(np.array([[0, 0, 1, 1, 2, 2]], np.int32), 4, axis=0)


def _frame(instances: npt.NDArray[np.int32] | None, categories: Mapping[int, str] | None = None) -> Frame:
    rgb = np.zeros((4, 6, 3), np.uint8)
    return Frame(rgb, np.ones((4, 6), np.float32), None, instances, categories or {}, "three")


def _instances(*columns: int) -> npt.NDArray[np.int32]:
    return np.repeat(np.array([columns], np.int32), 4, axis=0)


def test_a_graph_of_three_superpixels() -> None:
    data = build_graph(_frame(_instances(2, 2, 2, 1, 1, 1)), LABEL_MAP)
    data.validate(raise_on_error=True)
    assert type(data) is Data
    assert data.x.shape == (3, len(NODE_NAMES))
    assert data.edge_index.tolist() == [[0, 1, 1, 2], [1, 2, 0, 1]]
    assert data.edge_label_index.tolist() == [[0, 1], [1, 2]]
    assert data.edge_attr.shape == (4, len(EDGE_NAMES))
    assert data.border_length.tolist() == [4, 4]
    assert data.area.tolist() == [8, 8, 8]
    # The middle superpixel is half object 2, half surface 1: the smaller id wins.
    assert data.node_instance.tolist() == [2, 1, 1]
    assert data.edge_label.tolist() == [0, 1]
    overlaps = zip(
        data.overlap_index.tolist(), data.overlap_instance.tolist(), data.overlap_count.tolist(), strict=True
    )
    assert list(overlaps) == [(0, 2, 8), (1, 1, 4), (1, 2, 4), (2, 1, 8)]
    assert data.instance_id.tolist() == [1, 2]
    assert (unpack(data.label_map, (4, 6)) == LABEL_MAP).all()
    assert unpack(data.truth_map, (4, 6))[0].tolist() == [2, 2, 2, 1, 1, 1]
    assert data.name == "three"


def test_a_superpixel_mostly_of_ignored_pixels_has_no_labels() -> None:
    data = build_graph(_frame(_instances(-1, -1, -1, 3, 3, 3)), LABEL_MAP)
    assert data.node_instance.tolist() == [-1, 3, 3], "half of the middle one is known"
    assert data.edge_label.tolist() == [-1, 1]
    assert data.overlap_count.tolist() == [4, 8]
    instances = _instances(2, 2, -1, -1, 3, 3)
    instances[0, 2] = 3
    data = build_graph(_frame(instances), LABEL_MAP)
    assert data.node_instance.tolist() == [2, -1, 3]
    assert data.edge_label.tolist() == [-1, -1]
    assert data.overlap_count.tolist() == [8, 1, 8], "its known pixels are scored"


def test_a_frame_without_truth_has_no_labels() -> None:
    data = build_graph(_frame(None), LABEL_MAP, store_maps=False)
    assert "edge_label" not in data
    assert "truth_map" not in data
    assert "label_map" not in data


def test_one_superpixel_makes_a_graph_without_edges() -> None:
    data = build_graph(_frame(_instances(*[1] * 6)), np.zeros((4, 6), np.int32))
    assert data.edge_index.shape == (2, 0)
    assert data.edge_attr.shape == (0, len(EDGE_NAMES))
    assert data.edge_label.shape == (0,)


def test_a_function_named_by_a_bare_partial_is_that_function() -> None:
    assert GraphBuilder(functools.partial(border_pairs)).adjacency is border_pairs
    assert GraphBuilder(functools.partial(bounding_box_pairs)).adjacency is bounding_box_pairs


def test_pairs_in_the_wrong_direction_are_refused() -> None:
    with pytest.raises(ValueError, match=r"with i < j; got \(1, 0\)"):
        build_graph(_frame(None), LABEL_MAP, lambda label_map: border_pairs(label_map)[::-1])


def test_categories_are_positions_in_the_list_of_names() -> None:
    frame = _frame(_instances(2, 2, 3, 3, 1, 1), {2: "mug", 3: "can"})
    data = GraphBuilder()(frame, LABEL_MAP, ("bag", "can", "mug"))
    assert data.instance_id.tolist() == [1, 2, 3]
    assert data.instance_category.tolist() == [0, 3, 2]


def test_an_unknown_category_is_named() -> None:
    frame = _frame(_instances(2, 2, 2, 1, 1, 1), {2: "spoon"})
    with pytest.raises(ValueError, match="'three': unknown category spoon; the dataset has bag, can"):
        build_graph(frame, LABEL_MAP, category_names=("bag", "can"))


def test_label_maps_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"shape \(2, 2\), the frame \(4, 6\)"):
        build_graph(_frame(None), np.zeros((2, 2), np.int32))
    with pytest.raises(ValueError, match="holds the id -1: every pixel belongs to a superpixel"):
        build_graph(_frame(None), np.where(LABEL_MAP == 1, -1, LABEL_MAP // 2))
    with pytest.raises(ValueError, match="skips ids"):
        build_graph(_frame(None), np.where(LABEL_MAP == 1, 5, 0).astype(np.int32))


def test_bounding_box_pairs_have_features_too() -> None:
    label_map = np.array([[0, 0, 1, 1], [0, 2, 2, 1], [3, 3, 2, 1]], np.int32)
    frame = Frame(np.zeros((3, 4, 3), np.uint8), np.ones((3, 4), np.float32))
    data = build_graph(frame, label_map, bounding_box_pairs)
    apart = data.border_length == 0
    assert data.edge_label_index[:, apart].T.tolist() == [[1, 3]]
    assert torch.isfinite(data.edge_attr).all()


@given(label_maps(), st.data())
def test_overlaps_add_up_and_labels_agree_with_the_majority(
    label_map: npt.NDArray[np.int32], data: st.DataObject
) -> None:
    frame = data.draw(frames(label_map.shape, with_instances=True))
    assert frame.instances is not None
    superpixel, instance, count = overlap_table(label_map, frame.instances)
    for s, i, c in zip(superpixel, instance, count, strict=True):
        assert c == ((label_map == s) & (frame.instances == i)).sum()
    assert count.sum() == (frame.instances >= 0).sum()
    graph = build_graph(frame, label_map)
    for node in range(len(graph.area)):
        inside = frame.instances[label_map == node]
        ids, counts = np.unique(inside[inside >= 0], return_counts=True)
        assert graph.node_instance[node] == (ids[counts.argmax()] if 2 * counts.sum() >= len(inside) else -1)


def test_instances_may_have_large_ids() -> None:
    label_map = np.arange(12, dtype=np.int32).reshape(3, 4) // 2
    instances = np.where(label_map < 3, -1, 2**31 - 1 - label_map % 2).astype(np.int32)
    instances[0, :3] = 26_003
    assert [values.tolist() for values in overlap_table(label_map, instances)] == [
        [0, 1, 3, 4, 5],
        [26_003, 26_003, 2**31 - 2, 2**31 - 1, 2**31 - 2],
        [2, 1, 2, 2, 2],
    ]


def test_edge_positions_find_any_direction_and_name_what_is_missing() -> None:
    edge_index = torch.tensor([[0, 1, 1, 2], [1, 2, 0, 1]])
    pairs = torch.tensor([[2, 0, 1], [1, 1, 0]])
    assert edge_positions(edge_index, pairs, 3).tolist() == [3, 0, 2]
    with pytest.raises(ValueError, match=r"\(0, 2\) of edge_label_index is no edge"):
        edge_positions(edge_index, torch.tensor([[0, 0], [1, 2]]), 3)
    empty = torch.empty(2, 0, dtype=torch.int64)
    assert edge_positions(empty, empty, 3).tolist() == []
    with pytest.raises(ValueError, match="no edges"):
        edge_positions(empty, pairs, 3)


def test_graphs_batch_and_any_layer_runs_on_them() -> None:
    graphs = [
        build_graph(_frame(_instances(2, 2, 2, 1, 1, 1)), LABEL_MAP),
        build_graph(_frame(_instances(2, 2, 2, 2, 1, 1)), np.zeros((4, 6), np.int32)),
        build_graph(_frame(_instances(2, 2, 3, 3, 1, 1)), LABEL_MAP),
    ]
    batch = next(iter(DataLoader(graphs, batch_size=3)))
    assert batch.edge_label_index.tolist() == [[0, 1, 4, 5], [1, 2, 5, 6]]
    # Superpixel indices in the overlap table are shifted with their graph; instance ids are kept.
    assert batch.overlap_index.tolist()[-3:] == [4, 5, 6]
    assert batch.overlap_instance.tolist()[-3:] == [2, 3, 1]
    width, edge_width = len(NODE_NAMES), len(EDGE_NAMES)
    assert GCNConv(width, 4)(batch.x, batch.edge_index).shape == (7, 4)
    assert TransformerConv(width, 4, edge_dim=edge_width)(batch.x, batch.edge_index, batch.edge_attr).shape == (7, 4)
    gine = GINEConv(torch.nn.Linear(width, 4), edge_dim=edge_width)
    assert gine(batch.x, batch.edge_index, batch.edge_attr).shape == (7, 4)


def test_networkx_has_names_and_labels() -> None:
    graph = to_networkx(build_graph(_frame(_instances(2, 2, 2, 1, 1, 1)), LABEL_MAP))
    assert isinstance(graph, nx.Graph)
    assert graph.graph == {"name": "three", "height": 4, "width": 6}
    assert sorted(graph.edges) == [(0, 1), (1, 2)]
    assert graph.edges[0, 1]["label"] == 0
    assert graph.edges[0, 1]["border_length"] == 4
    assert graph.edges[1, 2]["log_border_length"] == pytest.approx(np.log1p(4))
    assert graph.nodes[0]["instance"] == 2
    assert graph.nodes[2]["centroid_x"] == pytest.approx(4.5 / 6)


def test_networkx_has_the_names_that_it_is_given() -> None:
    data = build_graph(_frame(None), LABEL_MAP)
    data.x = torch.cat([data.x[:, :1], torch.full((3, 1), 7.0)], dim=1)
    assert set(to_networkx(data).nodes[0]) == {"x", "area"}
    graph = to_networkx(data, ["red", "own"], ["edge" + name for name in EDGE_NAMES])
    assert graph.nodes[2] == {"x": [0, 7], "area": 8, "red": 0, "own": 7}
    assert graph.edges[1, 2]["edgelog_border_length"] == pytest.approx(np.log1p(4))
