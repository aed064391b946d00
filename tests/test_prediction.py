import json
import logging
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from sgbd import prediction
from sgbd.frame import Frame, FrameError, Intrinsics
from sgbd.machine import one_ahead
from sgbd.prediction import (
    RecordedFrames,
    find_frames,
    label_images_in_the_way,
    objects_as_json,
    segment_ahead,
    write_segmentation,
)
from sgbd.segmentation import Segmentation
from sgbd.segmenter import Segmenter
from sgbd.sources import ColorDepthRecording, DatasetNotFoundError, FrameReadError, TumRecording
from tests.scenes import scene


def _write(frame: Frame, rgb: Path, depth: Path) -> None:
    for path, image in ((rgb, frame.rgb), (depth, (frame.depth * 1000).round().astype(np.uint16))):
        path.parent.mkdir(parents=True, exist_ok=True)
        iio.imwrite(path, image)


def _segmentation() -> Segmentation:
    instances = np.zeros((6, 8), np.int32)
    instances[1:4, 2:7] = 1
    instances[4, 0] = 2
    return Segmentation(
        instances=instances,
        scores=np.array([0.9, 0.25], np.float32),
        objectness=np.array([0.95, 0.5], np.float32),
        superpixels=instances.copy(),
        edge_index=np.array([[0, 0], [1, 2]]),
        edge_probability=np.array([0.1, 0.2], np.float32),
    )


def test_two_files_are_one_frame(tmp_path: Path) -> None:
    _write(scene(0), tmp_path / "a_color.png", tmp_path / "b.png")
    frames = RecordedFrames(tmp_path / "a_color.png", tmp_path / "b.png")
    assert frames.names == ("a",)
    assert (frames[0].rgb == scene(0).rgb).all()
    assert frames[0].depth == pytest.approx(scene(0).depth, abs=6e-4)
    assert frames[0].name == "a"


def test_two_folders_are_paired_by_name(tmp_path: Path) -> None:
    for number in range(3):
        _write(scene(number), tmp_path / f"rgb/{number:02}_rgb.png", tmp_path / f"depth/{number:02}_depth.png")
    (tmp_path / "depth/01_depth.png").unlink()
    frames = RecordedFrames(tmp_path / "rgb", tmp_path / "depth")
    assert frames.names == ("00", "01", "02")
    assert (frames[2].rgb == scene(2).rgb).all()
    with pytest.raises(FrameReadError, match=r"01\.png"):
        frames[1]


def test_one_folder_of_pairs(tmp_path: Path) -> None:
    _write(scene(1), tmp_path / "x_rgb.png", tmp_path / "x_depth.png")
    frames = RecordedFrames(tmp_path)
    assert frames.names == ("x",)
    assert frames[0].depth == pytest.approx(scene(1).depth, abs=6e-4)


def test_what_is_no_frame_is_refused(tmp_path: Path) -> None:
    _write(scene(0), tmp_path / "a.png", tmp_path / "b.png")
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
    _write(scene(0), tmp_path / "a_rgb.png", tmp_path / "a_depth.png")
    with pytest.raises(FrameReadError, match=r"a_rgb\.png: frame 'a' has two images, this one and a_depth\.png"):
        RecordedFrames(tmp_path, tmp_path)


def test_objects_are_described_by_box_area_and_score() -> None:
    assert objects_as_json(_segmentation()) == [
        {"id": 1, "area": 15, "box": [2, 1, 5, 3], "score": 0.9, "objectness": 0.95},
        {"id": 2, "area": 1, "box": [0, 4, 1, 1], "score": 0.25, "objectness": 0.5},
    ]


def test_three_files_are_written(tmp_path: Path) -> None:
    frame = Frame(np.full((6, 8, 3), 90, np.uint8), np.ones((6, 8), np.float32), name="set/one")
    write_segmentation(frame, _segmentation(), tmp_path / "out")
    labels = iio.imread(tmp_path / "out/set_one_labels.png")
    assert labels.dtype == np.uint16
    assert (labels == _segmentation().instances).all()
    assert iio.imread(tmp_path / "out/set_one_overlay.png").shape == (6, 8, 3)
    description = json.loads((tmp_path / "out/set_one.json").read_text())
    assert (description["name"], description["width"], description["height"]) == ("set/one", 8, 6)
    assert description["objects"] == objects_as_json(_segmentation())


