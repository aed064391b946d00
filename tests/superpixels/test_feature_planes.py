import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from skimage.color import rgb2lab

from sgbd.superpixels.feature_planes import (
    FARTHEST,
    gaussian_weights,
    lab_jobs,
    smoothing_jobs,
    unweighted,
    write_depth,
)


def _lab(rgb: np.ndarray) -> np.ndarray:
    planes = np.empty((3, *rgb.shape[:2]), np.float32)
    for job in lab_jobs(rgb, 1.0, planes, [(0, rgb.shape[0])]):
        job()
    return planes.transpose(1, 2, 0)


def _depth(depth: np.ndarray, percentile: int = 98) -> np.ndarray:
    planes = np.full((3, *depth.shape), np.nan, np.float32)
    write_depth(depth.astype(np.float32), percentile, np.float32(1), np.zeros(FARTHEST + 1, np.int32), planes)
    return planes


def _smooth(planes: np.ndarray, sigma: float) -> np.ndarray:
    smoothed = np.empty_like(planes)
    for job in smoothing_jobs(planes, gaussian_weights(sigma), smoothed, [(0, planes.shape[1])]):
        job()
    return smoothed


def test_lab_is_that_of_scikit_image() -> None:
    levels = np.array([0, 1, 5, 11, 40, 128, 200, 254, 255], np.uint8)
    rgb = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(27, 27, 3)
    # Error of one step of Halley's method: a fiftieth of the just noticeable difference.
    np.testing.assert_allclose(_lab(rgb), rgb2lab(rgb), atol=0.02)


def test_colours_are_stretched_to_the_full_range() -> None:
    rgb = np.random.default_rng(0).integers(40, 91, (13, 17, 3)).astype(np.uint8)
    rgb[0, 0], rgb[0, 1] = 40, 90
    np.testing.assert_allclose(_lab(rgb), rgb2lab((rgb - 40.0) / 50), atol=0.02)


def test_an_image_of_one_colour_is_black() -> None:
    assert np.abs(_lab(np.full((3, 5, 3), 77, np.uint8))).max() < 0.02


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (7, 2), (19, 23)])
@pytest.mark.parametrize("sigma", [0.01, 0.7, 1.0, 2.5])
def test_smoothing_is_that_of_scipy(shape: tuple[int, int], sigma: float) -> None:
    planes = np.random.default_rng(1).random((3, *shape)).astype(np.float32)
    expected = np.stack([gaussian_filter(plane, sigma, mode="reflect", truncate=3.0) for plane in planes])
    np.testing.assert_allclose(_smooth(planes, sigma), expected, atol=1e-5)


def test_depth_is_clipped_at_its_percentile_and_stretched_over_its_valid_pixels() -> None:
    depth = np.full((10, 10), 2.0)
    depth[0], depth[9, 9], depth[5, :5] = 1.0, 30.0, 0.0
    planes = _depth(depth)
    assert planes[1].tolist() == (depth > 0).astype(float).tolist()
    assert planes[2].max() == 0
    assert (planes[0][depth == 1] == 0).all()
    assert (planes[0][depth == 0] == 0).all()
    np.testing.assert_allclose(planes[0][depth >= 2], 1.0, atol=1e-6)


def test_the_percentile_is_right_to_the_millimetre() -> None:
    depth = np.random.default_rng(2).uniform(0.4, 3.0, (60, 70)).astype(np.float32)
    depth[::7] = 0
    valid = depth > 0
    ceiling = np.percentile(depth[valid], 98)
    low = depth[valid].min()
    expected = (np.minimum(depth, ceiling) - low) / (ceiling - low)
    np.testing.assert_allclose(_depth(depth)[0][valid], expected[valid], atol=2e-3)


@pytest.mark.parametrize("meters", [1e-4, 1.0, 65.6, 90.0])
def test_depth_that_is_equal_everywhere_is_zero(meters: float) -> None:
    assert np.abs(_depth(np.full((4, 5), meters))).max(axis=(1, 2)).tolist() == [0, 1, 0]


def test_missing_depth_does_not_bleed_into_smoothed_depth() -> None:
    depth = np.full((12, 12), 1.0)
    depth[:, 6:] = 2.0
    depth[3:9, 2:5] = 0
    planes = _depth(depth)
    result = unweighted(_smooth(planes, 1.5), planes)
    assert result[1].tolist() == planes[1].tolist()
    assert (result[0][depth == 0] == 0).all()
    # Between the values of its valid neighbours; the hole must not pull it below them.
    assert result[0][depth == 1].min() >= -1e-6
    assert result[0][depth == 2].min() > 0.5
