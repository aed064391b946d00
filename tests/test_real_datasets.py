"""The real datasets, from tiny datasets in their layouts to scores, and the commands that split and label TOD."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from omegaconf import OmegaConf

from sgbd.jobs.configuration import config_folder
from sgbd.sources import TOD_CATEGORIES, TODZ_SEEN, FrameSource, Tod
from sgbd.sources.image import read_labels
from tests.scenes import scene
from tests.sources.real_layouts import SCENE_CAMERA, millimeters, save, write_mosd, write_ocid, write_osd
from tests.test_commands import Command, command, trained  # noqa: F401


def write_tod(root: Path, scenes: int = 3) -> None:
    """Write one-view scenes without semantic masks: a mug and, in every second test scene, a bowl."""
    for folder in ("training_set", "test_set"):
        for number in range(scenes):
            frame = scene(number)
            assert frame.instances is not None
            path = root / folder / f"scene_{number:05d}"
            save(path / "rgb_00002.jpeg", frame.rgb)
            save(path / "depth_00002.png", millimeters(frame))
            save(path / "segmentation_00002.png", frame.instances.astype(np.uint8))
            other = "02880940" if folder == "test_set" and number % 2 else "02946921"
            meshes = [f"/{synset}/a/model.obj" for synset in ("03797390", "02946921", other)]
            description = {"object_descriptions": [{"mesh_filename": mesh} for mesh in meshes]}
            (path / "scene_description.txt").write_text(json.dumps(description))


WRITERS = {"ocid": write_ocid, "ocid_zeroshot": write_ocid, "osd": write_osd, "mosd_pcd": write_mosd, "tod": write_tod}
CAMERA = "{" + ", ".join(f"{key}: {getattr(SCENE_CAMERA, key)}" for key in ("fx", "fy", "cx", "cy")) + "}"


@pytest.mark.parametrize("dataset", WRITERS)
def test_a_tree_goes_from_preparation_to_scores(
    command: Command,  # noqa: F811
    trained: Path,  # noqa: F811
    dataset: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if dataset == "mosd_pcd":
        pytest.importorskip("pypcd4", reason="needs the extra sgbd[pcd]")
    WRITERS[dataset](tmp_path / "data")
    options = [f"dataset={dataset}", f"dataset.root={tmp_path / 'data'}", "workers=0", f"dataset.intrinsics={CAMERA}"]
    if dataset == "mosd_pcd":
        options.append("dataset.resolution=[64,48]")
    assert command("prepare", *options, "superpixels.n_segments=12") == 0
    assert "Prepared" in capsys.readouterr().out
    assert command("evaluate", *options, f"checkpoint={trained}", "pictures=1", "hydra.run.dir=scored") == 0
    assert "skipped" not in capsys.readouterr().out
    scores = json.loads((tmp_path / "scored/scores.json").read_text())
    assert 0 < scores["oracle/overlap_f"] <= 1
    assert ("seen/overlap_f" in scores) == (dataset == "tod")
    assert list((tmp_path / "scored").rglob("*.png"))


@pytest.mark.parametrize("dataset", WRITERS)
def test_every_dataset_can_be_drawn(dataset: str, tmp_path: Path) -> None:
    if dataset == "mosd_pcd":
        pytest.importorskip("pypcd4", reason="needs the extra sgbd[pcd]")
    WRITERS[dataset](tmp_path)
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("prepare", [f"dataset={dataset}", f"dataset.root={tmp_path}"]).dataset
    source: FrameSource = instantiate(config, split="test")
    titles = [axis.get_title() for axis in source.plot(0).axes]
    assert titles[0] == source.names[0]
    assert "3 objects" in titles


def test_semantic_masks_are_written_by_a_command(
    command: Command,  # noqa: F811
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_tod(tmp_path / "tod", scenes=2)
    options = ("dataset=tod", f"dataset.root={tmp_path / 'tod'}", "workers=0")
    assert command("semantic_masks", *options, "+dataset.category_names=[can,mug]", "dataset.seen=[can]") == 0
    told = capsys.readouterr().out
    assert "train: 2 frames written" in told
    assert "test: objects of none of the categories, 0 in the masks: 1 bowl" in told
    mask = read_labels(tmp_path / "tod/training_set/scene_00000/semseg_00002.png")
    assert np.unique(mask).tolist() == [0, 1, 2, 3]
    assert command("semantic_masks", *options) == 0
    assert "train: 2 frames kept" in capsys.readouterr().out
    assert command("semantic_masks", "dataset=folder", f"dataset.root={tmp_path}", "splits=[test]") == 1
    assert "not in TOD's layout" in capsys.readouterr().err


def test_a_split_is_built_written_and_read(
    command: Command,  # noqa: F811
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    write_tod(tmp_path / "tod", scenes=10)
    seen = ",".join(sorted(TODZ_SEEN))
    options = (
        "dataset=tod", f"dataset.root={tmp_path / 'tod'}", "workers=0", f"seen=[{seen}]", "name=mine", "output=my list",
        "scene_shares={train: 0.4, val: 0.2, test: 0.4}", "train_frames=4",
    )  # fmt: skip
    assert command("split", *options) == 0
    told = capsys.readouterr().out
    report = (tmp_path / "my list/report.md").read_text()
    assert report in told
    assert "python -m sgbd.train --config-dir 'my list' dataset=mine" in told
    lists = {
        name: [line for line in (tmp_path / f"my list/{name}.txt").read_text().splitlines() if not line.startswith("#")]
        for name in ("train", "val", "test_open", "test_closed")
    }
    assert len(lists["train"]) == 4
    assert all(lists.values())
    everything = [line for lines in lists.values() for line in lines]
    assert len(set(everything)) == len(everything)
    for line in lists["test_open"]:
        assert line.startswith("test_set/"), "only scenes there show a bowl, which is unseen"
    # The written configuration reads all frames of the split without warnings.
    with caplog.at_level(logging.WARNING), initialize_config_dir(str(config_folder()), version_base="1.3"):
        for name, test in (("mine", "test_open"), ("mine_closed", "test_closed")):
            config = OmegaConf.load(tmp_path / f"my list/dataset/{name}.yaml")
            for split in ("train", "val", "test"):
                source = instantiate(config, split=split)
                assert type(source) is Tod
                expected = lists[test if split == "test" else split]
                read = [source.files(index)[0].relative_to(source.root).as_posix() for index in range(len(source))]
                assert read == expected
                assert source.seen == TODZ_SEEN
                assert source.category_names == TOD_CATEGORIES
    assert not caplog.records
    assert command("prepare", "--config-dir", "my list", "dataset=mine", "superpixels.n_segments=12", "workers=0") == 0


def test_groups_must_hold_every_category_once(
    command: Command,  # noqa: F811
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_tod(tmp_path / "tod", scenes=1)
    options = ("dataset=tod", f"dataset.root={tmp_path / 'tod'}", "workers=0")
    assert command("split", *options, "groups={one: [mug, mug]}") == 1
    assert "groups must hold each of the categories once: ashcan" in capsys.readouterr().err
    assert command("split", *options, "min_objects=4") == 1
    assert "2 frames are near-empty" in capsys.readouterr().err
