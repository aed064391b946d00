from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given

from sgbd.adjacency import bounding_box_pairs
from sgbd.benchmarking.frames import made_up_scene
from sgbd.benchmarking.reference import (
    FEATURES,
    STAGES,
    Reference,
    patch_features,
    scikit_image_superpixels,
    touching_boxes,
)
from sgbd.benchmarking.timing import Stopwatch
from sgbd.features import Geometry, node_columns, node_features
from sgbd.frame import Frame
from sgbd.graph import build_graph
from sgbd.metrics import ContingencyTable, objects_by_majority, score_frame
from sgbd.partition import ConnectedComponents
from sgbd.regions import region_and_border_sums
from sgbd.superpixels import Slic
from tests.label_maps import label_maps


def masks_of(label_map):
    return [label_map == label for label in range(int(label_map.max()) + 1)]


@given(label_maps())
def test_its_pairs_are_those_of_bounding_boxes(label_map):
    pairs = touching_boxes(masks_of(label_map))
    assert pairs.dtype == np.int64
    assert pairs.tolist() == bounding_box_pairs(label_map).tolist()


def test_one_patch_has_no_pairs():
    assert touching_boxes([np.ones((3, 4), bool)]).shape == (2, 0)


def test_its_features_are_the_papers():
    # A tilted plane without holes, so that both methods use the same depth.
    rows, columns = np.mgrid[:24, :32]
    rgb = np.stack([8 * columns, 10 * rows, rows + columns], axis=2).astype(np.uint8)
    frame = Frame(rgb, (1 + 0.01 * columns + 0.02 * rows).astype(np.float32))
    label_map = (rows // 8 * 4 + columns // 8).astype(np.int32)
    regions, borders = region_and_border_sums(frame, label_map)
    ours = node_features(frame, regions, Geometry(regions, borders, frame.camera))
    theirs = patch_features(frame, masks_of(label_map))
    columns_of = node_columns(["rgb", "position", "depth"])
    np.testing.assert_allclose(theirs[:, :6], ours[:, columns_of], atol=1e-5)
    # The reference uses slopes per pixel, our features per metre; only the direction in the image is the same.
    normal = ours[:, node_columns(["normal"])]
    np.testing.assert_allclose(theirs[:, 6] / theirs[:, 7], normal[:, 0] / normal[:, 1], rtol=1e-2)
    np.testing.assert_allclose(np.linalg.norm(theirs[:, 6:], axis=1), 1, rtol=1e-6)


def test_it_takes_every_stage_once_and_is_deterministic():
    frame, stopwatch = made_up_scene(64, 48, 0).frame(), Stopwatch()
    torch.manual_seed(0)
    reference = Reference.untrained(16)
    segments = reference(frame, stopwatch)
    assert tuple(stopwatch.seconds) == STAGES
    assert {len(seconds) for seconds in stopwatch.seconds.values()} == {1}
    assert segments.shape == (48, 64)
    assert segments.dtype == np.int32
    assert segments.min() == 1
    assert np.array_equal(segments, reference(frame))


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_merging_nothing_and_everything(share):
    frame = made_up_scene(64, 48, 0).frame()
    rgb, depth = scikit_image_superpixels(frame, 16)
    segments = Reference(16, lambda ends: torch.full((len(ends),), share - 0.5))(frame)
    patches = len(np.unique(rgb.astype(int) * 1000 + depth))
    assert segments.max() == (patches if share == 0 else 1)


LARGEST_STEP = 0.08


def alike(ends: torch.Tensor) -> torch.Tensor:
    """Merge patches of one colour."""
    return LARGEST_STEP - (ends[:, :3] - ends[:, FEATURES : FEATURES + 3]).norm(dim=1)


def test_it_segments_as_well_as_ours_by_the_same_rule():
    rng = np.random.default_rng(0)
    rgb = np.full((96, 128, 3), 90, np.uint8)
    depth = np.full((96, 128), 1.5, np.float32)
    instances = np.ones((96, 128), np.int32)
    for number, color in enumerate(((220, 40, 40), (40, 200, 60), (60, 60, 230)), start=2):
        box = np.s_[24:72, 40 * (number - 2) + 8 : 40 * (number - 2) + 36]
        rgb[box], depth[box], instances[box] = color, 1.2, number
    frame = Frame(np.clip(rgb + rng.integers(-4, 5, rgb.shape), 0, 255).astype(np.uint8), depth)

    def f_measure(segments) -> float:
        table = ContingencyTable.from_label_maps(segments, instances)
        return score_frame(table, objects_by_majority(table)).overlap.f_measure

    label_map = Slic(64)(frame)
    data = build_graph(frame, label_map)
    pairs = data.edge_label_index.numpy()
    color = data.x[:, :3].numpy()
    merge = np.linalg.norm(color[pairs[0]] - color[pairs[1]], axis=1) < LARGEST_STEP
    ours = ConnectedComponents()(len(color), pairs, merge.astype(float), data.border_length.numpy())[label_map]
    theirs = Reference(64, alike)(frame)
    assert f_measure(theirs) > 0.95
    assert f_measure(theirs) == pytest.approx(f_measure(ours), abs=0.03)
