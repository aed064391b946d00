"""Augmented frames stay consistent: colours, depth, ground truth and camera change together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sgbd.frame import Frame, Intrinsics
from sgbd.frame_augmentation import FrameAugmentation, enlarged, mirrored

PLAIN = FrameAugmentation(mirror=0, crop=1, exposure=0, gain=0, contrast=0, color_noise=0, depth_noise=0, holes=0)


def frame(height: int = 40, width: int = 60) -> Frame:
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    depth = rng.uniform(0.5, 2, (height, width)).astype(np.float32)
    depth[:3] = 0
    instances = np.ones((height, width), np.int32)
    instances[5:15, 5:15], instances[20:36, 30:55] = 2, 3
    return Frame(rgb, depth, Intrinsics(50.0, 52.0, 31.0, 18.0), instances, {2: "mug", 3: "bag"}, "a")


def points(seen: Frame) -> np.ndarray:
    """Return the 3D points of the pixels with their ground truth."""
    rows, columns = np.indices(seen.depth.shape)
    camera, z = seen.camera, seen.depth
    x, y = (columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z
    return np.stack([x, y, z, seen.instances], axis=-1)


def test_without_strength_nothing_changes() -> None:
    changed = PLAIN(frame(), np.random.default_rng(0))
    np.testing.assert_array_equal(changed.rgb, frame().rgb)
    np.testing.assert_array_equal(changed.depth, frame().depth)
    np.testing.assert_array_equal(changed.instances, frame().instances)
    assert changed.intrinsics == frame().intrinsics
    assert changed.categories == {2: "mug", 3: "bag"}


def test_an_unknown_camera_becomes_the_default_one() -> None:
    changed = PLAIN(replace(frame(), intrinsics=None), np.random.default_rng(0))
    assert changed.intrinsics == Intrinsics.default(60, 40)


def test_a_mirrored_frame_is_the_mirrored_scene() -> None:
    ours, theirs = points(mirrored(frame())), points(frame())[:, ::-1]
    np.testing.assert_allclose(ours[..., 0], -theirs[..., 0], atol=1e-6)
    np.testing.assert_allclose(ours[..., 1:], theirs[..., 1:], atol=1e-6)
    np.testing.assert_array_equal(mirrored(mirrored(frame())).rgb, frame().rgb)


def test_an_enlarged_window_shows_the_same_points_in_space() -> None:
    seen = enlarged(frame(), 30, 20, 30, 20)
    assert seen.rgb.shape == (40, 60, 3)
    assert seen.categories == {3: "bag"}
    window = points(frame())[20:40, 30:60]
    # Each pixel became four pixels, whose centres are a quarter of a pixel away from its own.
    blocks = points(seen).reshape(20, 2, 30, 2, 4)
    np.testing.assert_allclose(blocks.mean(axis=(1, 3)), window, atol=1e-5)
    assert seen.camera == Intrinsics(100.0, 104.0, (31 - 30 + 0.5) * 2 - 0.5, (18 - 20 + 0.5) * 2 - 0.5)


def test_the_whole_window_is_the_frame() -> None:
    seen = enlarged(frame(), 0, 0, 60, 40)
    np.testing.assert_array_equal(seen.rgb, frame().rgb)
    assert seen.camera == frame().camera


def test_windows_keep_their_share_and_stay_inside() -> None:
    for seed in range(30):
        seen = replace(PLAIN, crop=0.5)(frame(), np.random.default_rng(seed))
        zoom = seen.camera.fx / 50
        assert 1 <= zoom <= 2.05
        assert set(np.unique(seen.instances)) <= {1, 2, 3}
        assert set(seen.categories) == set(np.unique(seen.instances)) - {1}


def test_a_window_without_depth_is_not_taken() -> None:
    empty = frame()
    depth = np.zeros_like(empty.depth)
    depth[0, 0] = 1
    for seed in range(20):
        assert replace(PLAIN, crop=0.2)(replace(empty, depth=depth), np.random.default_rng(seed)).depth.any()


def test_gains_change_channels_alone() -> None:
    gray = replace(frame(), rgb=np.full((40, 60, 3), 100, np.uint8))
    changed = replace(PLAIN, gain=0.3)(gray, np.random.default_rng(1)).rgb
    assert all(len(np.unique(changed[..., channel])) == 1 for channel in range(3))
    assert len(np.unique(changed)) == 3


def test_exposure_changes_all_channels_alike() -> None:
    colors = replace(frame(), rgb=np.full((40, 60, 3), (40, 80, 250), np.uint8))
    gains = []
    for seed in range(40):
        red, green, blue = replace(PLAIN, exposure=0.3)(colors, np.random.default_rng(seed)).rgb[0, 0].astype(int)
        assert abs(green - 2 * red) <= 1
        assert abs(blue - min(255, 6.25 * red)) <= 4
        gains.append(red / 40)
    assert 0.2 < np.std(np.log(gains)) < 0.4
    assert 0.9 < np.median(gains) < 1.1


def test_depth_noise_grows_with_the_square_of_the_depth() -> None:
    depth = np.ones((200, 300), np.float32)
    depth[:, 150:] = 3
    plain = Frame(np.zeros((200, 300, 3), np.uint8), depth)
    error = replace(PLAIN, depth_noise=0.01)(plain, np.random.default_rng(0)).depth - depth
    near, far = error[:, :150].std(), error[:, 150:].std()
    assert 0 < near < 0.01
    assert far / near == pytest.approx(9, rel=0.15)


def test_holes_take_at_most_their_share_and_missing_depth_stays_missing() -> None:
    taken = []
    for seed in range(10):
        depth = replace(PLAIN, holes=0.4)(frame(), np.random.default_rng(seed)).depth
        assert not depth[:3].any()
        taken.append(((depth == 0) & (frame().depth > 0)).mean())
    assert 0.05 < max(taken) <= 0.4


def test_chance_comes_from_the_generator_alone() -> None:
    first, again, other = (FrameAugmentation()(frame(), np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.depth, again.depth)
    np.testing.assert_array_equal(first.rgb, again.rgb)
    assert not np.array_equal(first.rgb, other.rgb)


@pytest.mark.parametrize("option", [{"mirror": 1.5}, {"crop": 0}, {"holes": 1.0}, {"gain": -1}, {"depth_noise": -1}])
def test_bad_numbers_are_refused(option: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="frame augmentation: mirror must lie"):
        FrameAugmentation(**option)
