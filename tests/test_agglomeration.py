from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import sgbd.recipe
from sgbd import Segmenter
from sgbd.agglomeration import (
    BINS,
    EDGE_COLUMNS,
    NODE_COLUMNS,
    STRIDE,
    AgglomeratedGraph,
    Samples,
    _sample,
    continuation,
    evidence,
    sample_numpy,
    sight,
)
from sgbd.checkpoint import Checkpoint, CheckpointError
from sgbd.data import SuperpixelGraphDataset
from sgbd.features import EDGE_NAMES, NODE_NAMES
from sgbd.frame import Frame, Intrinsics
from sgbd.graph import GraphBuilder, build_graph
from sgbd.label_map import unpack
from sgbd.models import ObjectnessHead, SharedMLP
from sgbd.preparation import prepare
from sgbd.recipe import describe, graph_recipe
from sgbd.regions import region_and_border_sums
from sgbd.segmentation import Classification, classify, paint, partition_graph
from sgbd.superpixels import Slic
from tests.scenes import Scenes, scene

FEATURES = {"node": ["rgb", "depth"], "edge": ["convexity"]}
SUPERPIXELS = Slic(40, min_size=4)


def checkpoint(graph: object, first_stage: Checkpoint | None = None, head: bool = True) -> Checkpoint:
    torch.manual_seed(0)
    own = (len(NODE_COLUMNS), len(EDGE_COLUMNS)) if first_stage is not None else (0, 0)
    channels = {"node_channels": 4 + own[0], "edge_channels": 4 + own[1]}
    objectness = {"_target_": "sgbd.models.ObjectnessHead", "hidden_channels": [8], "node_channels": 4 + own[0]}
    recipe = {
        "superpixels": describe(SUPERPIXELS),
        "graph": describe(graph),
        "features": FEATURES,
        "model": {"_target_": "sgbd.models.SharedMLP", "hidden_channels": [8], **channels},
        "objectness": objectness if head else None,
        "partition": {"_target_": "sgbd.partition.GreedyMulticut", "threshold": 0.515},
        "objects": {"_target_": "sgbd.segmentation.ObjectRule", "min_objectness": 0.3, "min_area": 5},
    }
    model = SharedMLP(**channels, hidden_channels=[8])
    return Checkpoint(model, ObjectnessHead(4 + own[0], [8]) if head else None, recipe, first_stage)


@pytest.fixture
def first() -> Checkpoint:
    return checkpoint(GraphBuilder())


@pytest.fixture
def graph(first: Checkpoint) -> AgglomeratedGraph:
    return AgglomeratedGraph(first, threshold=0.515, reach=0.3, min_objectness=0.0, min_area=0)


def test_the_nodes_are_the_segments_of_the_first_stage(first: Checkpoint, graph: AgglomeratedGraph) -> None:
    frame = scene(0)
    label_map = SUPERPIXELS(frame)
    data = graph(frame, label_map)
    segmenter = Segmenter(first)
    fine = segmenter.build_graph(frame, label_map)
    said = classify(first.model, first.objectness, fine)
    segments = partition_graph(fine, said, segmenter.partition, segmenter.rule)
    assert data.node_of_superpixel.tolist() == segments.segment.tolist()
    assert (unpack(data.label_map, (frame.height, frame.width)) == segments.segment[label_map]).all()
    plain = build_graph(frame, segments.segment.astype(np.int32)[label_map])
    assert torch.equal(data.x[:, : len(NODE_NAMES)], plain.x)
    assert data.x[:, len(NODE_NAMES)].numpy() == pytest.approx(segments.objectness, abs=1e-6)
    assert data.area.tolist() == segments.area.tolist()
    assert data.node_instance.tolist() == plain.node_instance.tolist()


