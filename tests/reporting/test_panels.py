import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sgbd.jobs.configuration import ConfigurationError
from sgbd.reporting.panels import PANELS, GalleryFrame, encoded, frame_panels, read_index, write_index, write_panels
from tests.reporting.segmentations import halves
from tests.scenes import SEEN, scene


def test_panels_are_pictures_of_the_frames_size() -> None:
    frame = scene(0)
    panels = frame_panels(frame, halves(frame, 1.0))
    assert tuple(panels) == PANELS
    for picture in panels.values():
        assert picture.shape == frame.rgb.shape
        assert picture.dtype == np.uint8
    assert (panels["frame"] == frame.rgb).all()
    # The border is drawn once, along its right side.
    drawn = (panels["superpixels"] != frame.rgb).any(axis=(0, 2))
    assert np.nonzero(drawn)[0].tolist() == [32]
    assert (panels["prediction"] == frame.rgb).all()
    assert (panels["truth"] != frame.rgb).any()
    assert "truth" not in frame_panels(replace(frame, instances=None), halves(frame, 1.0))


@pytest.mark.parametrize(("probability", "stronger"), [(0.0, 0), (1.0, 1)])
def test_cut_edges_are_red_and_merged_edges_green(probability: float, stronger: int) -> None:
    frame = scene(0)
    edges = frame_panels(frame, halves(frame, probability))["edges"].astype(int)
    assert edges.shape == frame.rgb.shape
    # The edge runs from (15.5, 23.5) to (47.5, 23.5).
    middle = edges[22:26, 25:40].reshape(-1, 3)
    color = middle[np.abs(middle[:, 0] - middle[:, 1]).argmax()]
    assert color[stronger] - color[1 - stronger] > 80


def test_files_of_a_gallery_and_its_index(tmp_path: Path) -> None:
    frame = scene(0)
    entry = write_panels(frame, halves(frame, 0.5), SEEN, tmp_path, "1_scene0")
    assert entry.name == "scene0"
    assert list(entry.categories) == ["bowl", "can", "mug"]
    assert (entry.seen, entry.unseen) == (2, 1)
    for panel in PANELS:
        with Image.open(tmp_path / entry.panels[panel]) as picture:
            assert (picture.format, picture.size) == ("WEBP", (frame.width, frame.height))
    write_index([entry], tmp_path)
    assert read_index(tmp_path) == [entry]


def test_segments_of_a_first_stage_are_not_called_superpixels(tmp_path: Path) -> None:
    frame = scene(0)
    entry = write_panels(frame, replace(halves(frame, 0.5), from_first_stage=True), SEEN, tmp_path, "a")
    assert (entry.nodes, entry.panels["superpixels"]) == ("segments of the first stage", "a/superpixels.webp")
    write_index([entry], tmp_path)
    assert read_index(tmp_path) == [entry]


def test_without_a_division_nothing_is_seen_or_unseen(tmp_path: Path) -> None:
    entry = write_panels(scene(0), halves(scene(0), 0.5), frozenset(), tmp_path, "a")
    assert (entry.seen, entry.unseen) == (None, None)


def test_wide_pictures_are_made_smaller(tmp_path: Path) -> None:
    (tmp_path / "a.webp").write_bytes(encoded(Image.new("RGB", (1600, 900)), largest_width=400))
    with Image.open(tmp_path / "a.webp") as picture:
        assert picture.size == (400, 225)


def test_a_missing_index_is_an_empty_gallery_and_a_damaged_one_an_error(tmp_path: Path) -> None:
    assert read_index(tmp_path) == []
    (tmp_path / "index.json").write_text(json.dumps({"frames": [{"title": "x"}]}))
    with pytest.raises(ConfigurationError, match="damaged"):
        read_index(tmp_path)
    write_index([GalleryFrame("x", {})], tmp_path)
    assert read_index(tmp_path) == [GalleryFrame("x", {}, [])]