def test_label_images_beside_the_frames_are_told_unless_they_were_predicted(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        _write(scene(0), tmp_path / f"{name}_rgb.png", tmp_path / f"{name}_depth.png")
    frames = RecordedFrames(tmp_path)
    write_segmentation(Frame(scene(0).rgb, scene(0).depth, name="b"), _segmentation(), tmp_path, draw=False)
    assert label_images_in_the_way(frames, tmp_path) == []
    for folder in (tmp_path, tmp_path / "out"):
        folder.mkdir(exist_ok=True)
        (folder / "a_labels.png").write_bytes(b"")
    assert label_images_in_the_way(frames, tmp_path / "out" / "..") == [tmp_path / "out" / ".." / "a_labels.png"]
    assert label_images_in_the_way(frames, tmp_path / "out") == []


def test_label_images_of_an_interrupted_prediction_are_not_in_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _write(scene(0), tmp_path / "a_rgb.png", tmp_path / "a_depth.png")
    frames = RecordedFrames(tmp_path)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(prediction, "overlay", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_segmentation(Frame(scene(0).rgb, scene(0).depth, name="a"), _segmentation(), tmp_path)
    assert (tmp_path / "a_labels.png").is_file()
    assert label_images_in_the_way(frames, tmp_path) == []


def test_overlays_can_be_left_out(tmp_path: Path) -> None:
    frame = Frame(np.full((6, 8, 3), 90, np.uint8), np.ones((6, 8), np.float32), name="one")
    write_segmentation(frame, _segmentation(), tmp_path, draw=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.json", "one_labels.png"]


@pytest.mark.parametrize("processors", [1, 2])
def test_frames_are_segmented_in_turn_and_unreadable_ones_told_in_their_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, processors: int
) -> None:
    monkeypatch.setattr(one_ahead, "thread_count", lambda: processors)
    for number in range(4):
        _write(scene(number), tmp_path / f"{number}_rgb.png", tmp_path / f"{number}_depth.png")
    (tmp_path / "2_depth.png").write_bytes(b"no image")
    frames, segmenter = RecordedFrames(tmp_path), Segmenter.pretrained()
    results = list(segment_ahead(frames, segmenter))
    assert len(results) == 4
    for number, result in enumerate(results):
        if number == 2:
            assert isinstance(result, FrameReadError)
            assert "2_depth.png" in str(result)
        else:
            assert isinstance(result, tuple)
            frame, segmentation = result
            assert frame.name == str(number)
            alone = segmenter.segment_frame(frames[number])
            assert (segmentation.instances == alone.instances).all()
            assert (segmentation.superpixels == alone.superpixels).all()


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
    _write(scene(2), tmp_path / "color/7.png", tmp_path / "depth/007.png")
    frames = find_frames(tmp_path)
    assert isinstance(frames, ColorDepthRecording)
    assert frames[0].depth == pytest.approx(scene(2).depth, abs=6e-4)


def test_what_is_assumed_of_colours_and_depth_given_apart_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    _write(scene(2), tmp_path / "color/7.png", tmp_path / "depth/7.png")
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
    _write(scene(1), tmp_path / "x_rgb.png", tmp_path / "x_depth.png")
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
    _write(scene(0), tmp_path / "a.png", tmp_path / "b.png")
    with pytest.raises(FrameReadError, match=r"b\.png: rgb and depth must both be videos, or both be images"):
        find_frames(tmp_path / "clip.mp4", tmp_path / "b.png")
    with pytest.raises(ValueError, match="depth_scale must be positive"):
        find_frames(tmp_path, depth_scale=0)
    with pytest.raises(ValueError, match="time_tolerance must be 0 or more"):
        find_frames(tmp_path, time_tolerance=-1)
