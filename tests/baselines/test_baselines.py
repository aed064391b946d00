"""The common behaviour of all baselines, and their results on a made-up table with three boxes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sgbd.baselines import (
    Baseline,
    Felzenszwalb,
    HierarchicalMerging,
    NormalizedCut,
    PlaneRemoval,
    ThresholdCut,
)
from sgbd.frame import Frame
from sgbd.label_map_evaluation import score_label_map
from sgbd.superpixels import Slic
from tests.scenes import scene

SUPERPIXELS = Slic(40, min_size=4)
BASELINES: list[Baseline] = [
    Felzenszwalb(scale=100, sigma=0, min_size=20),
    ThresholdCut(SUPERPIXELS, 0.3, depth_weight=10),
    NormalizedCut(SUPERPIXELS, 0.02, scale=0.1),
    HierarchicalMerging(SUPERPIXELS, 0.3),
    PlaneRemoval(min_area=20),
]


@pytest.fixture(params=BASELINES, ids=lambda baseline: type(baseline).__name__)
def baseline(request: pytest.FixtureRequest) -> Baseline:
    return request.param


def test_boxes_of_three_colours_above_a_table_are_found(baseline: Baseline) -> None:
    frame = scene(1)
    segments = baseline(frame)
    assert segments.dtype == np.int32
    assert segments.shape == frame.depth.shape
    assert (segments.min() == 0) == baseline.decides_objects
    scores = score_label_map(segments, frame, decides_objects=baseline.decides_objects).scores
    assert scores.all.overlap.detected == 3
    assert scores.all.overlap.f_measure > 0.9
    if scores.unaided is not None:
        assert scores.unaided.overlap.predicted == 3


def test_the_truth_is_not_looked_at_and_the_result_is_fixed(baseline: Baseline) -> None:
    frame = scene(2)
    assert (baseline(frame) == baseline(replace(frame, instances=None))).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (3, 2)])
def test_tiny_frames(baseline: Baseline, size: tuple[int, int]) -> None:
    segments = baseline(Frame(np.full((*size, 3), 90, np.uint8), np.ones(size, np.float32)))
    assert segments.shape == size


def test_a_frame_with_hardly_any_depth(baseline: Baseline) -> None:
    frame = scene(3)
    depth = np.zeros_like(frame.depth)
    depth[5, 5:7] = 1
    assert baseline(replace(frame, depth=depth)).shape == depth.shape


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Felzenszwalb(scale=-1), "must not be negative"),
        (lambda: NormalizedCut(SUPERPIXELS, scale=0), "scale of NormalizedCut must be positive; got 0"),
        (lambda: ThresholdCut(SUPERPIXELS, depth_weight=-2), "must not be negative; got -2"),
        (lambda: PlaneRemoval(trials=0), "trials >= 1"),
    ],
)
def test_impossible_options(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()
