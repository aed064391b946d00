import logging
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from sgbd.frame import Frame, FrameError, Intrinsics
from sgbd.sources import ColorDepthRecording, DatasetNotFoundError, FrameReadError, TumRecording
from sgbd.sources.find_frames import RecordedFrames, find_frames
from tests.scenes import scene, write_pair


def test_two_files_are_one_frame(tmp_path: Path) -> None:
    write_pair(scene(0), tmp_path / "a_color.png", tmp_path / "b.png")
    frames = RecordedFrames(tmp_path / "a_color.png", tmp_path / "b.png")
    assert frames.names == ("a",)
    assert (frames[0].rgb == scene(0).rgb).all()
    assert frames[0].depth == pytest.approx(scene(0).depth, abs=6e-4)
    assert frames[0].name == "a"


def test_two_folders_are_paired_by_name(tmp_path: Path) -> None:
    for number in range(3):
        write_pair(scene(number), tmp_path / f"rgb/{number:02}_rgb.png", tmp_path / f"depth/{number:02}_depth.png")
    (tmp_path / "depth/01_depth.png").unlink()
    frames = RecordedFrames(tmp_path / "rgb", tmp_path / "depth")
    assert frames.names == ("00", "01", "02")
    assert (frames[2].rgb == scene(2).rgb).all()
    with pytest.raises(FrameReadError, match=r"01\.png"):
        frames[1]


def test_one_folder_of_pairs(tmp_path: Path) -> None:
    write_pair(scene(1), tmp_path / "x_rgb.png", tmp_path / "x_depth.png")
    frames = RecordedFrames(tmp_path)
    assert frames.names == ("x",)
    assert frames[0].depth == pytest.approx(scene(1).depth, abs=6e-4)


def test_what_is_no_frame_is_refused(tmp_path: Path) -> None:
    write_pair(scene(0), tmp_path / "a.png", tmp_path / "b.png")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FrameReadError, match="does not exist"):
        RecordedFrames(tmp_path / "nowhere.png", tmp_path / "b.png")
    with pytest.raises(FrameReadError, match="its depth is not known"):
        RecordedFrames(tmp_path / "a.png")
    with pytest.raises(FrameReadError, match="must both be files or both be folders"):
        RecordedFrames(tmp_path / "a.png", tmp_path)
    with pytest.raises(FrameReadError, match="there is no image in it"):
        RecordedFrames(tmp_path / "empty", tmp_path)
    with pytest.raises(FrameError, match="has 3 channels"):
        RecordedFrames(tmp_path / "a.png", tmp_path / "a.png")[0]


def test_two_images_of_one_frame_are_refused(tmp_path: Path) -> None:
    write_pair(scene(0), tmp_path / "a_rgb.png", tmp_path / "a_depth.png")
    with pytest.raises(FrameReadError, match=r"a_rgb\.png: frame 'a' has two images, this one and a_depth\.png"):
        RecordedFrames(tmp_path, tmp_path)


def test_the_lists_of_tum_come_before_folders_of_the_same_names(tmp_path: Path) -> None:
    # Read as plain rgb/ and depth/ folders, the depth would be five times too large.
    for folder, image in {"rgb": scene(0).rgb, "depth": (scene(0).depth * 5000).round().astype(np.uint16)}.items():
        (tmp_path / folder).mkdir()
        iio.imwrite(tmp_path / folder / "1.png", image)
        (tmp_path / f"{folder}.txt").write_text(f"1 {folder}/1.png\n")
    in_millimeters = Frame(scene(0).rgb, 5 * scene(0).depth).depth
    frames = find_frames(tmp_path)
    assert isinstance(frames, TumRecording)
    assert frames[0].depth == pytest.approx(scene(0).depth, abs=2e-4)
    assert find_frames(tmp_path, depth_scale=0.001)[0].depth == pytest.approx(in_millimeters, abs=1e-3)
    with pytest.raises(FrameReadError, match=r"not in millimetres\. Give rgb="):
        find_frames(tmp_path / "rgb", tmp_path / "depth")
    given = find_frames(tmp_path / "rgb", tmp_path / "depth", depth_scale=0.0002)
    assert given[0].depth == pytest.approx(scene(0).depth, abs=2e-4)
    for name in ("rgb.txt", "depth.txt"):
        (tmp_path / name).unlink()
    assert find_frames(tmp_path)[0].depth == pytest.approx(in_millimeters, abs=1e-3)


def test_color_and_depth_sequences_are_recognised(tmp_path: Path) -> None:
    write_pair(scene(2), tmp_path / "color/7.png", tmp_path / "depth/007.png")
    frames = find_frames(tmp_path)
    assert isinstance(frames, ColorDepthRecording)
    assert frames[0].depth == pytest.approx(scene(2).depth, abs=6e-4)


def test_what_is_assumed_of_colours_and_depth_given_apart_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    write_pair(scene(2), tmp_path / "color/7.png", tmp_path / "depth/7.png")
    places = (tmp_path / "color", tmp_path / "depth")
    camera = Intrinsics(600.0, 600.0, 3.5, 2.5)
    find_frames(*places, camera)
    find_frames(*places)
    told = f"{places[0]}, {places[1]}: the depth has 1000 units a metre (option: depth_scale, now 0.001)"
    assert caplog.messages[0] == told
    assert (
        caplog.messages[1] == f"{told}; the camera is unknown, a horizontal view of 59° is assumed (option: intrinsics)"
    )
    (tmp_path / "intrinsic.json").write_text("{}")
    find_frames(*places, camera, 0.001)
    assert len(caplog.messages) == 2
    find_frames(*places, camera)
    assert f"intrinsic.json is left out, as colours and depth are given apart; rgb={tmp_path} alone" in caplog.text


def test_other_inputs_are_what_they_were(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    write_pair(scene(1), tmp_path / "x_rgb.png", tmp_path / "x_depth.png")
    assert find_frames(tmp_path)[0].depth == pytest.approx(scene(1).depth, abs=6e-4)
    assert "taken for a folder of frames; the depth has 1000 units a metre" in caplog.text
    both = find_frames(tmp_path / "x_rgb.png", tmp_path / "x_depth.png", depth_scale=0.01)
    assert both[0].depth == pytest.approx(10 * scene(1).depth, abs=6e-3)


def test_what_is_no_recording_is_told_what_would_be(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError) as told:
        find_frames(tmp_path)
    for word in ("NAME_rgb.png", "rgb.txt", "color/000000.jpg", "camera_intrinsic.json", "two videos"):
        assert word in str(told.value)
    (tmp_path / "clip.mp4").touch()
    write_pair(scene(0), tmp_path / "a.png", tmp_path / "b.png")
    with pytest.raises(FrameReadError, match=r"b\.png: rgb and depth must both be videos, or both be images"):
        find_frames(tmp_path / "clip.mp4", tmp_path / "b.png")
    with pytest.raises(ValueError, match="depth_scale must be positive"):
        find_frames(tmp_path, depth_scale=0)
    with pytest.raises(ValueError, match="time_tolerance must be 0 or more"):
        find_frames(tmp_path, time_tolerance=-1)
