from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sgbd.metrics import (
    ContingencyTable,
    match_objects,
    objects_by_contact,
    objects_by_label,
    objects_by_majority,
    overlap_scores,
)

LABELS = arrays(np.int64, (5, 6), elements=st.integers(-1, 4))


def scores_from_masks(prediction: np.ndarray, truth: np.ndarray) -> tuple[float, float, float]:
    """Return the largest sum of pairwise F over all one-to-one matchings, and the shares of correct pixels."""
    known = truth != -1
    predicted = [known & (prediction == k) for k in np.unique(prediction[known]) if k >= 2]
    true = [truth == k for k in np.unique(truth) if k >= 2]
    f = np.array([[2 * (p & t).sum() / (p.sum() + t.sum()) for t in true] for p in predicted])
    if f.size == 0:
        return 0.0, float(sum(map(np.sum, predicted))), float(sum(map(np.sum, true)))
    if len(predicted) > len(true):
        f = f.T
    best = max(
        sum(f[i, j] for i, j in enumerate(order)) for order in itertools.permutations(range(f.shape[1]), f.shape[0])
    )
    return best, float(sum(map(np.sum, predicted))), float(sum(map(np.sum, true)))


@given(LABELS.map(lambda labels: np.maximum(labels, 0)), LABELS)
@settings(max_examples=80, deadline=None)
def test_against_masks(prediction: np.ndarray, truth: np.ndarray):
    table = ContingencyTable.from_label_maps(prediction, truth)
    matching = match_objects(table)
    scores = overlap_scores(table, matching)
    best, predicted, true = scores_from_masks(prediction, truth)
    assert matching.f_measure.sum() == pytest.approx(best)
    right = sum(
        ((prediction == s) & (truth == t)).sum() for s, t in zip(matching.segment, matching.instance, strict=True)
    )
    if predicted:
        assert scores.precision == right / predicted
    if true:
        assert scores.recall == right / true
    assert scores.detected == sum(f > 0.75 for f in matching.f_measure)
    assert 0 <= scores.f_measure <= 1


@given(LABELS.map(lambda labels: np.maximum(labels, 0)), LABELS, st.data())
@settings(deadline=None)
def test_what_is_predicted_on_ignored_pixels_changes_nothing(prediction, truth, data):
    other = np.where(truth == -1, data.draw(arrays(np.int64, truth.shape, elements=st.integers(0, 9))), prediction)
    scores = [overlap_scores(ContingencyTable.from_label_maps(p, truth)) for p in (prediction, other)]
    assert scores[0] == scores[1]


def test_a_split_object():
    # Object 2 has 6 pixels; segment 2 covers 4 of them, segment 3 the other two and one table pixel.
    table = ContingencyTable.from_label_maps(np.array([[2, 2, 2, 2, 3, 3, 3, 1]]), np.array([[2, 2, 2, 2, 2, 2, 1, 1]]))
    scores = overlap_scores(table)
    assert (scores.precision, scores.recall, scores.f_measure) == pytest.approx((4 / 7, 4 / 6, 8 / 13))
    assert (scores.predicted, scores.detected, scores.objects, scores.detected_share) == (2, 1, 1, 1.0)


def test_f_of_exactly_three_quarters_is_no_detection():
    # 2 * 3 / (4 + 4) = 0.75
    table = ContingencyTable.from_label_maps(np.array([[2, 2, 2, 2, 0]]), np.array([[0, 2, 2, 2, 2]]))
    assert match_objects(table).f_measure.tolist() == [0.75]
    assert overlap_scores(table).detected == 0


@pytest.mark.parametrize(
    ("prediction", "truth", "expected"),
    [
        ([[0, 1]], [[1, 0]], (1, 1, 1, 1)),
        ([[0, 1]], [[2, 2]], (1, 0, 0, 0)),
        ([[2, 3]], [[0, 1]], (0, 1, 0, 0)),
        ([[2, 2]], [[-1, -1]], (1, 1, 1, 1)),
        ([[2, 0]], [[0, 2]], (0, 0, 0, 0)),
    ],
)
def test_where_something_is_empty(prediction, truth, expected):
    scores = overlap_scores(ContingencyTable.from_label_maps(np.array(prediction), np.array(truth)))
    assert (scores.precision, scores.recall, scores.f_measure, scores.detected_share) == expected


def test_protocols_for_what_is_an_object():
    prediction = np.array([[0, 0, 0, 0, 1, 1, 5, 5, 6, 6]])
    truth = np.array([[0, 0, 0, 2, 2, 2, 3, 0, 1, -1]])
    table = ContingencyTable.from_label_maps(prediction, truth)
    assert objects_by_label(table).tolist() == [5, 6]
    assert objects_by_label(table, first=1).tolist() == [1, 5, 6]
    assert objects_by_majority(table).tolist() == [1]  # segment 5 is half on an object: no majority
    assert objects_by_contact(table).tolist() == [0, 1, 5]
    chosen = match_objects(table, objects_by_majority(table))
    assert chosen.segment.tolist() == [1]
    assert chosen.instance.tolist() == [2]
    assert overlap_scores(table, chosen).precision == 1


def test_objects_that_are_not_in_the_table_are_left_out():
    table = ContingencyTable.from_label_maps(np.array([[2, 0]]), np.array([[2, 0]]))
    assert match_objects(table, [2, 99]).predicted_objects.tolist() == [2]
