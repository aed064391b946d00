"""The three merging methods on a chain of superpixels with known weights."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.baselines import HierarchicalMerging, NormalizedCut, ThresholdCut
from sgbd.frame import Frame

WIDTH = 4


def chain(depths: list[float]) -> tuple[Frame, npt.NDArray[np.int32]]:
    """Return superpixels side by side, of the same colour, each at the given depth."""
    labels = np.repeat(np.arange(len(depths), dtype=np.int32), WIDTH)[None].repeat(WIDTH, 0)
    return Frame(np.full((*labels.shape, 3), 100, np.uint8), np.array(depths, np.float32)[labels]), labels


def groups(segments: npt.NDArray[np.int32]) -> list[int]:
    """Return the segment of each superpixel, numbered from 0 in the order of the chain."""
    row = segments[0, ::WIDTH]
    return [list(dict.fromkeys(row.tolist())).index(segment) for segment in row.tolist()]


def never(_frame: Frame) -> npt.NDArray[np.int32]:
    raise AssertionError("the superpixels are given")


def test_threshold_cut_keeps_what_steps_more_than_the_threshold() -> None:
    frame, labels = chain([1, 1.01, 1.02, 1.09, 1.1])
    assert groups(ThresholdCut(never, threshold=0.3, depth_weight=10).merge(frame, labels)) == [0, 0, 0, 1, 1]
    assert groups(ThresholdCut(never, threshold=0.05, depth_weight=10).merge(frame, labels)) == [0, 1, 2, 3, 4]
    assert groups(ThresholdCut(never, threshold=1, depth_weight=10).merge(frame, labels)) == [0] * 5


def test_normalized_cut_divides_at_the_weakest_link() -> None:
    frame, labels = chain([1, 1.001, 1.002, 1.2, 1.201, 1.202])
    method = NormalizedCut(never, threshold=0.1, scale=0.1, depth_weight=10)
    assert groups(method.merge(frame, labels)) == [0, 0, 0, 1, 1, 1]


def test_hierarchical_merging_pools_borders() -> None:
    """A weak spot in a border merges two regions in a threshold cut, but not if the whole border is weighted."""
    # Two columns of four superpixels. The step between the columns is 16 cm at the top and 1 cm at the bottom; in the
    # right column, neighbours differ by 5 cm.
    labels = np.stack([np.arange(4), np.arange(4, 8)], axis=1).repeat(WIDTH, 0).repeat(WIDTH, 1).astype(np.int32)
    depth = np.array([1, 1, 1, 1, 1.16, 1.11, 1.06, 1.01], np.float32)[labels]
    frame = Frame(np.full((*labels.shape, 3), 100, np.uint8), depth)
    assert len(np.unique(ThresholdCut(never, threshold=0.6, depth_weight=10).merge(frame, labels))) == 1
    assert len(np.unique(HierarchicalMerging(never, threshold=0.6, depth_weight=10).merge(frame, labels))) > 1


def test_hierarchical_merging_merges_the_most_similar_first() -> None:
    frame, labels = chain([1, 1.02, 1.05, 1.15])
    assert groups(HierarchicalMerging(never, threshold=0.25, depth_weight=10).merge(frame, labels)) == [0, 0, 1, 2]
    assert groups(HierarchicalMerging(never, threshold=0.35, depth_weight=10).merge(frame, labels)) == [0, 0, 0, 1]
    assert groups(HierarchicalMerging(never, threshold=9, depth_weight=10).merge(frame, labels)) == [0, 0, 0, 0]
