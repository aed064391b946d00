from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sgbd.metrics import (
    ContingencyTable,
    achievable_segmentation_accuracy,
    boundary_recall,
    explained_variation,
    undersegmentation_error,
)

LABELS = arrays(np.int64, (5, 6), elements=st.integers(0, 4))


def test_a_superpixel_that_leaks():
    # Superpixel 0 has three pixels of instance 0 and one of instance 1; superpixel 1 fits.
    table = ContingencyTable.from_label_maps(np.array([[0, 0, 0, 0, 1, 1]]), np.array([[0, 0, 0, 1, 1, 1]]))
    assert achievable_segmentation_accuracy(table) == 5 / 6
    assert undersegmentation_error(table) == 2 / 6  # one pixel too many for instance 0, one for instance 1


@given(LABELS, arrays(np.int64, (5, 6), elements=st.integers(-1, 3)))
@settings(deadline=None)
def test_against_masks(superpixels: np.ndarray, truth: np.ndarray):
    table = ContingencyTable.from_label_maps(superpixels, truth)
    known = truth >= 0
    if not known.any():
        assert achievable_segmentation_accuracy(table) == 1
        assert undersegmentation_error(table) == 0
        return
    right = leak = 0
    for s in np.unique(superpixels[known]):
        mask = known & (superpixels == s)
        inside = [(mask & (truth == t)).sum() for t in np.unique(truth[known])]
        right += max(inside)
        leak += sum(min(n, mask.sum() - n) for n in inside)
    assert achievable_segmentation_accuracy(table) == right / known.sum()
    assert undersegmentation_error(table) == leak / known.sum()


def test_boundary_recall_within_a_square():
    truth = np.zeros((10, 20), dtype=int)
    truth[:, 10:] = 2
    superpixels = np.zeros((10, 20), dtype=int)
    superpixels[:, 12:] = 1
    assert [boundary_recall(superpixels, truth, tolerance) for tolerance in (0, 1, 2)] == [0, 0, 1]
    superpixels[5:] = 0
    superpixels[5:, 10:] = 1
    assert boundary_recall(superpixels, truth, 0) == 0.5  # the lower half


def test_borders_of_ignored_pixels_are_no_borders():
    truth = np.array([[0, 0, -1, 2, 2, 3]])
    assert boundary_recall(np.array([[0, 0, 0, 0, 0, 1]]), truth, 0) == 1
    assert boundary_recall(np.zeros((1, 6), dtype=int), truth, 0) == 0
    assert boundary_recall(np.zeros((1, 3), dtype=int), np.array([[0, -1, 2]]), 0) == 1


@given(LABELS, arrays(np.float64, (5, 6, 3), elements=st.floats(0, 1, width=32)), arrays(bool, (5, 6)))
@settings(deadline=None)
def test_explained_variation_is_one_minus_the_unexplained(labels: np.ndarray, image: np.ndarray, valid: np.ndarray):
    values = image[valid]
    unexplained = sum(
        ((image[valid & (labels == k)] - image[valid & (labels == k)].mean(axis=0)) ** 2).sum()
        for k in np.unique(labels[valid])
    )
    total = ((values - values.mean(axis=0)) ** 2).sum() if len(values) else 0
    if total > 1e-6:
        assert explained_variation(labels, image, valid) == pytest.approx(1 - unexplained / total, abs=1e-9)


def test_explained_variation_of_extremes():
    image = np.array([[0.0, 0.0, 1.0, 1.0]])
    assert explained_variation(np.array([[0, 0, 7, 7]]), image) == 1
    assert explained_variation(np.array([[0, 1, 1, 0]]), image) == 0
    assert explained_variation(np.array([[0, 0, 0, 0]]), np.ones((1, 4))) == 1
    assert explained_variation(np.array([[0, 0, 0, 0]]), image, np.zeros((1, 4), dtype=bool)) == 1
