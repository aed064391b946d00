import json
import logging
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest

from sgbd.frame import Intrinsics
from sgbd.sources import ColorDepthRecording, DatasetNotFoundError, FrameReadError
from sgbd.sources.camera_file import find_camera_file, read_camera_file

CAMERA = Intrinsics(600.0, 601.0, 3.5, 2.5)
OPEN3D = {"width": 8, "height": 6, "intrinsic_matrix": [600.0, 0, 0, 0, 601.0, 0, 3.5, 2.5, 1]}
LIBREALSENSE = {
    "width": 8,
    "height": 6,
    "ppx": 3.5,
    "ppy": 2.5,
    "fx": 600.0,
    "fy": 601.0,
    "model": 4,
    "coeffs": [0] * 5,
}


def write_recording(root: Path, colors: list[str], depths: list[str], camera: Any = None) -> Path:
    """Write a recording; colour image k is gray of value 10 k, depth image k has 1000 + 100 k units."""
    for place, name in enumerate(colors):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        iio.imwrite(root / name, np.full((6, 8, 3), 10 * place, np.uint8))
    for place, name in enumerate(depths):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        iio.imwrite(root / name, np.full((6, 8), 1000 + 100 * place, np.uint16))
    if camera is not None:
        (root / "camera_intrinsic.json").write_text(json.dumps(camera))
    return root


def camera_of(folder: Path, content: Any) -> Path:
    path = folder / "intrinsics.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_images_of_one_number_are_a_frame(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    colors = ["color/Color_10.png", "color/Color_2.png"]
    frames = ColorDepthRecording(write_recording(tmp_path, colors, ["depth/Depth_002.png", "depth/Depth_010.png"]))
    assert frames.names == ("Color_2", "Color_10")
    assert frames[0].rgb[0, 0, 0] == 10
    assert frames[0].depth[0, 0] == pytest.approx(1.0)
    assert frames[1].depth[0, 0] == pytest.approx(1.1)
    assert frames[1].intrinsics is None
    assert "two sequences (color/, depth/); 2 frames, 0 of 2 colour and 0 of 2 depth images" in caplog.text
    assert "1000 units a metre (option: depth_scale, now 0.001); the camera is unknown" in caplog.text


def test_times_as_numbers_keep_their_whole_seconds(tmp_path: Path) -> None:
    times = ["12.000000", "9.000000", "9.5", "9.45", "10.7"]
    colors = [f"color/{time}.png" for time in times]
    depths = ["depth/12.000000.png", "depth/9.000000.png", "depth/9.5.png", "depth/9.45.png", "depth/11.7.png"]
    frames = ColorDepthRecording(write_recording(tmp_path, colors, depths))
    assert frames.names == ("9.000000", "9.45", "9.5", "10.7", "12.000000")
    assert [frames[place].depth[0, 0] for place in (0, 1, 2, 4)] == pytest.approx([1.1, 1.3, 1.2, 1.0])
    with pytest.raises(FrameReadError, match=r"10\.7\.png: the file does not exist"):
        frames[3]


def test_hidden_files_are_no_frames(tmp_path: Path) -> None:
    write_recording(tmp_path, ["color/1.png"], ["depth/1.png"])
    for folder in ("color", "depth"):
        (tmp_path / folder / "._1.png").write_bytes(b"")  # as macOS leaves on some file systems
    assert ColorDepthRecording(tmp_path).names == ("1",)


