from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy import ndimage

from sgbd.metrics import ContingencyTable, boundary_scores, contours, match_contours, match_objects
from sgbd.metrics.boundary import matching_radius


def contour_of_mask(mask: np.ndarray) -> np.ndarray:
    """Return the mask pixels with a 4-neighbour in the complement's component that contains the image frame."""
    framed = np.pad(mask, 1)
    component, _ = ndimage.label(~framed)
    outside = component == component[0, 0]
    return (ndimage.binary_dilation(outside) & framed)[1:-1, 1:-1]


def near(mask: np.ndarray, radius: int) -> np.ndarray:
    if not mask.any():
        return np.zeros_like(mask)
    return ndimage.distance_transform_edt(~mask) <= radius


def blobs(seed: int, shape: tuple[int, int], lowest: int) -> np.ndarray:
    """Return a label map of ragged regions with holes and islands."""
    noise = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=shape), 1.5)
    return np.digitize(noise, np.quantile(noise, [0.15, 0.5, 0.7, 0.85])) + lowest


def test_a_square_with_a_hole_and_an_island():
    labels = np.zeros((9, 9), dtype=int)
    labels[1:8, 1:8] = 2
    labels[3:6, 3:6] = 0
    labels[4, 4] = 2  # an island in the hole
    expected = np.full((9, 9), -1)
    expected[1:8, 1:8] = 0
    expected[2:7, 2:7] = -1
    assert (contours(labels, [2]).index == expected).all()


def test_a_mask_that_touches_the_image_edge_follows_it():
    assert (contours(np.full((3, 4), 5), [5]).index == [[0, 0, 0, 0], [0, -1, -1, 0], [0, 0, 0, 0]]).all()
    assert contours(np.array([[5]]), [5]).index.tolist() == [[0]]


def test_the_outside_flows_between_four_neighbours_only():
    # The corner is open only diagonally, which does not connect it to the outside.
    labels = np.array([[0, 2, 2, 2], [2, 0, 2, 2], [2, 2, 2, 2], [2, 2, 2, 2]])
    got = contours(labels, [2]).index
    assert got[2, 2] == -1
    assert got[1, 2] == got[2, 1] == -1


@given(arrays(np.int8, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.integers(-1, 3)))
@settings(max_examples=150, deadline=None)
def test_contours_are_those_of_each_mask(labels: np.ndarray):
    expected = np.full(labels.shape, -1)
    for k, label in enumerate([2, 0, 3, 9]):
        expected[contour_of_mask(labels == label)] = k
    assert (contours(labels, [2, 0, 3, 9]).index == expected).all()


@given(st.integers(0, 999), st.integers(0, 999), st.integers(4, 40), st.integers(4, 40), st.booleans())
@settings(max_examples=40, deadline=None)
def test_scores_against_masks(seed: int, other: int, height: int, width: int, ignoring: bool):
    truth, prediction = blobs(seed, (height, width), -1 if ignoring else 0), blobs(other, (height, width), 0)
    matching = match_objects(ContingencyTable.from_label_maps(prediction, truth))
    radius = matching_radius(height, width)
    cleared = np.where(truth == -1, 0, prediction)
    predicted = {k: contour_of_mask(cleared == k) for k in matching.predicted_objects}
    true = {k: contour_of_mask(truth == k) for k in matching.true_objects}
    pairs = list(zip(matching.segment, matching.instance, strict=True))
    predicted_right = sum((predicted[s] & near(true[t], radius)).sum() for s, t in pairs)
    true_found = sum((true[t] & near(predicted[s], radius)).sum() for s, t in pairs)

    match = match_contours(prediction, truth, matching)
    assert match.predicted_length.tolist() == [contour.sum() for contour in predicted.values()]
    assert match.true_length.tolist() == [contour.sum() for contour in true.values()]
    assert match.predicted_matched.sum() == predicted_right
    assert match.true_matched.sum() == true_found
    scores = boundary_scores(prediction, truth, matching)
    if predicted:
        assert scores.precision == predicted_right / match.predicted_length.sum()
    if true:
        assert scores.recall == true_found / match.true_length.sum()


@pytest.mark.parametrize(("shift", "predicted_missed", "true_missed"), [(0, 0, 0), (3, 0, 0), (4, 472, 480)])
def test_contours_match_up_to_three_pixels_in_a_vga_frame(shift: int, predicted_missed: int, true_missed: int):
    truth = np.zeros((480, 640), dtype=np.int32)
    truth[:, 320:] = 2
    prediction = np.zeros((480, 640), dtype=np.int32)
    prediction[:, 320 + shift :] = 2
    match = match_contours(prediction, truth, match_objects(ContingencyTable.from_label_maps(prediction, truth)))
    assert match.true_length.tolist() == [2 * 320 + 2 * 478]
    assert match.predicted_length.tolist() == [2 * (320 - shift) + 2 * 478]
    # The left sides are four pixels apart and do not match; the ends of the predicted one match true top and bottom.
    assert match.true_length - match.true_matched == true_missed
    assert match.predicted_length - match.predicted_matched == predicted_missed


@pytest.mark.parametrize(("height", "width", "radius"), [(480, 640, 3), (120, 160, 1), (720, 1280, 5), (1, 1, 1)])
def test_radius(height: int, width: int, radius: int):
    assert matching_radius(height, width) == radius


@given(st.integers(0, 999), st.integers(0, 999), st.integers(0, 999))
@settings(max_examples=25, deadline=None)
def test_what_is_predicted_on_ignored_pixels_changes_nothing(seed: int, other: int, noise: int):
    truth, prediction = blobs(seed, (20, 25), -1), blobs(other, (20, 25), 0)
    changed = np.where(truth == -1, np.random.default_rng(noise).integers(0, 9, truth.shape), prediction)
    scores = [
        boundary_scores(p, truth, match_objects(ContingencyTable.from_label_maps(p, truth)))
        for p in (prediction, changed)
    ]
    assert scores[0] == scores[1]


def test_maps_of_different_shape():
    labels = np.zeros((2, 2), dtype=int)
    matching = match_objects(ContingencyTable.from_label_maps(labels, labels))
    with pytest.raises(ValueError, match="one shape"):
        boundary_scores(labels, np.zeros((2, 3), dtype=int), matching)


@given(st.integers(0, 999), st.integers(0, 999), st.booleans())
@settings(max_examples=30, deadline=None)
def test_contours_found_beforehand_match_like_the_maps(seed: int, other: int, ignoring: bool):
    truth, prediction = blobs(seed, (20, 30), -1 if ignoring else 0), blobs(other, (20, 30), 0)
    matching = match_objects(ContingencyTable.from_label_maps(prediction, truth))
    found = contours(prediction, [4, 3, 2, 1, 0], truth), contours(truth, [0, 4, 2, 3, 1])
    expected, match = match_contours(prediction, truth, matching), match_contours(*found, matching)
    for name in ("predicted_length", "predicted_matched", "true_length", "true_matched"):
        assert getattr(match, name).tolist() == getattr(expected, name).tolist()
    if len(matching.true_objects):
        with pytest.raises(ValueError, match="the contours of the truth lack the objects"):
            match_contours(found[0], contours(truth, []), matching)
