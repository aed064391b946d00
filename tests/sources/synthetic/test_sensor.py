"""The sensor model on inputs that can be calculated by hand."""

from __future__ import annotations

import numpy as np
import pytest

from sgbd.sources.synthetic.sensor import StructuredLight, depth_edges, exposed, photographed, quantised, shadow


def test_disparities_are_rounded_to_eighths_of_a_pixel() -> None:
    scale = 40.0  # pixel metres: 1 m has a disparity of 40 pixels
    disparity = np.array([40.0, 40.05, 40.07, 0.05, 0.0], dtype=np.float32)
    expected = [1.0, 1.0, 40 / 40.125, 0.0, 0.0]
    np.testing.assert_allclose(quantised(disparity, scale, 8), expected, rtol=1e-6)


def test_the_steps_grow_with_the_square_of_the_depth() -> None:
    disparity = 40 / np.linspace(0.5, 4, 200_000, dtype=np.float32)
    depths = np.unique(quantised(disparity, 40.0, 8))
    steps, middle = np.diff(depths), (depths[1:] + depths[:-1]) / 2
    np.testing.assert_allclose(steps, middle**2 / (8 * 40), rtol=0.05)


def test_a_near_thing_hides_as_many_columns_as_the_disparities_differ() -> None:
    # Wall at 2 m (disparity 10), object at 1 m (disparity 20) in columns 30 to 39: the projector is on the right, so
    # the shadow lies to the left of the object and is 10 columns wide.
    depth = np.full((3, 60), 2.0, dtype=np.float32)
    depth[:, 30:40] = 1.0
    hidden = shadow(depth, scale=20.0)
    expected = np.zeros(60, dtype=bool)
    expected[21:30] = True  # column 20 is lit exactly along the edge of the object
    assert (hidden == expected).all(axis=1).all()


def test_a_plane_shades_nothing() -> None:
    slope = np.tile(np.linspace(0.8, 3.0, 200, dtype=np.float32), (4, 1))
    assert not shadow(slope, 42.0).any()
    assert not shadow(slope[:, ::-1].copy(), 42.0).any()


def test_missing_depth_is_not_in_shadow() -> None:
    depth = np.zeros((2, 5), dtype=np.float32)
    assert not shadow(depth, 42.0).any()


def test_edges_are_where_the_depth_jumps() -> None:
    depth = np.full((5, 8), 1.0, dtype=np.float32)
    depth[:, 4:] = 1.5
    expected = np.zeros((5, 8), dtype=bool)
    expected[:, 3:5] = True
    np.testing.assert_array_equal(depth_edges(depth), expected)


def test_a_noiseless_sensor_returns_a_frontal_plane_exactly() -> None:
    sensor = StructuredLight(jitter=0.0, noise=0.0)
    depth = np.full((24, 32), 1.0, dtype=np.float32)
    focal = 8.0 / 0.075  # the disparity of 1 m is 8 pixels: a level
    measured = sensor.measure(depth, np.ones_like(depth), focal, np.random.default_rng(0))
    np.testing.assert_allclose(measured, 1.0, rtol=1e-6)


@pytest.mark.parametrize(("depth", "missing"), [(0.3, True), (1.0, False), (7.0, True)])
def test_depth_out_of_range_is_missing(depth: float, missing: bool) -> None:
    image = np.full((24, 32), depth, dtype=np.float32)
    measured = StructuredLight().measure(image, np.ones_like(image), 570.0, np.random.default_rng(0))
    assert (measured == 0).all() == missing


def test_grazing_surfaces_drop_out_the_more_the_flatter_they_are_seen() -> None:
    image = np.full((120, 160), 1.0, dtype=np.float32)
    sensor = StructuredLight()
    shares = [
        float((sensor.measure(image, np.full_like(image, facing), 570.0, np.random.default_rng(0)) == 0).mean())
        for facing in (1.0, 0.25, 0.15, 0.02)
    ]
    assert shares[0] == shares[1] == 0
    assert 0.1 < shares[2] < shares[3]
    assert shares[3] > 0.9


def test_noise_grows_with_depth() -> None:
    sensor = StructuredLight()
    spreads = []
    for depth in (0.7, 1.4, 2.8):
        image = np.full((120, 160), depth, dtype=np.float32)
        spreads.append(sensor.measure(image, np.ones_like(image), 570.0, np.random.default_rng(0)).std())
    assert 2 < spreads[1] / spreads[0] < 8
    assert 2 < spreads[2] / spreads[1] < 8


def test_depth_is_lost_at_edges_but_never_invented_between_near_and_far() -> None:
    image = np.full((120, 160), 2.0, dtype=np.float32)
    image[:, 80:] = 1.0
    measured = StructuredLight().measure(image, np.ones_like(image), 570.0, np.random.default_rng(0))
    assert (measured[:, 55:80] == 0).mean() > 0.5  # the shadow, 21 columns wide, and lost edge pixels
    valid = measured[measured > 0]
    assert (np.minimum(np.abs(valid - 1), np.abs(valid - 2)) < 0.1).all()


def test_exposure_brings_the_middle_of_what_counts_to_the_wanted_brightness() -> None:
    color = np.full((40, 40, 3), 7.0, dtype=np.float32)
    color[:, 20:] = 100.0
    weight = np.zeros((40, 40), dtype=np.float32)
    weight[:, :20] = 1
    picture = exposed(color, weight, 0.25)
    np.testing.assert_allclose(picture[:, :20], 0.5, rtol=1e-4)
    assert (picture[:, 20:] > 0.9).all()
    assert (picture <= 1).all()


def test_highlights_hold_the_exposure_back() -> None:
    color = np.full((40, 40, 3), 0.01, dtype=np.float32)
    color[:20] = 10.0
    picture = exposed(color, np.ones((40, 40), dtype=np.float32), 0.5)
    # The geometric mean is about 0.3; scaling it to 0.5 would overexpose half of the image.
    assert picture[:20].max() < 0.95


def test_a_perfect_camera_only_rounds() -> None:
    color = np.linspace(0, 1, 4 * 5 * 3, dtype=np.float32).reshape(4, 5, 3)
    picture = photographed(color, 0.0, 0.0, np.ones(3, dtype=np.float32), np.random.default_rng(0))
    np.testing.assert_array_equal(picture, np.round(color * 255).astype(np.uint8))


def test_tint_and_noise_change_the_picture_as_told() -> None:
    color = np.full((100, 100, 3), 0.5, dtype=np.float32)
    picture = photographed(color, 0.5, 4.0, np.array([1.1, 1, 0.9], dtype=np.float32), np.random.default_rng(0))
    np.testing.assert_allclose(picture.mean(axis=(0, 1)), [140.25, 127.5, 114.75], atol=0.3)
    np.testing.assert_allclose(picture.std(axis=(0, 1)), 4, atol=0.3)
