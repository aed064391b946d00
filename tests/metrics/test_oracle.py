from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sgbd.metrics import ContingencyTable, oracle_segments, oracle_table, overlap_scores


def overlaps(superpixels: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    pairs, count = np.unique(np.stack([superpixels.ravel(), truth.ravel()]), axis=1, return_counts=True)
    return pairs[0], pairs[1], count


def test_majority_ties_and_ignored_superpixels():
    superpixel = np.array([0, 0, 1, 1, 2, 3, 3])
    instance = np.array([2, 3, 3, 2, -1, -1, 4])
    count = np.array([5, 6, 4, 4, 9, 9, 1])
    assert oracle_segments(superpixel, instance, count, 4).tolist() == [3, 2, 0, 4]


def test_superpixels_that_respect_the_truth_reach_everything():
    truth = np.array([[0, 0, 2, 2], [1, 1, 3, -1]])
    superpixels = np.array([[0, 1, 2, 2], [3, 3, 4, 5]])
    scores = overlap_scores(oracle_table(*overlaps(superpixels, truth), 6))
    assert (scores.f_measure, scores.detected_share) == (1, 1)


@given(
    arrays(np.int64, (4, 6), elements=st.integers(0, 4)),
    arrays(np.int64, (4, 6), elements=st.integers(-1, 3)),
)
@settings(max_examples=40, deadline=None)
def test_no_labelling_has_more_correct_pixels(superpixels: np.ndarray, truth: np.ndarray):
    overlap = overlaps(superpixels, truth)
    painted = oracle_segments(*overlap, 5)[superpixels]
    right = ((painted == truth) & (truth >= 0)).sum()
    for labels in itertools.product(range(4), repeat=5):
        assert ((np.array(labels)[superpixels] == truth) & (truth >= 0)).sum() <= right
    of_map = ContingencyTable.from_label_maps(painted, truth)
    assert overlap_scores(of_map) == overlap_scores(oracle_table(*overlap, 5))
