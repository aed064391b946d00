import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given

from sgbd.adjacency import border_pairs, bounding_box_pairs, checked_pairs
from tests.label_maps import label_maps


def test_border_pairs_do_not_count_corners() -> None:
    label_map = np.array([[0, 1], [2, 3]], np.int32)
    assert border_pairs(label_map).T.tolist() == [[0, 1], [0, 2], [1, 3], [2, 3]]


def test_one_region_has_no_pairs() -> None:
    label_map = np.zeros((3, 3), np.int32)
    assert border_pairs(label_map).shape == (2, 0)
    assert bounding_box_pairs(label_map).shape == (2, 0)


def test_bounding_boxes_touch_where_regions_do_not() -> None:
    label_map = np.array([[0, 0, 0], [0, 1, 2], [0, 1, 1]], np.int32)
    assert border_pairs(label_map).T.tolist() == [[0, 1], [0, 2], [1, 2]]
    label_map = np.array([[0, 0, 0, 3], [0, 1, 2, 3], [0, 1, 2, 3]], np.int32)
    assert [0, 3] in bounding_box_pairs(label_map).T.tolist()
    assert [1, 3] not in bounding_box_pairs(label_map).T.tolist()


@given(label_maps())
def test_bounding_box_pairs_against_explicit_boxes(label_map: npt.NDArray[np.int32]) -> None:
    boxes = []
    for region in range(label_map.max() + 1):
        rows, columns = np.nonzero(label_map == region)
        boxes.append((rows.min(), rows.max(), columns.min(), columns.max()))
    expected = [
        [i, j]
        for i in range(len(boxes))
        for j in range(i + 1, len(boxes))
        if boxes[i][0] <= boxes[j][1] + 1
        and boxes[j][0] <= boxes[i][1] + 1
        and boxes[i][2] <= boxes[j][3] + 1
        and boxes[j][2] <= boxes[i][3] + 1
    ]
    pairs = bounding_box_pairs(label_map).T.tolist()
    assert pairs == expected
    # Every true neighbour is among them.
    assert all(pair in pairs for pair in border_pairs(label_map).T.tolist())


@pytest.mark.parametrize(
    ("found", "message"),
    [
        ([[1, 2], [0, 1]], r"superpixels 0 to 2 with i < j; got \(1, 0\)"),
        ([[0, 1], [1, 1]], r"got \(1, 1\)"),
        ([[0, 1], [1, 3]], r"got \(1, 3\)"),
        ([[-1], [1]], r"got \(-1, 1\)"),
        ([[0, 0, 1], [1, 1, 2]], r"every pair once; got \(0, 1\) several times"),
        ([[0, 1], [1, 2], [0, 2]], r"shape \[2, E\]; got int64 of shape \[3, 2\]"),
        ([[0.0], [1.0]], r"got float64 of shape \[2, 1\]"),
    ],
)
def test_wrong_pairs_of_a_users_adjacency_are_refused(found: list[list[int]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        checked_pairs(found, 3)


def test_right_pairs_of_a_users_adjacency_are_int64_in_their_order() -> None:
    pairs = checked_pairs(np.array([[1, 0], [2, 2]], np.int32), 3)
    assert pairs.dtype == np.int64
    assert pairs.tolist() == [[1, 0], [2, 2]]
    assert checked_pairs(np.zeros((2, 0)), 3).dtype == np.int64
