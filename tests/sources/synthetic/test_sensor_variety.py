"""Randomly drawn cameras: common constraints, and each step on inputs that can be calculated by hand."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

pytest.importorskip("embreex", reason="needs the extra sgbd[synthetic]")
pytest.importorskip("trimesh", reason="needs the extra sgbd[synthetic]")

from sgbd.frame import SUPPORT
from sgbd.sources.synthetic import sensor_variety
from sgbd.sources.synthetic.render import Rendering
from sgbd.sources.synthetic.sensor_variety import recorded_by_any_camera

FOCAL = 120.0
SEEDS = range(40)


def rendering() -> Rendering:
    """Return a wall at 3 m, a table at 1.5 m, an object on it at 1 m, and a corner where nothing is hit."""
    shape = (60, 80)
    depth, label = np.full(shape, 3.0, np.float32), np.zeros(shape, np.int32)
    depth[20:], label[20:] = 1.5, SUPPORT
    depth[30:50, 25:50], label[30:50, 25:50] = 1.0, SUPPORT + 1
    depth[:6, :6] = 0
    return Rendering(np.full((*shape, 3), 0.5, np.float32), depth, label, np.ones(shape, np.float32))


def picture() -> npt.NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)


def record(seed: int) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
    return recorded_by_any_camera(picture(), rendering(), FOCAL, np.random.default_rng(seed))


def test_every_camera_gives_metres_or_nothing_and_leaves_the_view_as_it_is() -> None:
    view = rendering()
    kept = view.depth.copy()
    for seed in SEEDS:
        rgb, depth = recorded_by_any_camera(picture(), view, FOCAL, np.random.default_rng(seed))
        assert (rgb.shape, rgb.dtype) == ((60, 80, 3), np.uint8)
        assert (depth.shape, depth.dtype) == ((60, 80), np.float32)
        assert np.isfinite(depth).all()
        assert depth.min() >= 0
        assert (depth[:3, :3] == 0).all(), seed
        # Measured depth is close to the true depth: no values between foreground and background are invented.
        valid = depth[depth > 0]
        assert valid.size > 0.02 * depth.size
        error = np.min([np.abs(valid - true) / true for true in (1.0, 1.5, 3.0)], axis=0)
        assert np.median(error) < 0.05, seed
        np.testing.assert_array_equal(view.depth, kept)


def test_a_seed_fixes_the_camera_and_cameras_differ() -> None:
    shares = set()
    for seed in SEEDS:
        (rgb, depth), (same_rgb, same_depth) = record(seed), record(seed)
        np.testing.assert_array_equal(rgb, same_rgb)
        np.testing.assert_array_equal(depth, same_depth)
        shares.add(round(float((depth == 0).mean()), 2))
    assert len(shares) > 10


def test_some_cameras_are_exact_and_some_pictures_lie_off_the_depth() -> None:
    records = [record(seed) for seed in SEEDS]
    exact = [np.array_equal(depth, rendering().depth) for _, depth in records]
    assert 0 < sum(exact) < len(SEEDS) / 2
    moved = [not np.array_equal(rgb, picture()) for rgb, _ in records]
    assert 0 < sum(moved) < len(SEEDS)
    for rgb, _ in records:
        assert any(
            np.array_equal(rgb, np.roll(picture(), (down, right), (0, 1)))
            for down in (-1, 0, 1)
            for right in (-2, -1, 0, 1, 2)
        )


def test_stereo_loses_the_shadow_beside_a_near_thing_but_not_the_plane() -> None:
    view = rendering()
    lost = np.mean(
        [sensor_variety._stereo(view, FOCAL, np.random.default_rng(seed)) == 0 for seed in range(12)], axis=0
    )
    assert (lost[:4, :4] == 1).all()
    assert lost[25:28, 8:15].mean() < 0.1
    # The disparities of 1 m and 1.5 m differ by a few pixels, which most cameras lose to the left of the object.
    assert lost[35:45, 23:25].mean() > 0.2
    assert lost[35:45, 52:60].mean() < 0.1


def test_dead_surfaces_are_blots_on_whole_instances_and_never_background() -> None:
    label = np.repeat(np.arange(12, dtype=np.int32), 20)[None].repeat(200, axis=0)
    seen = np.zeros(12, bool)
    for seed in range(25):
        dead = sensor_variety._dead_surfaces(label, np.random.default_rng(seed))
        assert dead.shape == label.shape
        assert dead.dtype == bool
        assert not dead[label == 0].any()
        seen |= [dead[label == k].any() for k in range(12)]
        assert not dead.all()
    assert seen[SUPPORT]
    assert seen[SUPPORT + 1 :].sum() > 5


def test_a_view_without_objects_has_no_dead_surface() -> None:
    for seed in range(10):
        assert not sensor_variety._dead_surfaces(np.zeros((20, 20), np.int32), np.random.default_rng(seed)).any()


def test_smoothing_keeps_planes_holes_and_what_lies_right_at_an_edge() -> None:
    plane = np.full((30, 30), 2.0, np.float32)
    plane[10, 10] = 0
    np.testing.assert_allclose(sensor_variety._smoothed(plane), plane, rtol=1e-5)
    depth = rendering().depth
    depth[40, 10] = 0
    smooth = sensor_variety._smoothed(depth)
    np.testing.assert_array_equal(smooth == 0, depth == 0)
    # The pixels on both sides of the object's left edge, and the middle of its face, 6 pixels from any edge.
    np.testing.assert_array_equal(smooth[35:45, 24:26], depth[35:45, 24:26])
    np.testing.assert_allclose(smooth[37:43, 32:43], 1.0, rtol=1e-5)
    rough = plane + np.random.default_rng(0).normal(0, 0.002, plane.shape).astype(np.float32)
    rough[10, 10] = 2.0
    assert sensor_variety._smoothed(rough).std() < 0.5 * rough.std()


def test_what_is_cut_off_is_beyond_the_table_or_at_the_rim() -> None:
    view = rendering()
    beyond = 0
    for seed in range(30):
        depth = sensor_variety._cut_off(view.depth, view.label, np.random.default_rng(seed))
        kept = (depth == view.depth) | (depth == 0)
        assert kept.all()
        # Depth on the table is removed only in the strips at the right and bottom border.
        inner = (view.label > SUPPORT)[:-10, :-24]
        assert (depth[:-10, :-24][inner] > 0).all()
        beyond += not depth[view.label == 0].any()
    assert beyond > 10
    np.testing.assert_array_equal(view.depth, rendering().depth)
