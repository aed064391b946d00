import numpy as np
import numpy.typing as npt
from hypothesis import given
from hypothesis import strategies as st

from sgbd.adjacency import border_lengths
from sgbd.superpixels.connect import connected_regions, intersect, merge_fragments, renumber
from tests.label_maps import is_superpixel_map, label_maps


def test_intersect_keeps_pixels_together_that_are_together_in_both() -> None:
    first = np.array([[0, 0, 1], [0, 0, 1]])
    second = np.array([[0, 1, 1], [0, 1, 1]])
    combined = intersect(first, second)
    assert renumber(combined).tolist() == [[0, 1, 2], [0, 1, 2]]


def test_connected_regions_tells_diagonal_neighbours_apart() -> None:
    labels = np.array([[0, 1], [1, 0]])
    assert connected_regions(labels).tolist() == [[0, 1], [2, 3]]


def test_connected_regions_keeps_connected_labels_whole() -> None:
    labels = np.array([[5, 5, 7], [5, 7, 7], [5, 5, 5]])
    assert connected_regions(labels).tolist() == [[0, 0, 1], [0, 1, 1], [0, 0, 0]]


def test_a_fragment_goes_to_the_neighbour_with_the_longest_border() -> None:
    label_map = np.array(
        [
            [0, 0, 0, 1, 1],
            [0, 0, 2, 1, 1],
            [0, 0, 2, 1, 1],
            [0, 0, 0, 1, 1],
        ],
        np.int32,
    )
    # Region 2 shares four pixel sides with region 0 and two with region 1.
    assert merge_fragments(label_map, 3).tolist() == [[0, 0, 0, 1, 1]] * 4


def test_equal_borders_go_to_the_larger_neighbour() -> None:
    label_map = np.array([[0, 0, 1, 2, 2, 2]], np.int32)
    assert merge_fragments(label_map, 2).tolist() == [[0, 0, 1, 1, 1, 1]]


def test_fragments_alone_grow_together_until_they_are_large_enough() -> None:
    label_map = np.arange(12, dtype=np.int32).reshape(3, 4)
    merged = merge_fragments(label_map, 4)
    assert np.bincount(merged.ravel()).min() >= 4
    assert is_superpixel_map(merged)


def test_a_frame_smaller_than_the_fragment_size_is_one_region() -> None:
    assert merge_fragments(np.array([[0, 1]], np.int32), 100).tolist() == [[0, 0]]


@given(label_maps(), st.integers(0, 10))
def test_merging_keeps_regions_connected_numbered_and_large_enough(
    label_map: npt.NDArray[np.int32], min_size: int
) -> None:
    merged = merge_fragments(label_map, min_size)
    sizes = np.bincount(merged.ravel())
    assert is_superpixel_map(merged)
    assert len(sizes) == 1 or sizes.min() >= min_size
    # Merging never splits a region.
    for region in range(label_map.max() + 1):
        assert len(np.unique(merged[label_map == region])) == 1


@given(label_maps())
def test_renumber_follows_the_first_pixels(label_map: npt.NDArray[np.int32]) -> None:
    shuffled = (label_map * 7 + 3) % 1009
    order: dict[int, int] = {}
    expected = [order.setdefault(int(value), len(order)) for value in shuffled.ravel()]
    assert renumber(shuffled).ravel().tolist() == expected


@given(label_maps())
def test_border_lengths_count_pixel_sides(label_map: npt.NDArray[np.int32]) -> None:
    counted: dict[tuple[int, int], int] = {}
    height, width = label_map.shape
    for row, column in np.ndindex(height, width):
        for other in ((row + 1, column), (row, column + 1)):
            if other[0] < height and other[1] < width and label_map[row, column] != label_map[other]:
                pair = tuple(sorted((int(label_map[row, column]), int(label_map[other]))))
                counted[pair] = counted.get(pair, 0) + 1  # type: ignore[index]
    pairs, lengths = border_lengths(label_map)
    assert [tuple(pair) for pair in pairs.T.tolist()] == sorted(counted)
    assert lengths.tolist() == [counted[pair] for pair in sorted(counted)]


def test_many_superpixels_have_many_intersections() -> None:
    # The product of the two numbers of ids does not fit into 32 bits.
    first, second = np.array([[0, 99_999, 99_999]]), np.array([[0, 99_999, 0]])
    combined = intersect(first, second)
    assert len(np.unique(combined)) == 3
    assert combined.min() >= 0
