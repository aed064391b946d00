import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sgbd.superpixels import fragments
from sgbd.superpixels.connect import connected_regions, intersect, merge_fragments
from sgbd.superpixels.fragments import connected_superpixels
from tests.label_maps import shapes


@given(shapes(24).flatmap(lambda shape: st.tuples(*[hnp.arrays(np.int32, shape, elements=st.integers(0, 2))] * 2)))
def test_without_merging_the_pieces_are_the_connected_regions(
    pair: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]],
) -> None:
    expected = connected_regions(intersect(*pair))
    assert connected_superpixels(*pair, 1).tolist() == expected.tolist()


@given(
    shapes(24).flatmap(lambda shape: st.tuples(*[hnp.arrays(np.int32, shape, elements=st.integers(0, 2))] * 2)),
    st.integers(0, 60),
    st.integers(1, 5),
)
def test_merging_is_that_of_merge_fragments_whatever_the_threads(
    pair: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]], min_size: int, threads: int
) -> None:
    expected = merge_fragments(connected_regions(intersect(*pair)), min_size)
    assert connected_superpixels(*pair, min_size, threads).tolist() == expected.tolist()


@pytest.mark.parametrize("min_size", [1, 6])
@pytest.mark.parametrize("threads", [1, 2])
def test_room_grows_with_the_pieces(min_size: int, threads: int) -> None:
    # One piece per pixel: four times the initial capacity.
    board = (np.indices((64, 4 * fragments.FEW_PIECES // 64)).sum(0) % 2).astype(np.int32)
    expected = merge_fragments(connected_regions(board), min_size)
    assert connected_superpixels(board, board, min_size, threads).tolist() == expected.tolist()


def test_without_numba_the_steps_are_taken_one_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = tuple(np.random.default_rng(0).integers(0, 3, (2, 30, 40)).astype(np.int32))
    compiled = connected_superpixels(*pair, 12)
    monkeypatch.setattr(fragments, "HAS_NUMBA", False)
    monkeypatch.setattr(fragments, "_find_pieces", None)
    assert connected_superpixels(*pair, 12).tolist() == compiled.tolist()


def test_one_map_alone_is_its_intersection_with_itself() -> None:
    label_map = np.array([[0, 0, 1], [0, 1, 1], [1, 0, 0]], np.int32)
    assert connected_superpixels(label_map, label_map, 1).tolist() == [[0, 0, 1], [0, 1, 1], [2, 3, 3]]


@pytest.mark.parametrize("threads", [1, 2, 3, 4])
def test_arms_that_meet_far_below_are_one_region(threads: int) -> None:
    comb = np.array([[1, 0, 1, 0, 1], [1, 0, 1, 0, 1], [1, 1, 1, 1, 1]], np.int32)
    assert connected_superpixels(comb, comb, 1, threads).tolist() == [[0, 1, 0, 2, 0], [0, 1, 0, 2, 0], [0, 0, 0, 0, 0]]