def test_camera_and_unit_are_those_of_the_file(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    root = write_recording(tmp_path, ["color/0.png"], ["depth/0.png"], OPEN3D | {"depth_scale": 4000.0})
    frame = ColorDepthRecording(root)[0]
    assert frame.intrinsics == CAMERA
    assert frame.depth[0, 0] == pytest.approx(0.25)
    assert "the camera of camera_intrinsic.json (Open3D's form)" in caplog.text
    mine = ColorDepthRecording(root, Intrinsics(1, 2, 3, 4), 0.002)[0]
    assert mine.intrinsics == Intrinsics(1, 2, 3, 4)
    assert mine.depth[0, 0] == pytest.approx(2.0)


def test_a_frame_without_depth_is_its_own_error(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    frames = ColorDepthRecording(
        write_recording(tmp_path, ["color/1.png", "color/2.png"], ["depth/2.png", "depth/3.png"])
    )
    assert len(frames) == 2
    assert "1 of 2 colour and 1 of 2 depth images have no partner" in caplog.text
    with pytest.raises(FrameReadError, match=r"depth/1\.png: the file does not exist"):
        frames[0]
    assert frames[1].depth[0, 0] == pytest.approx(1.0)


def test_the_camera_of_another_size_is_refused_unless_one_is_given(tmp_path: Path) -> None:
    root = write_recording(tmp_path, ["color/0.png"], ["depth/0.png"], OPEN3D | {"width": 16})
    with pytest.raises(FrameReadError, match="8x6 pixels, and the camera of camera_intrinsic.json 16x6"):
        ColorDepthRecording(root)[0]
    assert ColorDepthRecording(root, CAMERA)[0].intrinsics == CAMERA


def test_colours_may_be_in_rgb_beside_a_camera(tmp_path: Path) -> None:
    root = write_recording(tmp_path, ["rgb/0.png"], ["depth/0.png"])
    assert not ColorDepthRecording.recognizes(root)
    camera_of(root, LIBREALSENSE)
    assert ColorDepthRecording.recognizes(root)
    assert ColorDepthRecording(root)[0].intrinsics == CAMERA


def test_what_cannot_be_paired_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError, match=r"there is no folder color|there is no folder rgb"):
        len(ColorDepthRecording(tmp_path))
    write_recording(tmp_path, ["color/1.png"], ["depth/2.png"])
    with pytest.raises(DatasetNotFoundError, match="none of the 1 images in color has the number of one of the 1"):
        len(ColorDepthRecording(tmp_path))
    write_recording(tmp_path, ["color/b_1.png"], [])
    with pytest.raises(FrameReadError, match=r"b_1\.png: it has the number 1, as 1\.png has"):
        len(ColorDepthRecording(tmp_path))
    write_recording(tmp_path, ["color/a.png"], [])
    with pytest.raises(FrameReadError, match=r"a\.png: its name has no number"):
        len(ColorDepthRecording(tmp_path))
    with pytest.raises(ValueError, match="depth_scale must be positive"):
        ColorDepthRecording(tmp_path, depth_scale=0)


@pytest.mark.parametrize(
    ("content", "form", "scale", "distorted"),
    [
        (OPEN3D, "Open3D", None, False),
        (OPEN3D | {"intrinsic_matrix": [[600, 0, 3.5], [0, 601, 2.5], [0, 0, 1]]}, "Open3D", None, False),
        (LIBREALSENSE | {"depth_scale": 0.00025}, "librealsense", 0.00025, False),
        ({"color": LIBREALSENSE | {"coeffs": [0.1, 0, 0, 0, 0]}, "depth_scale": 1000}, "librealsense", 0.001, True),
        ({"fx": 600, "fy": 601, "cx": 3.5, "cy": 2.5}, "librealsense", None, False),
        ("\ufeff" + json.dumps(LIBREALSENSE), "librealsense", None, False),  # as editors on Windows write it
    ],
)
def test_cameras_as_programs_write_them(
    tmp_path: Path, content: Any, form: str, scale: float | None, distorted: bool
) -> None:
    camera = read_camera_file(camera_of(tmp_path, content))
    assert (camera.intrinsics, camera.form, camera.distorted) == (CAMERA, form, distorted)
    assert camera.depth_scale == pytest.approx(scale)
    assert camera.size == ((8, 6) if "width" in json.dumps(content) else None)
    assert find_camera_file(tmp_path) == camera.path


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("{", "cannot be read as JSON"),
        ([1, 2], "fx is missing"),
        ({"fx": 1, "fy": 1, "ppx": 0}, "ppy is missing"),
        ({"intrinsic_matrix": [1, 2]}, "needs 9 numbers"),
        ({"intrinsic_matrix": [600, 0, 3.5, 0, 601, 2.5, 0, 0, 1]}, "in order of columns"),
        (LIBREALSENSE | {"fx": "wide"}, "the camera cannot be read from it"),
        (LIBREALSENSE | {"fx": -1}, "fx > 0"),
        (LIBREALSENSE | {"depth_scale": 0}, "depth_scale must be positive"),
    ],
)
def test_what_is_no_camera_is_refused(tmp_path: Path, content: Any, reason: str) -> None:
    with pytest.raises(FrameReadError, match=reason):
        read_camera_file(camera_of(tmp_path, content))


def test_a_camera_file_that_is_not_there(tmp_path: Path) -> None:
    assert find_camera_file(tmp_path) is None
    with pytest.raises(FrameReadError, match="does not exist"):
        read_camera_file(tmp_path / "intrinsics.json")
