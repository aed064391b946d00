from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from sgbd.frame import Frame
from sgbd.superpixels.slic import Slic, filled_depth, scaled_depth, stretch
from tests.label_maps import is_superpixel_map


def _two_halves(rgb_differs: bool, depth_differs: bool) -> Frame:
    rgb = np.full((48, 64, 3), 120, np.uint8)
    depth = np.full((48, 64), 1.0, np.float32)
    if rgb_differs:
        rgb[:, 32:] = (220, 30, 30)
    if depth_differs:
        depth[24:] = 1.5
    return Frame(rgb, depth)


@pytest.mark.parametrize(("rgb", "depth"), [(True, False), (False, True), (True, True)])
def test_superpixels_are_connected_numbered_and_respect_edges(rgb: bool, depth: bool) -> None:
    label_map = Slic(12, rgb=rgb, depth=depth, min_size=8)(_two_halves(rgb, depth))
    assert label_map.dtype == np.int32
    assert is_superpixel_map(label_map)
    assert np.bincount(label_map.ravel()).min() >= 8
    if rgb:
        assert not set(label_map[:, :32].ravel()) & set(label_map[:, 32:].ravel())
    if depth:
        assert not set(label_map[:24].ravel()) & set(label_map[24:].ravel())


def test_a_constant_frame_is_cut_into_a_grid() -> None:
    label_map = Slic(16)(_two_halves(False, False))
    assert is_superpixel_map(label_map)
    assert 9 <= label_map.max() + 1 <= 32


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 1), (3, 3)])
def test_a_frame_with_fewer_pixels_than_superpixels(shape: tuple[int, int]) -> None:
    frame = Frame(np.zeros((*shape, 3), np.uint8), np.ones(shape, np.float32))
    label_map = Slic(128, min_size=1)(frame)
    assert label_map.shape == shape
    assert is_superpixel_map(label_map)


def test_holes_are_filled_from_the_nearest_pixel_of_the_row() -> None:
    depth = np.array([[0, 1, 0, 0, 2, 0], [0, 0, 0, 0, 0, 0], [3, 0, 0, 0, 0, 4]], np.float32)
    assert filled_depth(depth).tolist() == [[1, 1, 1, 2, 2, 2], [1, 1, 1, 2, 2, 2], [3, 3, 3, 4, 4, 4]]


def test_depth_is_clipped_at_its_98th_percentile_and_stretched() -> None:
    depth = np.full((10, 10), 2.0, np.float32)
    depth[0] = 1.0
    depth[9, 9] = 100.0
    scaled = scaled_depth(depth)
    assert scaled.min() == 0.0
    assert scaled[9, 9] == 1.0
    assert scaled[5, 5] == pytest.approx(1.0, abs=1e-6)


def test_stretch_of_equal_values_is_zero() -> None:
    assert stretch(np.full((2, 2), 7.0, np.float32)).tolist() == [[0, 0], [0, 0]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rgb": False, "depth": False}, "nothing to over-segment by"),
        ({"n_segments": 0}, "n_segments must be at least 1"),
        ({"depth_compactness": 0.0}, "compactness must be positive"),
    ],
)
def test_impossible_settings_are_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Slic(**arguments)  # type: ignore[arg-type]


def test_a_real_frame(shared_data: Path) -> None:
    folder = shared_data / "mosd_learn"
    frame = Frame(iio.imread(folder / "learn20_rgb.png"), iio.imread(folder / "learn20_depth.png"))
    label_map = Slic(128)(frame)
    assert 250 <= label_map.max() + 1 <= 700
    assert np.bincount(label_map.ravel()).min() >= 25
    assert (label_map == Slic(128)(frame)).all()
