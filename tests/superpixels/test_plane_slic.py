import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.frame import Frame
from sgbd.superpixels import FastSlic, PlaneSlic, Slic, plane_slic, slic_fast
from tests.label_maps import frames, is_superpixel_map, shapes
from tests.superpixels.made_up import made_up_frame, quality


@given(
    shapes(40).flatmap(frames),
    st.sampled_from([1, 2, 5, 40, 5000]),
    st.sampled_from([1, 7, 5000]),
    st.sampled_from([0, 1, 4, 25]),
    st.sampled_from([0.0, 100.0]),
)
@settings(max_examples=60, deadline=None)
def test_superpixels_are_connected_numbered_and_large_enough(
    frame: Frame, n_segments: int, n_cells: int, min_size: int, tolerance: float
) -> None:
    label_map = PlaneSlic(n_segments, n_cells=n_cells, min_size=min_size, tolerance=tolerance)(frame)
    sizes = np.bincount(label_map.ravel())
    assert label_map.dtype == np.int32
    assert label_map.shape == frame.depth.shape
    assert is_superpixel_map(label_map)
    assert len(sizes) <= n_segments
    assert len(sizes) == 1 or sizes.min() >= min_size


@given(shapes(40).flatmap(frames), st.integers(2, 5), st.sampled_from([0.0, 1.0]))
@settings(max_examples=30, deadline=None)
def test_threads_change_nothing(frame: Frame, threads: int, rgb_sigma: float) -> None:
    one = PlaneSlic(30, n_cells=60, rgb_sigma=rgb_sigma, min_size=4, threads=1)(frame)
    many = PlaneSlic(30, n_cells=60, rgb_sigma=rgb_sigma, min_size=4, threads=threads)(frame)
    np.testing.assert_array_equal(one, many)


def test_memory_that_is_used_again_changes_nothing() -> None:
    superpixels, other = PlaneSlic(60, n_cells=300), FastSlic(60)
    expected = [superpixels(made_up_frame(seed)) for seed in (0, 1)]
    small = Frame(np.zeros((5, 7, 3), np.uint8), np.ones((5, 7), np.float32))
    for _ in range(2):
        superpixels(small)
        other(made_up_frame(2))
        again = [superpixels(made_up_frame(seed)) for seed in (0, 1)]
        np.testing.assert_array_equal(again, expected)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(superpixels))(made_up_frame(0)), expected[0])


def _room(height: int = 120, width: int = 160) -> tuple[np.ndarray, np.ndarray]:
    """Return a slanted floor below a wall that faces the camera; they meet in row 60 at two metres."""
    row = np.mgrid[:height, :width][0]
    inverse = np.where(row < height // 2, 0.5, 0.5 + 0.01 * (row - height // 2))
    return (1 / inverse).astype(np.float32), row


def test_a_surface_is_one_superpixel_however_it_slants() -> None:
    depth, row = _room()
    label_map = PlaneSlic(50, n_cells=100)(Frame(np.full((120, 160, 3), 90, np.uint8), depth))
    assert label_map.max() == 1
    # There is no depth step at the crease; it is found except for pixels that fit both planes equally well.
    np.testing.assert_array_equal(label_map[row < 58], 0)
    np.testing.assert_array_equal(label_map[row > 62], 1)


def test_colours_cut_a_surface() -> None:
    depth, _ = _room()
    rgb = np.full((120, 160, 3), 90, np.uint8)
    rgb[80:100, 40:80] = (30, 160, 60)
    label_map = PlaneSlic(50, n_cells=100)(Frame(rgb, depth))
    inside = np.zeros(label_map.shape, bool)
    inside[82:98, 42:78] = True
    outside = np.ones(label_map.shape, bool)
    outside[78:102, 38:82] = False
    assert not set(label_map[inside]) & set(label_map[outside])


def test_noise_that_grows_with_depth_makes_no_superpixels() -> None:
    depth, _ = _room()
    # Disparity in eighths of a pixel, as in the first Kinect: depth steps of 4 mm at one metre, 17 mm at two.
    disparity = np.random.default_rng(0).normal(40 / depth, 0.05)
    noisy = (40 / (np.round(disparity * 8) / 8)).astype(np.float32)
    assert PlaneSlic(50, n_cells=100)(Frame(np.full((120, 160, 3), 90, np.uint8), noisy)).max() == 1


def test_missing_depth_alone_is_no_border() -> None:
    depth, _ = _room()
    depth[70:100, 40:80] = 0
    assert PlaneSlic(50, n_cells=100)(Frame(np.full((120, 160, 3), 90, np.uint8), depth)).max() == 1


def test_without_tolerance_there_are_as_many_superpixels_as_asked_for() -> None:
    frame = made_up_frame(0)
    assert PlaneSlic(77, n_cells=400, min_size=0, tolerance=0)(frame).max() == 76
    assert PlaneSlic(77, n_cells=400, min_size=0, tolerance=1e9)(frame).max() == 0


def test_superpixels_are_better_than_slic_with_half_as_many() -> None:
    of = [made_up_frame(seed) for seed in range(8)]
    reference = np.mean([quality(Slic(100)(frame), frame) for frame in of], axis=0)
    ours = np.mean([quality(PlaneSlic(90, n_cells=800, tolerance=0)(frame), frame) for frame in of], axis=0)
    assert ours[0] < 0.5 * reference[0]
    # Boundary recall, undersegmentation error, achievable segmentation accuracy.
    assert (ours[3:] > reference[3:]).all(), f"{ours}, scikit-image {reference}"


def test_without_numba_scikit_image_steps_in_and_says_so(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(plane_slic, "HAS_NUMBA", False)
    slic_fast.say_that_numba_is_missing.cache_clear()
    frame = made_up_frame(0)
    np.testing.assert_array_equal(PlaneSlic(90)(frame), Slic(30)(frame))
    assert "pip install numba" in caplog.text
    slic_fast.say_that_numba_is_missing.cache_clear()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_segments": 0}, "n_segments=0"),
        ({"n_cells": 0}, "n_cells=0"),
        ({"subsample": 0}, "subsample=0"),
        ({"threads": 0}, "threads=0"),
        ({"compactness": 0}, "compactness=0"),
        ({"depth_noise": -1.0}, "depth_noise=-1.0"),
        ({"tolerance": -1.0}, "tolerance=-1.0"),
        ({"iterations": -1}, "iterations=-1"),
        ({"min_size": -1}, "min_size=-1"),
    ],
)
def test_options_out_of_range_are_told(options: dict[str, int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PlaneSlic(**options)  # type: ignore[arg-type]
