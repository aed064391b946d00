import base64
import io
from pathlib import Path

import pytest
from PIL import Image

from sgbd.jobs.configuration import ConfigurationError
from sgbd.reporting.gallery import collect
from sgbd.reporting.panels import PANELS
from sgbd.reporting.runs import read_run
from tests.reporting.result_folders import write_run


def test_cards_hold_pictures_scores_and_groups(tmp_path: Path) -> None:
    frames = {"a": 0.5, "b": 0.25}
    run = read_run(write_run(tmp_path / "one", frames, pictures=True, unseen_only=("b",)), "one")
    gallery = collect([run], megabytes=1)
    first, second = gallery.cards
    assert [picture.panel for picture in first.pictures] == list(PANELS)
    assert [picture.title for picture in first.pictures] == list(PANELS)
    kind, _, content = first.pictures[0].data.partition(";base64,")
    assert kind == "data:image/webp"
    with Image.open(io.BytesIO(base64.b64decode(content))) as picture:
        assert picture.size == (first.pictures[0].width, first.pictures[0].height) == (64, 48)
    assert first.scores == {"overlap_f_measure": 50.0, "unaided_overlap_f_measure": 25.0}
    assert (first.seen, first.unseen, second.seen, second.unseen) == (True, True, False, True)
    assert gallery.places == {("one", "a"): first.identity, ("one", "b"): second.identity}


def test_segments_of_a_first_stage_are_told_from_superpixels(tmp_path: Path) -> None:
    run = write_run(tmp_path / "one", {"a": 0.5}, pictures=True)
    index = run / "gallery" / "index.json"
    index.write_text(index.read_text().replace('"nodes": "superpixels"', '"nodes": "segments of the first stage"'))
    (card,) = collect([read_run(run, "one")], megabytes=1).cards
    assert [picture.panel for picture in card.pictures] == list(PANELS)
    assert [picture.title for picture in card.pictures][1] == "segments of the first stage"


def test_a_small_page_shows_fewer_frames_from_worst_to_best(tmp_path: Path) -> None:
    run = write_run(tmp_path / "one", dict.fromkeys("abcde", 0.5), pictures=True)
    sizes = [sum(file.stat().st_size for file in (run / "gallery" / str(k)).iterdir()) for k in range(5)]
    gallery = collect([read_run(run, "one")], megabytes=(sizes[0] + sizes[2] + sizes[4]) * 4 / 3 / 1e6 + 1e-9)
    assert [card.name for card in gallery.cards] == ["a", "c", "e"]
    assert gallery.available == 5
    assert collect([read_run(run, "one")], megabytes=0).cards == []


def test_runs_of_before_there_were_galleries_show_whole_pictures(tmp_path: Path) -> None:
    run = write_run(tmp_path / "one", {"x/a_1": 0.5})
    (run / "pictures").mkdir()
    Image.new("RGB", (2000, 1000)).save(run / "pictures" / "1_x_a_1.png")
    (card,) = collect([read_run(run, "one")], megabytes=1).cards
    assert (card.name, card.scores["overlap_f_measure"]) == ("x/a_1", 50.0)
    assert [picture.panel for picture in card.pictures] == ["overview"]


def test_missing_and_damaged_pictures_are_named(tmp_path: Path) -> None:
    run = write_run(tmp_path / "one", {"a": 0.5}, pictures=True)
    (run / "gallery/0/edges.webp").write_bytes(b"no picture")
    with pytest.raises(ConfigurationError, match=r"edges\.webp is damaged"):
        collect([read_run(run, "one")], megabytes=1)
    (run / "gallery/0/edges.webp").unlink()
    with pytest.raises(ConfigurationError, match=r"edges\.webp is missing"):
        collect([read_run(run, "one")], megabytes=1)