def test_the_recipe_follows_the_code_of_the_first_stages_networks(
    graph: AgglomeratedGraph, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = graph_recipe(Scenes(), SUPERPIXELS, graph)["code"]
    look = sgbd.recipe._digest_and_imports
    changed = "sgbd.models.mlp"
    monkeypatch.setattr(
        sgbd.recipe, "_digest_and_imports", lambda name: ("other code", ()) if name == changed else look(name)
    )
    assert graph_recipe(Scenes(), SUPERPIXELS, graph)["code"] != before


def test_pairs_that_touch_keep_their_features_and_others_within_reach_join_them(
    first: Checkpoint, graph: AgglomeratedGraph
) -> None:
    frame = scene(0)
    label_map = SUPERPIXELS(frame)
    touching = AgglomeratedGraph(first, threshold=0.515, reach=0.0)(frame, label_map)
    joined = graph(frame, label_map)
    few = {tuple(pair): row for row, pair in enumerate(touching.edge_label_index.t().tolist())}
    many = {tuple(pair): row for row, pair in enumerate(joined.edge_label_index.t().tolist())}
    assert set(few) < set(many)
    touches = len(EDGE_NAMES) + EDGE_COLUMNS.index("touching")
    for pair, row in many.items():
        assert joined.edge_attr[row, touches] == (pair in few)
        if pair in few:
            assert torch.equal(joined.edge_attr[row], touching.edge_attr[few[pair]])
        smaller = min(joined.area[list(pair)].tolist())
        assert joined.border_length[row] == pytest.approx(smaller**0.5)
    segments = unpack(joined.label_map, (frame.height, frame.width))
    positions = Samples(frame, segments, len(joined.area)).position
    for i in range(len(positions)):
        for j in range(i + 1, len(positions)):
            near = np.linalg.norm(positions[i] - positions[j]) < 0.3
            assert ((i, j) in many) == bool(near or (i, j) in few)


def test_the_two_directions_of_an_edge_have_the_same_own_columns(graph: AgglomeratedGraph) -> None:
    frame = scene(1)
    data = graph(frame, SUPERPIXELS(frame))
    count = data.edge_label_index.size(1)
    assert data.edge_attr.shape == (2 * count, len(EDGE_NAMES) + len(EDGE_COLUMNS))
    assert torch.equal(data.edge_attr[:count, len(EDGE_NAMES) :], data.edge_attr[count:, len(EDGE_NAMES) :])


def wall_with_a_post() -> tuple[Frame, np.ndarray]:
    """Return two patches of a wall 2 m away, on both sides of a post at 1 m."""
    depth = np.full((8, 48), 2.0, np.float32)
    depth[:, 16:32] = 1.0
    label_map = np.zeros((8, 48), np.int32)
    label_map[:, 16:32], label_map[:, 32:] = 1, 2
    return Frame(np.zeros((8, 48, 3), np.uint8), depth, None), label_map


def test_what_hides_a_connection_is_nearer_than_the_line_of_sight() -> None:
    frame, label_map = wall_with_a_post()
    data = build_graph(frame, label_map)
    regions, _ = region_and_border_sums(frame, label_map)
    own, missing, nearer, farther = sight(frame, label_map, data.x.numpy(), np.array([[0], [2]]), regions)[0]
    # The centroids are 32 pixels apart, half of which the post hides.
    assert own + nearer == pytest.approx(1)
    assert nearer == pytest.approx(0.5, abs=0.05)
    assert missing == farther == 0


def test_a_gap_shows_what_lies_behind_it_or_nothing() -> None:
    frame, label_map = wall_with_a_post()
    for behind, column in ((3.0, 3), (0.0, 1)):
        frame.depth.flags.writeable = True
        frame.depth[:, 16:32] = behind
        data = build_graph(frame, label_map)
        regions, _ = region_and_border_sums(frame, label_map)
        shares = sight(frame, label_map, data.x.numpy(), np.array([[0], [2]]), regions)[0]
        assert shares[column] == pytest.approx(0.5, abs=0.05)
        assert shares[0] + shares[column] == pytest.approx(1)


def test_logits_of_the_first_stage_are_averaged_along_the_border() -> None:
    # Superpixels 0 and 1 became segment 0, 2 segment 1, and 3 segment 2.
    segment = np.array([0, 0, 1, 2])
    pairs = np.array([[0, 0, 1, 2], [1, 2, 2, 3]])
    length = np.array([5.0, 2.0, 6.0, 8.0], np.float32)
    probability = np.array([0.9, 0.5, 0.2, 0.7], np.float32)
    wanted = np.array([[0, 0, 1], [1, 2, 2]])
    columns = evidence(wanted, (pairs, length, segment), Classification(probability, None), np.array([16, 64, 256]))
    logit = np.log(probability / (1 - probability))
    expected = [
        [1, (2 * logit[1] + 6 * logit[2]) / 8, logit[1], np.log(16), np.log(64), 8 / 4],
        [0, 0, 0, np.log(16), np.log(256), 0],
        [1, logit[3], logit[3], np.log(64), np.log(256), 8 / 8],
    ]
    assert columns == pytest.approx(np.array(expected), abs=1e-5)


def test_superpixels_that_do_not_touch_say_nothing_about_a_border() -> None:
    # Bounding-box adjacency pairs superpixels 0 and 2, and 1 and 3, which share no border.
    pairs, length = np.array([[0, 0, 1, 2], [1, 2, 3, 3]]), np.array([5.0, 0.0, 0.0, 8.0], np.float32)
    said = Classification(np.array([0.9, 0.5, 0.2, 0.7], np.float32), None)
    wanted = np.array([[0, 0, 2], [1, 2, 3]])  # 0 and 2 are within reach of each other, 1 and 3 are not
    columns = evidence(wanted, (pairs, length, np.arange(4)), said, np.full(4, 16))
    logit = np.log([9, 7 / 3])
    assert columns[:, :3] == pytest.approx(np.array([[1, logit[0], logit[0]], [0, 0, 0], [1, logit[1], logit[1]]]))


def test_ends_of_one_object_have_its_colors_and_its_width() -> None:
    size = 20 * STRIDE
    rgb, label_map = np.zeros((size, 3 * size, 3), np.uint8), np.full((size, 3 * size), 3, np.int32)
    # Two identical bars on one line, and a third bar of another colour and twice the width.
    for number, (column, row, width, color) in enumerate(((0, 2, 4, 200), (2, 2, 4, 200), (1, 0, 8, 20))):
        bar = np.s_[row * STRIDE : (row + width) * STRIDE, column * size : (column + 1) * size]
        label_map[bar], rgb[bar] = number, color
    frame = Frame(rgb, np.full(label_map.shape, 1.0, np.float32), None)
    same, other = continuation(Samples(frame, label_map, 4), np.array([[0, 0], [1, 2]]))
    assert same[:2] == pytest.approx([1, 0])
    assert other[0] == 0
    # The variance of n pixels in a row is (n^2 - 1) / 12, on the grid of every third one.
    spread = np.sqrt(np.array([4, 8]) ** 2 - 1.0)
    assert other[1] == pytest.approx(np.log(spread[1] / spread[0]))
    length = 2 * STRIDE * np.sqrt((20**2 - 1) / 12)
    assert same[2] == pytest.approx(np.log1p(2 * size / length))


def test_samples_hold_the_mean_point_of_what_has_depth() -> None:
    depth = np.zeros((2 * STRIDE, 4 * STRIDE), np.float32)
    depth[:, : 2 * STRIDE] = 2.0
    label_map = np.zeros(depth.shape, np.int32)
    label_map[:, 3 * STRIDE :] = 1
    camera = Intrinsics(10.0, 20.0, 1.0, 1.0)
    samples = Samples(Frame(np.zeros((*depth.shape, 3), np.uint8), depth, camera), label_map, 2)
    # The grid's columns and rows with depth are 1 and 4.
    assert samples.position[0] == pytest.approx([(2.5 - 1) / 10 * 2, (2.5 - 1) / 20 * 2, 2])
    assert np.isnan(samples.position[1]).all()


@given(height=st.integers(1, 40), width=st.integers(1, 40), seed=st.integers(0, 2**32 - 1))
def test_samples_are_the_same_without_numba(height: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    label_map = rng.integers(0, 5, (height, width)).astype(np.int32)
    depth = np.where(rng.random((height, width)) < 0.3, 0, rng.uniform(0.3, 4, (height, width))).astype(np.float32)
    rgb = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    camera = np.array([500.0, 510.0, width / 2, height / 3])
    results = []
    for sample in (_sample, sample_numpy):
        sums, histogram = np.zeros((5, 10)), np.zeros((5, BINS**3), np.int64)
        sample(label_map, depth, rgb, camera, sums, histogram)
        results.append((sums, histogram))
    (sums, histogram), (others, other_histogram) = results
    np.testing.assert_array_equal(sums, others)
    np.testing.assert_array_equal(histogram, other_histogram)
    assert sums[:, 0].sum() == histogram.sum()


def test_a_second_stage_is_one_file_with_its_first(first: Checkpoint, graph: AgglomeratedGraph, tmp_path: Path) -> None:
    second = checkpoint(graph, first)
    path = second.save(tmp_path / "second.safetensors")
    again = Checkpoint.load(path)
    assert again.to_bytes() == second.to_bytes()
    assert again.first_stage is not None
    assert again.first_stage.to_bytes() == first.to_bytes()

    segmenter = Segmenter.load(path)
    folder = prepare(Scenes("test"), segmenter.superpixels, segmenter.graph, tmp_path / "graphs", workers=0)
    graphs = SuperpixelGraphDataset(folder, "test", FEATURES["node"], FEATURES["edge"])
    assert (graphs.node_channels, graphs.edge_channels) == (5, 17)
    again.require(superpixels=graphs.recipe["superpixels"], graph=graphs.recipe["graph"])
    for frame, data in zip(Scenes("test"), graphs, strict=True):
        assert data.x.shape[1] == 5
        result = segmenter.segment_frame(frame)
        said = classify(segmenter.model, segmenter.objectness, data)
        segments = partition_graph(data, said, segmenter.partition, segmenter.rule)
        cached = paint(unpack(data.label_map, (frame.height, frame.width)), data, said, segments)
        assert (result.instances == cached.instances).all()
        assert (result.superpixels == cached.superpixels).all()
        assert result.described_nodes == f"{result.superpixels.max() + 1} segments of the first stage"


def test_a_graph_without_its_first_stage_says_what_is_missing(graph: AgglomeratedGraph) -> None:
    frame = scene(0)
    unbound = AgglomeratedGraph(graph.first_stage)
    with pytest.raises(CheckpointError, match="first stage sha256:.* is not there"):
        unbound(frame, SUPERPIXELS(frame))


def test_another_first_stage_than_the_recipes_is_refused(graph: AgglomeratedGraph, first: Checkpoint) -> None:
    first.recipe["seed"] = 1
    with pytest.raises(CheckpointError, match="names a first stage"):
        AgglomeratedGraph(graph.first_stage).bind(first)


def test_a_first_stage_needs_an_objectness_head() -> None:
    with pytest.raises(CheckpointError, match="objectness=mlp"):
        AgglomeratedGraph(checkpoint(GraphBuilder(), head=False))


def test_a_model_of_two_stages_is_no_first_stage(first: Checkpoint, graph: AgglomeratedGraph) -> None:
    with pytest.raises(CheckpointError, match=r"has two stages itself; give the one that was graph\.first_stage"):
        AgglomeratedGraph(checkpoint(graph, first))


@pytest.mark.parametrize("change", [{"threshold": 1.0}, {"reach": -1.0}, {"min_objectness": 2.0}, {"min_area": -1}])
def test_numbers_out_of_range_are_refused(first: Checkpoint, change: dict) -> None:
    with pytest.raises(ValueError, match="must lie between"):
        AgglomeratedGraph(first, **change)
