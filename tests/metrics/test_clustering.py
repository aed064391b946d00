from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from skimage.metrics import adapted_rand_error, variation_of_information

from sgbd.metrics import ClusteringScores, ContingencyTable, clustering_scores

LABELS = arrays(np.int64, (5, 6), elements=st.integers(0, 4))


@given(LABELS, LABELS)
@settings(deadline=None)
def test_as_scikit_image_has_it(prediction: np.ndarray, truth: np.ndarray):
    scores = clustering_scores(ContingencyTable.from_label_maps(prediction, truth))
    split, merge = variation_of_information(truth, prediction)
    assert scores.split == pytest.approx(split, abs=1e-9)
    assert scores.merge == pytest.approx(merge, abs=1e-9)
    if len(np.unique(truth)) < truth.size and len(np.unique(prediction)) < truth.size:  # else it divides by zero
        assert scores.rand_error == pytest.approx(adapted_rand_error(truth, prediction, ignore_labels=())[0])


def test_halves_and_quarters():
    truth, prediction = np.array([[0, 0, 0, 0, 1, 1, 1, 1]]), np.array([[0, 0, 1, 1, 2, 2, 3, 3]])
    scores = clustering_scores(ContingencyTable.from_label_maps(prediction, truth))
    # The prediction joins 4 pairs of pixels, all of them among the 12 true pairs: P = 1, R = 1/3, F = 1/2.
    assert scores == ClusteringScores(rand_error=0.5, split=1.0, merge=0.0, variation_of_information=1.0)
    swapped = clustering_scores(ContingencyTable.from_label_maps(truth, prediction))
    assert (swapped.split, swapped.merge) == (0.0, 1.0)


def test_equal_up_to_names_and_ignored_pixels():
    prediction, truth = np.array([[5, 5, 8, 9]]), np.array([[0, 0, 2, -1]])
    assert clustering_scores(ContingencyTable.from_label_maps(prediction, truth)) == ClusteringScores(0, 0, 0, 0)


def test_no_known_pixel():
    table = ContingencyTable.from_label_maps(np.array([[1]]), np.array([[-1]]))
    assert clustering_scores(table) == ClusteringScores(0, 0, 0, 0)
