import pickle
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.frame import Frame
from sgbd.superpixels import slic_fast
from sgbd.superpixels.slic import Slic, Superpixels
from sgbd.superpixels.slic_fast import FastSlic
from tests.label_maps import frames, is_superpixel_map, shapes
from tests.superpixels.made_up import made_up_frame, quality


def _real(folder: Path, index: int) -> Frame:
    stem = folder / "mosd_learn" / f"learn{index:02d}"
    labels = iio.imread(f"{stem}_labels.png").astype(np.int32)
    return Frame(
        iio.imread(f"{stem}_rgb.png")[..., :3],
        iio.imread(f"{stem}_depth.png"),
        instances=np.where(labels == 0, -1, np.where(labels < 10, 1, labels // 10)).astype(np.int32),
    )


def _mean_quality(superpixels: Superpixels, of: list[Frame]) -> npt.NDArray[np.float64]:
    return np.mean([quality(superpixels(frame), frame) for frame in of], axis=0)


def _assert_no_worse(of: list[Frame], n_segments: int, slack: list[float], min_size: int = 25) -> None:
    """Compare with scikit-image's SLIC, interpolating its measures to the same number of superpixels."""
    reference = _mean_quality(Slic(n_segments, min_size=min_size), of)
    asked = [n_segments // 2, n_segments * 3 // 4, n_segments, n_segments * 3 // 2, n_segments * 2]
    ours = np.array([_mean_quality(FastSlic(n, min_size=min_size), of) for n in asked])
    at = np.log(ours[:, 0])
    assert at[0] < np.log(reference[0]) < at[-1]
    equal = [np.interp(np.log(reference[0]), at, ours[:, k]) for k in range(1, 6)]
    gain = np.array(equal) - reference[1:]
    assert (gain >= -np.array(slack)).all(), f"colour EV, depth EV, BR, 1 - UE, ASA: {reference[1:]} and gain {gain}"


@given(shapes(40).flatmap(frames), st.sampled_from([1, 2, 5, 40, 5000]), st.sampled_from([0, 1, 4, 25]))
@settings(max_examples=60, deadline=None)
def test_superpixels_are_connected_numbered_and_large_enough(frame: Frame, n_segments: int, min_size: int) -> None:
    label_map = FastSlic(n_segments, min_size=min_size)(frame)
    sizes = np.bincount(label_map.ravel())
    assert label_map.dtype == np.int32
    assert label_map.shape == frame.depth.shape
    assert is_superpixel_map(label_map)
    assert len(sizes) == 1 or sizes.min() >= min_size


@given(
    shapes(40).flatmap(frames),
    st.sampled_from([(True, True), (True, False), (False, True)]),
    st.integers(2, 5),
    st.sampled_from([0.01, 1.0]),
)
@settings(max_examples=40, deadline=None)
def test_threads_change_nothing(frame: Frame, use: tuple[bool, bool], threads: int, depth_sigma: float) -> None:
    one = FastSlic(20, rgb=use[0], depth=use[1], depth_sigma=depth_sigma, min_size=4, threads=1)(frame)
    many = FastSlic(20, rgb=use[0], depth=use[1], depth_sigma=depth_sigma, min_size=4, threads=threads)(frame)
    np.testing.assert_array_equal(one, many)


def test_memory_that_is_used_again_changes_nothing() -> None:
    superpixels = FastSlic(60)
    expected = [superpixels(made_up_frame(seed)) for seed in (0, 1)]
    small = Frame(np.zeros((5, 7, 3), np.uint8), np.ones((5, 7), np.float32))
    for _ in range(2):
        superpixels(small)
        again = [superpixels(made_up_frame(seed)) for seed in (0, 1)]
        np.testing.assert_array_equal(again, expected)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(superpixels))(made_up_frame(0)), expected[0])


@pytest.mark.parametrize(("rgb", "depth"), [(True, False), (False, True), (True, True)])
def test_superpixels_respect_edges(rgb: bool, depth: bool) -> None:
    colors = np.full((48, 64, 3), 120, np.uint8)
    meters = np.full((48, 64), 1.0, np.float32)
    if rgb:
        colors[:, 32:] = (220, 30, 30)
    if depth:
        meters[24:] = 1.5
    # Smoothing moves a clear edge by less than a pixel, and only in the colours.
    label_map = FastSlic(12, rgb=rgb, depth=depth, min_size=8)(Frame(colors, meters))
    assert is_superpixel_map(label_map)
    if rgb:
        assert not set(label_map[:, :32].ravel()) & set(label_map[:, 32:].ravel())
    if depth:
        assert not set(label_map[:24].ravel()) & set(label_map[24:].ravel())


def test_a_constant_frame_is_cut_into_a_grid() -> None:
    label_map = FastSlic(12)(Frame(np.full((48, 64, 3), 9, np.uint8), np.full((48, 64), 1.0, np.float32)))
    row, column = np.mgrid[:48, :64]
    np.testing.assert_array_equal(label_map, row // 16 * 4 + column // 16)


def test_a_hole_in_the_depth_is_no_edge() -> None:
    meters = np.full((60, 60), 1.0, np.float32)
    meters[20:40, 20:40] = 0
    meters[0, 0] = 1.1
    whole = FastSlic(4, rgb=False, min_size=4)(Frame(np.zeros((60, 60, 3), np.uint8), meters))
    assert len(np.unique(whole)) <= 5
    assert len(np.unique(whole[20:40, 20:40])) == 4


def test_about_as_many_superpixels_as_scikit_image_gives() -> None:
    of = [made_up_frame(seed) for seed in range(4)]
    for n_segments in (40, 120):
        ours, reference = (np.mean([s(n_segments)(f).max() + 1 for f in of]) for s in (FastSlic, Slic))
        assert 0.6 < ours / reference < 1.7


@pytest.mark.parametrize("n_segments", [48, 128])
def test_quality_on_made_up_frames_is_no_worse_than_that_of_scikit_image(n_segments: int) -> None:
    _assert_no_worse([made_up_frame(seed) for seed in range(8)], n_segments, slack=[0.0, 0.002, 0.01, 0.002, 0.001])


@pytest.mark.parametrize("n_segments", [128, 512])
def test_quality_on_real_frames_is_no_worse_than_that_of_scikit_image(shared_data: Path, n_segments: int) -> None:
    of = [_real(shared_data, index) for index in (3, 19, 27, 35, 40)]
    _assert_no_worse(of, n_segments, slack=[0.0, 0.002, 0.01, 0.002, 0.001])


def test_without_numba_scikit_image_steps_in_and_says_so_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(slic_fast, "HAS_NUMBA", False)
    slic_fast.say_that_numba_is_missing.cache_clear()
    frame = made_up_frame(0)
    superpixels = FastSlic(30)
    np.testing.assert_array_equal(superpixels(frame), Slic(30)(frame))
    FastSlic(40)
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "pip install numba" in caplog.text
    slic_fast.say_that_numba_is_missing.cache_clear()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"iterations": -1}, "iterations=-1"),
        ({"subsample": 0}, "subsample=0"),
        ({"threads": 0}, "threads=0"),
        ({"rgb": False, "depth": False}, "nothing to over-segment by"),
        ({"n_segments": 0}, "n_segments"),
    ],
)
def test_options_out_of_range_are_told(options: dict[str, int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FastSlic(**options)  # type: ignore[arg-type]
