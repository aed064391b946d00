import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sgbd import regions
from sgbd.frame import Frame, Intrinsics
from tests.label_maps import frames, label_maps

CAMERA = np.array([50.0, 60.0, 3.0, 2.0])


def _frame_of(label_map: npt.NDArray[np.int32], data: st.DataObject) -> Frame:
    return data.draw(frames(label_map.shape))


def test_sums_over_two_regions() -> None:
    label_map = np.array([[0, 0, 1]], np.int32)
    rgb = np.array([[[10, 0, 0], [20, 0, 2], [0, 5, 0]]], np.uint8)
    frame = Frame(rgb, np.array([[2.0, 0.0, 4.0]], np.float32), Intrinsics(2.0, 2.0, 1.0, 0.0))
    found, _ = regions.region_and_border_sums(frame, label_map)
    # Pixel (0, 0) at depth 2 has X = (0 - 1) / 2 * 2 = -1; pixel (0, 2) at depth 4 has X = (2 - 1) / 2 * 4 = 2.
    assert found.sums[0].tolist() == [2, 30, 0, 2, 500, 0, 4, 0, 1, 1, -1, 0, 2, 1, 0, -2, 0, 0, 4]
    assert found.sums[1].tolist() == [1, 0, 5, 0, 0, 25, 0, 0, 2, 1, 2, 0, 4, 4, 0, 8, 0, 0, 16]
    assert (found.nearest, found.farthest) == (2, 4)


def test_sums_over_one_border() -> None:
    label_map = np.array([[0, 1], [0, 1], [0, 1]], np.int32)
    rgb = np.zeros((3, 2, 3), np.uint8)
    rgb[0, 1] = (3, 4, 0)
    depth = np.array([[1.0, 1.5], [1.0, 1.25], [0.0, 1.0]], np.float32)
    _, borders = regions.region_and_border_sums(Frame(rgb, depth), label_map)
    assert borders.pairs.tolist() == [[0], [1]]
    assert borders.sums.tolist() == [[3, 5, 2, 0.75, 0.25]]


@pytest.mark.skipif(not regions.HAS_NUMBA, reason="numba is not installed: there are no compiled loops to test")
@given(label_maps(), st.data())
def test_compiled_sums_equal_numpy(label_map: npt.NDArray[np.int32], data: st.DataObject) -> None:
    frame, count = _frame_of(label_map, data), int(label_map.max()) + 1
    with pytest.MonkeyPatch.context() as patch:
        fast = regions._sums(label_map, frame.rgb, frame.depth, CAMERA, count)
        patch.setattr(regions, "HAS_NUMBA", False)
        sums, depth_range, keys, borders = regions._sums(label_map, frame.rgb, frame.depth, CAMERA, count)
    np.testing.assert_allclose(fast[0], sums, rtol=1e-9, atol=1e-9)
    assert fast[1] == depth_range
    order = np.argsort(fast[2])
    assert fast[2][order].tolist() == keys.tolist()
    np.testing.assert_allclose(fast[3][order], borders, rtol=1e-9, atol=1e-9)


@given(label_maps(), st.data())
def test_sums_of_segments_are_those_over_their_pixels(label_map: npt.NDArray[np.int32], data: st.DataObject) -> None:
    frame, count = _frame_of(label_map, data), int(label_map.max()) + 1
    named = data.draw(st.lists(st.integers(0, 3), min_size=count, max_size=count))
    segment = np.unique(named, return_inverse=True)[1].astype(np.int64)
    merged = regions.merged_sums(regions.region_and_border_sums(frame, label_map), segment)
    expected = regions.region_and_border_sums(frame, segment[label_map].astype(np.int32))
    np.testing.assert_allclose(merged[0].sums, expected[0].sums, rtol=1e-9, atol=1e-9)
    assert (merged[0].nearest, merged[0].farthest) == (expected[0].nearest, expected[0].farthest)
    assert merged[1].pairs.tolist() == expected[1].pairs.tolist()
    np.testing.assert_allclose(merged[1].sums, expected[1].sums, rtol=1e-9, atol=1e-9)


def test_more_borders_than_connected_regions_can_have() -> None:
    # Randomly scattered ids: 40 "regions" with 780 pairs, more than the initial capacity of the table.
    rng = np.random.default_rng(0)
    scattered = rng.integers(0, 40, (60, 60)).astype(np.int32)
    frame = Frame(rng.integers(0, 256, (60, 60, 3), dtype=np.uint8), np.ones((60, 60), np.float32))
    _, borders = regions.region_and_border_sums(frame, scattered)
    keys, sums = regions.sum_borders_numpy(scattered, frame.rgb, frame.depth, 40)
    assert len(keys) == 780
    assert (borders.pairs[0] * 40 + borders.pairs[1]).tolist() == keys.tolist()
    np.testing.assert_allclose(borders.sums, sums)
