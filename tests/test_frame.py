"""Frame validation: input is converted to a standard form, or an error explains what to do."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from sgbd import frame as frame_module
from sgbd.frame import Frame, FrameError, Intrinsics


def rgb(height: int = 3, width: int = 4) -> npt.NDArray[np.uint8]:
    return np.arange(height * width * 3, dtype=np.uint8).reshape(height, width, 3)


def meters(height: int = 3, width: int = 4, value: float = 1.5) -> npt.NDArray[np.float32]:
    return np.full((height, width), value, dtype=np.float32)


def test_a_valid_frame_keeps_its_values() -> None:
    instances = np.array([[-1, 0, 1, 2]] * 3, dtype=np.int64)
    camera = Intrinsics(10, 11, 2, 1)
    frame = Frame(rgb(), meters(), camera, instances, {2: "mug"}, "one")
    assert np.array_equal(frame.rgb, rgb())
    assert np.array_equal(frame.depth, meters())
    assert frame.instances is not None
    assert np.array_equal(frame.instances, instances)
    assert (frame.rgb.dtype, frame.depth.dtype, frame.instances.dtype) == (np.uint8, np.float32, np.int32)
    assert (frame.height, frame.width, frame.name, frame.categories) == (3, 4, "one", {2: "mug"})
    assert frame.camera is camera


def test_integer_depth_is_millimeters() -> None:
    depth = np.array([[0, 1, 1500, 9999]], dtype=np.uint16)
    assert Frame(rgb(1, 4), depth).depth[0].tolist() == pytest.approx([0, 0.001, 1.5, 9.999])


def test_invalid_depth_becomes_missing() -> None:
    depth = np.array([[np.nan, np.inf, -np.inf, -1.0, 0.0, 2.0]])
    assert Frame(rgb(1, 6), depth).depth.tolist() == [[0, 0, 0, 0, 0, 2]]


def test_depth_far_beyond_most_of_a_frame_becomes_missing() -> None:
    # The last three are what Blender, OpenCV and PCL write for pixels without a surface.
    depth = np.array([[2, 10, 3, 2, 0.5, 1e10, 10_000, 3.4028235e38]], np.float32)
    assert Frame(rgb(1, 8), depth).depth.tolist() == [[2, 10, 3, 2, 0.5, 0, 0, 0]]
    assert Frame(rgb(1, 3), np.array([[0, 65535, 2000]], np.uint16)).depth.tolist() == [[0, 0, 2]]
    distant = Frame(rgb(1, 6), np.array([[2, 60, 30, 30, 100, 1e10]], np.float32))
    assert distant.depth.tolist() == [[2, 60, 30, 30, 100, 0]]
    assert dataclasses.replace(distant, name="again").depth.tolist() == distant.depth.tolist()


@given(
    arrays.arrays(
        np.float32,
        st.tuples(st.integers(1, 6), st.integers(1, 6)),
        elements=st.one_of(
            st.floats(0.125, 10, width=32), st.sampled_from([0.0, -1.0, float("nan"), float("inf"), float("-inf")])
        ),
    )
)
def test_depth_is_finite_and_nonnegative_or_refused(depth: npt.NDArray[np.float32]) -> None:
    usable = np.isfinite(depth) & (depth > 0)
    colors = np.zeros((*depth.shape, 3), dtype=np.uint8)
    if usable.any():
        assert np.array_equal(Frame(colors, depth).depth, np.where(usable, depth, 0))
    else:
        with pytest.raises(FrameError, match="missing"):
            Frame(colors, depth)


def test_the_callers_depth_is_left_alone() -> None:
    depth = np.array([[np.nan, 1.0]], dtype=np.float32)
    Frame(rgb(1, 2), depth)
    assert np.isnan(depth[0, 0])


def test_arrays_become_contiguous() -> None:
    frame = Frame(rgb(4, 3).transpose(1, 0, 2), meters(4, 3).T, instances=np.zeros((4, 3), np.int32).T)
    assert frame.instances is not None
    assert all(array.flags.c_contiguous for array in (frame.rgb, frame.depth, frame.instances))


def test_arrays_that_cannot_be_written_are_copied() -> None:
    message = rgb().tobytes()
    colors = np.frombuffer(message, np.uint8).reshape(3, 4, 3)
    frame = Frame(colors, meters())
    assert frame.rgb.flags.writeable
    assert np.array_equal(frame.rgb, colors)
    owned = rgb()
    assert Frame(owned, meters()).rgb is owned


@pytest.mark.parametrize(
    ("colors", "message"),
    [
        (np.zeros((3, 4), np.uint8), r"shape \(3, 4\)"),
        (np.zeros((3, 5, 4), np.uint8), r"rgb\.transpose\(1, 2, 0\)"),
        (np.zeros((3, 4, 4), np.uint8), "alpha"),
        (np.zeros((3, 4, 3), np.float32), "float32.*255"),
        (np.zeros((0, 4, 3), np.uint8), "no pixels"),
    ],
)
def test_bad_colours_are_refused(colors: npt.NDArray[np.generic], message: str) -> None:
    with pytest.raises(FrameError, match=message):
        Frame(colors, meters())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("depth", "message"),
    [
        (meters(3, 5), r"rgb is 4x3 and depth 5x3"),
        (np.ones((3, 4), np.uint8), "8 bits"),
        (np.ones((3, 4), np.bool_), "8 bits"),
        (np.ones((3, 4, 3), np.uint16), "picture of the depth"),
        (np.ones((3, 4, 1), np.uint16), r"\(3, 4, 1\).*squeeze"),
        (np.ones((1, 3, 4), np.uint16), r"\(1, 3, 4\).*squeeze"),
        (np.ones((3, 4), np.complex64), "complex64"),
        (np.zeros((3, 4), np.uint16), "every depth value is missing"),
        (np.full((3, 4), np.nan), "every depth value is missing"),
        (meters(value=1500), "1500 m.*divide"),
        (meters(value=0.002), "median depth is 2 mm.*convert"),
        (np.array([[0, 1, 1, 2]] * 3, np.uint16), "median depth is 1 mm.*convert"),
    ],
)
def test_bad_depth_is_refused(depth: npt.NDArray[np.generic], message: str) -> None:
    with pytest.raises(FrameError, match=message):
        Frame(rgb(), depth)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("instances", "message"),
    [
        (np.zeros((3, 5), np.int32), r"\(3, 5\)"),
        (np.zeros((3, 4), np.float32), "integer"),
        (np.full((3, 4), -2), "got -2"),
        (np.full((3, 4), 2**31, np.uint32), "at most 2147483647; got 2147483648"),
    ],
)
def test_bad_instances_are_refused(instances: npt.NDArray[np.generic], message: str) -> None:
    with pytest.raises(FrameError, match=message):
        Frame(rgb(), meters(), instances=instances)  # type: ignore[arg-type]


def test_an_error_names_the_frame() -> None:
    with pytest.raises(FrameError, match="scene_3/2"):
        Frame(rgb(), meters(3, 5), name="scene_3/2")


def test_categories_need_integer_ids() -> None:
    with pytest.raises(FrameError, match="mug"):
        Frame(rgb(), meters(), categories={"mug": 2})  # type: ignore[dict-item]


def test_unknown_camera_is_the_default() -> None:
    assert Frame(rgb(480, 640), meters(480, 640)).camera == Intrinsics(569.6, 569.6, 319.5, 239.5)


@pytest.mark.parametrize("field", ["fx", "fy"])
@pytest.mark.parametrize("value", [0.0, -5.0, float("nan"), float("inf")])
def test_a_camera_must_project(field: str, value: float) -> None:
    with pytest.raises(FrameError, match="fx > 0"):
        dataclasses.replace(Intrinsics(1, 1, 0, 0), **{field: value})


def test_a_camera_of_any_numbers_has_floats() -> None:
    matrix = np.array([[525, 0, 319.5], [0, 525, 239.5], [0, 0, 1]], np.float32)
    camera = Intrinsics(525, np.int64(525), matrix[0, 2], 239.5)  # type: ignore[arg-type]
    assert camera == Intrinsics(525.0, 525.0, 319.5, 239.5)
    assert {type(value) for value in dataclasses.astuple(camera)} == {float}


@pytest.mark.parametrize("value", ["wide", None, [525, 525]])
def test_a_camera_has_numbers(value: object) -> None:
    with pytest.raises(FrameError, match="must be numbers"):
        Intrinsics(value, 525, 319.5, 239.5)  # type: ignore[arg-type]


@pytest.mark.parametrize("camera", [(525, 525, 319.5, 239.5), np.eye(3), {"fx": 525, "fy": 525, "cx": 2, "cy": 1}])
def test_a_camera_in_another_form_is_refused(camera: object) -> None:
    with pytest.raises(FrameError, match=rf"sgbd\.Intrinsics\(fx, fy, cx, cy\).*got {type(camera).__name__}"):
        Frame(rgb(), meters(), camera)  # type: ignore[arg-type]


def test_a_path_is_no_image() -> None:
    with pytest.raises(FrameError, match=r"rgb must be an array of the pixels; got str\. Read image files first"):
        Frame("frame_rgb.png", meters())  # type: ignore[arg-type]
    with pytest.raises(FrameError, match="depth must be an array of the pixels; got NoneType"):
        Frame(rgb(), None)  # type: ignore[arg-type]


def test_a_frame_is_shown_in_one_line() -> None:
    assert repr(Frame(rgb(), meters(), name="one")) == "Frame('one', 4x3 pixels, unknown camera, without truth)"


@pytest.mark.parametrize(
    ("depth", "told"),
    [
        (meters(value=60.0), "median depth is 60 m"),  # centimetres as floats
        (np.full((3, 4), 110, np.uint16), "median depth is 0.11 m"),  # centimetres as integers
    ],
)
def test_a_depth_that_cameras_rarely_see_is_told_once(
    depth: npt.NDArray[np.generic], told: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame_module, "_told_of_unit", [])
    for _ in range(2):
        Frame(rgb(), depth, name="one")
    assert [told in message and message.startswith("frame 'one'") for message in caplog.messages] == [True]


@pytest.mark.parametrize("value", [0.25, 1.0, 9.0])
def test_usual_depths_are_not_remarked_on(value: float, caplog: pytest.LogCaptureFixture) -> None:
    depth = meters(value=value)
    depth[0] = 40  # a window in the background
    Frame(rgb(), depth)
    assert caplog.messages == []
