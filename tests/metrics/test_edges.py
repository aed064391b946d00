from __future__ import annotations

import numpy as np
import pytest

from sgbd.metrics import EdgeScores, edge_scores


def test_unknown_edges_are_left_out():
    merged = np.array([True, True, False, False, False, True])
    label = np.array([1, 0, 0, 1, -1, -1], dtype=np.float32)
    assert edge_scores(merged, label) == EdgeScores(0.5, 0.5, 0.5, 0.5)


def test_cuts_are_what_is_looked_for():
    scores = edge_scores(np.array([False, False, False, True, True]), np.array([0, 1, 1, 1, 0]))
    assert scores == EdgeScores(cut_precision=1 / 3, cut_recall=0.5, cut_f_measure=0.4, merge_accuracy=0.4)


@pytest.mark.parametrize(
    ("merged", "label", "expected"),
    [
        ([], [], (1, 1, 1, 1)),
        ([True], [-1], (1, 1, 1, 1)),
        ([True, True], [1, 1], (1, 1, 1, 1)),
        ([True, True], [1, 0], (1, 0, 0, 0.5)),
        ([False, True], [1, 1], (0, 1, 0, 0.5)),
    ],
)
def test_where_something_is_empty(merged, label, expected):
    assert edge_scores(np.array(merged, dtype=bool), np.array(label)) == EdgeScores(*expected)


@pytest.mark.parametrize(
    ("merged", "label", "message"),
    [
        (np.array([0.3]), np.array([1]), "compare probabilities to a threshold"),
        (np.array([True, False]), np.array([1]), "one decision for each label"),
        (np.array([True]), np.array([2]), "edge labels must be"),
        (np.array([True]), np.array([np.nan]), "edge labels must be"),
    ],
)
def test_what_is_no_decision(merged, label, message):
    with pytest.raises(ValueError, match=message):
        edge_scores(merged, label)
