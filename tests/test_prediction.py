import json
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from sgbd import prediction
from sgbd.frame import Frame
from sgbd.machine import one_ahead
from sgbd.prediction import label_images_in_the_way, objects_as_json, segment_ahead, write_segmentation
from sgbd.segmentation import Segmentation
from sgbd.segmenter import Segmenter
from sgbd.sources import FrameReadError
from sgbd.sources.find_frames import RecordedFrames
from tests.scenes import scene, write_pair


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
        write_pair(scene(0), tmp_path / f"{name}_rgb.png", tmp_path / f"{name}_depth.png")
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
    write_pair(scene(0), tmp_path / "a_rgb.png", tmp_path / "a_depth.png")
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
        write_pair(scene(number), tmp_path / f"{number}_rgb.png", tmp_path / f"{number}_depth.png")
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
