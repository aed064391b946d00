from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from sgbd.metrics import ContingencyTable

SHAPES = array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=9)


def overlaps(superpixels: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return superpixel, instance and number of pixels of each overlap, including ignored pixels."""
    pairs, count = np.unique(np.stack([superpixels.ravel(), truth.ravel()]), axis=1, return_counts=True)
    return pairs[0], pairs[1], count


def test_counts_of_a_small_frame():
    prediction = np.array([[0, 0, 7], [0, 7, 7]])
    truth = np.array([[0, 2, 2], [-1, 2, 3]])
    table = ContingencyTable.from_label_maps(prediction, truth)
    assert table.segments.tolist() == [0, 7]
    assert table.instances.tolist() == [0, 2, 3]
    assert table.counts.tolist() == [[1, 1, 0], [0, 2, 1]]
    assert table.segment_area.tolist() == [2, 3]
    assert table.instance_area.tolist() == [1, 3, 1]
    assert table.total == 5


def test_segments_and_instances_in_ignored_pixels_vanish():
    table = ContingencyTable.from_label_maps(np.array([[3, 4]]), np.array([[-1, 2]]))
    assert table.segments.tolist() == [4]
    nothing = ContingencyTable.from_label_maps(np.array([[3, 4]]), np.array([[-1, -1]]))
    assert nothing.counts.shape == (0, 0)
    assert nothing.total == 0


@given(st.data(), SHAPES)
@settings(max_examples=80, deadline=None)
def test_every_count_is_that_of_two_masks(data: st.DataObject, shape: tuple[int, int]):
    # Sparse labels take a different code path than dense ones.
    names = np.array(data.draw(st.sampled_from([[0, 1, 2, 5], [0, 3, 1 << 22, 1 << 30]])))
    prediction = names[data.draw(arrays(np.int64, shape, elements=st.integers(0, 3)))]
    truth = data.draw(arrays(np.int16, shape, elements=st.integers(-1, 4)))
    table = ContingencyTable.from_label_maps(prediction, truth)
    assert table.segments.tolist() == sorted(set(prediction[truth >= 0].tolist()))
    assert table.instances.tolist() == sorted(set(truth[truth >= 0].tolist()))
    for s, segment in enumerate(table.segments):
        for t, instance in enumerate(table.instances):
            assert table.counts[s, t] == ((prediction == segment) & (truth == instance)).sum()


@given(st.data(), SHAPES)
@settings(max_examples=80, deadline=None)
def test_superpixels_give_the_table_of_the_painted_map(data: st.DataObject, shape: tuple[int, int]):
    superpixels = data.draw(arrays(np.int32, shape, elements=st.integers(0, 9)))
    truth = data.draw(arrays(np.int32, shape, elements=st.integers(-1, 4)))
    segment = data.draw(arrays(np.int64, 10, elements=st.integers(0, 3)))
    from_superpixels = ContingencyTable.from_superpixels(*overlaps(superpixels, truth), segment)
    from_maps = ContingencyTable.from_label_maps(segment[superpixels], truth)
    assert from_superpixels.segments.tolist() == from_maps.segments.tolist()
    assert from_superpixels.instances.tolist() == from_maps.instances.tolist()
    assert from_superpixels.counts.tolist() == from_maps.counts.tolist()
    assert from_superpixels.counts.dtype == from_maps.counts.dtype == np.int64


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int64, np.uint64])
def test_any_integer_type(dtype: type):
    labels = np.array([[0, 200]], dtype=dtype)
    assert ContingencyTable.from_label_maps(labels, labels).counts.tolist() == [[1, 0], [0, 1]]


@pytest.mark.parametrize(
    ("prediction", "truth", "message"),
    [
        (np.zeros((2, 2)), np.zeros((2, 2), int), "prediction must be an integer label map"),
        (np.zeros(4, int), np.zeros((2, 2), int), "prediction must be an integer label map"),
        (np.zeros((2, 3), int), np.zeros((2, 2), int), "one shape"),
        (np.full((2, 2), -1), np.zeros((2, 2), int), "prediction must be at least 0"),
        (np.zeros((2, 2), int), np.full((2, 2), -2), "truth must be at least -1"),
    ],
)
def test_what_is_no_pair_of_label_maps(prediction, truth, message):
    with pytest.raises(ValueError, match=message):
        ContingencyTable.from_label_maps(prediction, truth)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0, 1], [0], [1], [0, 0]), "one length"),
        (([0, 2], [0, 0], [1, 1], [0, 0]), "one over-segmentation"),
        (([0, 1], [0, 0], [1, 1], [0, -1]), "must not be negative"),
    ],
)
def test_what_is_no_overlap_of_superpixels(arguments, message):
    with pytest.raises(ValueError, match=message):
        ContingencyTable.from_superpixels(*arguments)
