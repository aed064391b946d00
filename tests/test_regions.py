from collections.abc import Callable
from typing import Any

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
    sums = regions.region_sums(frame, label_map).sums
    # Pixel (0, 0) at depth 2 has X = (0 - 1) / 2 * 2 = -1; pixel (0, 2) at depth 4 has X = (2 - 1) / 2 * 4 = 2.
    assert sums[0].tolist() == [2, 30, 0, 2, 500, 0, 4, 0, 1, 1, -1, 0, 2, 1, 0, -2, 0, 0, 4]
    assert sums[1].tolist() == [1, 0, 5, 0, 0, 25, 0, 0, 2, 1, 2, 0, 4, 4, 0, 8, 0, 0, 16]


def test_sums_over_one_border() -> None:
    label_map = np.array([[0, 1], [0, 1], [0, 1]], np.int32)
    rgb = np.zeros((3, 2, 3), np.uint8)
    rgb[0, 1] = (3, 4, 0)
    depth = np.array([[1.0, 1.5], [1.0, 1.25], [0.0, 1.0]], np.float32)
    borders = regions.border_sums(Frame(rgb, depth), label_map)
    assert borders.pairs.tolist() == [[0], [1]]
    assert borders.sums.tolist() == [[3, 5, 2, 0.75, 0.25]]


@pytest.mark.skipif(not regions.HAS_NUMBA, reason="numba is not installed: there are no compiled loops to test")
@given(label_maps(), st.data())
def test_compiled_region_sums_equal_numpy(label_map: npt.NDArray[np.int32], data: st.DataObject) -> None:
    frame, count = _frame_of(label_map, data), int(label_map.max()) + 1
    fast: Callable[..., Any] = regions._sum_regions_compiled
    np.testing.assert_allclose(
        fast(label_map, frame.rgb, frame.depth, CAMERA, count),
        regions.sum_regions_numpy(label_map, frame.rgb, frame.depth, CAMERA, count),
        rtol=1e-9,
        atol=1e-9,
    )


@pytest.mark.skipif(not regions.HAS_NUMBA, reason="numba is not installed: there are no compiled loops to test")
@given(label_maps(), st.data())
def test_compiled_border_sums_equal_numpy(label_map: npt.NDArray[np.int32], data: st.DataObject) -> None:
    frame, count = _frame_of(label_map, data), int(label_map.max()) + 1
    fast: Callable[..., Any] = regions._sum_borders_compiled
    keys, sums = fast(label_map, frame.rgb, frame.depth, count)
    order = np.argsort(keys)
    expected_keys, expected_sums = regions.sum_borders_numpy(label_map, frame.rgb, frame.depth, count)
    assert keys[order].tolist() == expected_keys.tolist()
    np.testing.assert_allclose(sums[order], expected_sums, rtol=1e-9, atol=1e-9)


def test_the_hash_table_of_borders_grows() -> None:
    # Ids scattered over the map: 40 "regions" with 780 pairs, far more than the table starts with.
    rng = np.random.default_rng(0)
    scattered = rng.integers(0, 40, (60, 60)).astype(np.int32)
    frame = Frame(rng.integers(0, 256, (60, 60, 3), dtype=np.uint8), np.ones((60, 60), np.float32))
    borders = regions.border_sums(frame, scattered)
    keys, sums = regions.sum_borders_numpy(scattered, frame.rgb, frame.depth, 40)
    assert len(keys) == 780
    assert (borders.pairs[0] * 40 + borders.pairs[1]).tolist() == keys.tolist()
    np.testing.assert_allclose(borders.sums, sums)
