"""The commands as typed by users, from files to files, on small frames with edge cases."""

from __future__ import annotations

import errno
import importlib
import json
import logging
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pandas as pd
import pytest
from hydra.core.hydra_config import HydraConfig

from sgbd.checkpoint import Checkpoint
from sgbd.frame import Frame
from tests.desk import desk
from tests.scenes import scene

SMALL = ("dataset=folder", "superpixels.n_segments=12", "trainer.epochs=2", "trainer.progress=false", "logger=csv")

Command = Callable[..., int]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Run a command in this process and return its exit status; Hydra's global state is reset afterwards."""
    handlers, level = logging.root.handlers[:], logging.root.level
    monkeypatch.chdir(tmp_path)

    def run(entry: str, *arguments: str) -> int:
        monkeypatch.setattr(sys, "argv", [entry, *arguments])
        try:
            importlib.import_module(f"sgbd.{entry}").main()
        except SystemExit as end:
            return int(end.code or 0)
        return 0

    yield run
    for handler in logging.root.handlers:
        if handler not in handlers and isinstance(handler, logging.FileHandler):
            handler.close()
    logging.root.handlers[:] = handlers
    logging.root.setLevel(level)
    HydraConfig.instance().cfg = None


def write(frame: Frame, name: str, folder: Path, truth: bool = True) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    iio.imwrite(folder / f"{name}_rgb.png", frame.rgb)
    iio.imwrite(folder / f"{name}_depth.png", (1000 * frame.depth).round().astype(np.uint16))
    if truth:
        iio.imwrite(folder / f"{name}_labels.png", frame.instances.astype(np.uint8))


def crop(frame: Frame, height: int, width: int) -> Frame:
    return replace(
        frame, rgb=frame.rgb[:height, :width], depth=frame.depth[:height, :width],
        instances=np.ones((height, width), np.int32), categories={},
    )  # fmt: skip


def hard_frames(folder: Path) -> None:
    """Write frames with one instance, without any object, with one superpixel, and with one pixel."""
    flat = np.ones((40, 56), np.float32)
    gray = np.full((40, 56, 3), 120, np.uint8)
    write(Frame(gray, flat, instances=np.zeros(flat.shape, np.int32)), "one_instance", folder)
    table = np.where(np.arange(40)[:, None] < 20, 0, 1).repeat(56, 1).astype(np.int32)
    write(Frame(gray + 60 * table[..., None].astype(np.uint8), flat + table, instances=table), "no_object", folder)
    write(crop(scene(20), 4, 6), "few_pixels", folder)
    write(crop(scene(20), 1, 1), "one_pixel", folder)


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    for split, numbers in {"train": range(3), "val": range(3, 5), "test": range(5, 7)}.items():
        for number in numbers:
            write(scene(number), f"scene{number}", tmp_path / "frames" / split)
    return tmp_path / "frames"


@pytest.mark.parametrize(
    "options",
    [
        ("model=mlp", "superpixels=slic_fast"),
        ("model=gated_gcn", "superpixels=slic_reference", "features=all", "partition=multicut"),
        ("model=attention", "superpixels=slic_fast", "graph=bounding_box"),
    ],
    ids=lambda options: options[0],
)
def test_hard_frames_go_through_every_command(
    command: Command, frames: Path, options: tuple[str, ...], tmp_path: Path
) -> None:
    for split in ("train", "val", "test"):
        hard_frames(frames / split)
    assert (
        command("train", *SMALL, *options, "pictures=0", f"dataset.root={frames}", "workers=0", "hydra.run.dir=trained")
        == 0
    )
    result = json.loads((tmp_path / "trained" / "result.json").read_text())
    assert 0 <= result["scores"]["all/overlap_f"] <= 1
    evaluated = ("dataset=folder", f"dataset.root={frames}", "checkpoint=trained", "workers=0", "pictures=1")
    assert command("evaluate", *evaluated, "hydra.run.dir=evaluated") == 0
    assert json.loads((tmp_path / "evaluated" / "scores.json").read_text()) == result["scores"]
    assert f"root: {frames}" in (tmp_path / "evaluated" / "config.yaml").read_text()
    assert command("predict", f"rgb={frames / 'test'}", "checkpoint=trained", "output=predicted") == 0
    assert iio.imread(tmp_path / "predicted" / "one_pixel_labels.png").shape == (1, 1)
    assert len(list((tmp_path / "predicted").glob("*.json"))) == 6
    assert command("predict", f"rgb={frames / 'test'}", "checkpoint=trained", "output=reduced", "reduce=2") == 0
    sizes = [
        {path.name: iio.imread(path).shape for path in (tmp_path / folder).glob("*_labels.png")}
        for folder in ("predicted", "reduced")
    ]
    assert sizes[0] == sizes[1]


OWN = """
import numpy as np
from sgbd.models import EdgeClassifier
from sgbd.partition import ConnectedComponents
from sgbd.sampling import BalancedEdgeSampler
from sgbd.sources import Folder

class Model(EdgeClassifier):
    def score(self, source, target, edge):
        return 2 - (source - target).abs().sum(1) + sum(self.parameters()).sum()

    def __init__(self, node_channels, edge_channels):
        super().__init__(node_channels, edge_channels)
        self.bias = __import__("torch").nn.Parameter(__import__("torch").zeros(1))

class Partition(ConnectedComponents):
    pass

class Squares:
    def __init__(self, size=8):
        self.size = size

    def __call__(self, frame):
        rows, columns = np.indices(frame.depth.shape) // self.size
        return (rows * (columns.max() + 1) + columns).astype(np.int32)

class Sampler(BalancedEdgeSampler):
    pass

class Frames(Folder):
    pass

class NoFrames:
    def __init__(self, root, split="test"):
        pass
"""


def test_classes_of_ones_own_go_through_every_command(
    command: Command, frames: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "things_of_ones_own.py").write_text(OWN)
    monkeypatch.syspath_prepend(str(tmp_path))
    groups = {"model": "Model", "partition": "Partition", "superpixels": "Squares", "sampler": "Sampler"}
    for group, name in {**groups, "dataset": "Frames"}.items():
        (tmp_path / "own" / group).mkdir(parents=True)
        (tmp_path / "own" / group / "mine.yaml").write_text(f"_target_: things_of_ones_own.{name}\n")
    data = ("--config-dir", "own", "dataset=mine", f"+dataset.root={frames}", "workers=0", "pictures=0")
    chosen = (*(f"{group}=mine" for group in groups), "trainer.epochs=1", "trainer.progress=false", "logger=csv")
    assert command("train", *data, *chosen, "hydra.run.dir=trained") == 0
    assert command("evaluate", *data, "checkpoint=trained", "trust=things_of_ones_own", "hydra.run.dir=scored") == 0
    assert (tmp_path / "scored" / "scores.json").read_text() == (tmp_path / "trained" / "scores.json").read_text()
    second = ("superpixels=mine", "graph=agglomerated", "graph.first_stage=trained", *chosen[-3:])
    assert command("train", *data, *second, "hydra.run.dir=second") == 0
    assert command("evaluate", *data, "checkpoint=second", "trust=things_of_ones_own", "hydra.run.dir=scored2") == 0
    assert (tmp_path / "scored2" / "scores.json").read_text() == (tmp_path / "second" / "scores.json").read_text()
    predicted = (f"rgb={frames / 'test'}", "checkpoint=trained", "output=predicted")
    assert command("predict", *predicted, "trust=[things_of_ones_own]") == 0
    assert len(list((tmp_path / "predicted").glob("*.json"))) == 2
    capsys.readouterr()
    assert command("predict", *predicted) == 1
    assert "trust=['things_of_ones_own']" in capsys.readouterr().err
    assert command("prepare", *data[:-1], "dataset._target_=things_of_ones_own.NoFrames") == 1
    assert "dataset: things_of_ones_own.NoFrames is no sgbd.sources.source.FrameSource" in capsys.readouterr().err


def test_a_checkpoint_is_tuned_into_another_file(
    command: Command, frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = (f"dataset.root={frames}", "workers=0", "dataset=folder")
    assert command("train", *SMALL, *data, "pictures=0", "hydra.run.dir=trained") == 0
    trained = tmp_path / "trained" / "checkpoint.safetensors"
    before = trained.read_bytes()
    capsys.readouterr()
    tune = (*data, "checkpoint=trained", "tuning.threshold=[0.3,0.7]", "tuning.rounds=0", "partition=multicut")
    assert command("tune", *tune, "hydra.run.dir=tuned") == 0
    assert "on 2 frames of val: mean of overlap F, F@.75, boundary F" in capsys.readouterr().out
    assert trained.read_bytes() == before
    old, new = (Checkpoint.load(tmp_path / name / "checkpoint.safetensors") for name in ("trained", "tuned"))
    best = pd.read_csv(tmp_path / "tuned" / "tuning.csv").iloc[0]
    assert new.recipe["partition"]["_target_"] == "sgbd.partition.GreedyMulticut"
    assert new.recipe["partition"]["threshold"] == best["threshold"]
    assert new.recipe["objects"]["min_objectness"] == best["min_objectness"]
    assert new.recipe["tuning"]["frames"] == 2
    assert new.recipe["dataset"] == old.recipe["dataset"]
    weights = new.model.state_dict()
    assert all(value.equal(weights[key]) for key, value in old.model.state_dict().items())
    # Its scores on the same frames equal those found by the search.
    assert command("evaluate", *data, "checkpoint=tuned", "split=val", "pictures=0", "hydra.run.dir=scored") == 0
    scores = json.loads((tmp_path / "scored" / "scores.json").read_text())
    for name in ("overlap_f", "f75", "boundary_f"):
        assert scores[f"unaided/{name}"] == pytest.approx(best[name])
    # Impossible requests are reported before anything is written.
    assert command("tune", *tune, "output=trained", "hydra.run.dir=again") == 1
    assert "output=trained is the checkpoint that is to be tuned; name another file" in capsys.readouterr().err
    assert trained.read_bytes() == before
    assert command("tune", *data, "checkpoint=trained", "tuning=none", "hydra.run.dir=again") == 1
    assert "use tuning=validation" in capsys.readouterr().err
    assert command("tune", *tune, "split=dev", "hydra.run.dir=again") == 1
    assert "no split 'dev'" in capsys.readouterr().err


def test_reading_from_the_cache_or_memory_with_any_number_of_processes_gives_one_result(
    command: Command, frames: Path, tmp_path: Path
) -> None:
    here = (*SMALL, f"dataset.root={frames}", "pictures=0")
    assert command("train", *here, "in_memory=true", "workers=0", "hydra.run.dir=a") == 0
    other = ("in_memory=false", "workers=2", "trainer.num_workers=1", "cache_dir=graphs_of_b")
    assert command("train", *here, *other, "hydra.run.dir=b") == 0
    assert (tmp_path / "a/checkpoint.safetensors").read_bytes() == (tmp_path / "b/checkpoint.safetensors").read_bytes()
    assert (tmp_path / "a/scores.json").read_bytes() == (tmp_path / "b/scores.json").read_bytes()


def test_frames_without_truth_are_left_out_and_named(
    command: Command, frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for split in ("train", "val", "test"):
        write(scene(9), "unlabelled", frames / split, truth=False)
    here = (*SMALL, f"dataset.root={frames}", "workers=0", "pictures=0")
    assert command("train", *here, "hydra.run.dir=trained") == 0
    told = capsys.readouterr().err
    for split, count in {"train": 4, "val": 3, "test": 3}.items():
        assert f"left out: 1 of {count} frames of {split} have no ground truth: unlabelled" in told
    assert "scene5" in (tmp_path / "trained/frames.csv").read_text()
    assert "unlabelled" not in (tmp_path / "trained/frames.csv").read_text()
    assert command("train", *here, "on_error=fail", "hydra.run.dir=strict") == 1
    assert "1 of 4 frames of train have no ground truth: unlabelled. Give label images" in capsys.readouterr().err


@pytest.mark.parametrize("entry", ["prepare", "train", "evaluate"])
@pytest.mark.parametrize("dataset", ["folder", "mosd", "mosd_pcd", "ocid", "osd", "tod"])
def test_a_missing_folder_says_what_is_expected(
    command: Command, entry: str, dataset: str, frames: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    trained: Path,
) -> None:  # fmt: skip
    model = (f"checkpoint={trained}",) if entry == "evaluate" else ()
    assert command(entry, f"dataset={dataset}", "dataset.root=nowhere", *model, "hydra.run.dir=run") == 1
    told = capsys.readouterr().err
    assert "nowhere" in told
    assert "uint16" in told, "the layout"
    assert "dataset=tabletop" in told, "a way out"
    assert "Traceback" not in told


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The checkpoint of an untrained model, which is sufficient for these tests."""
    from hydra import compose, initialize_config_dir
    from hydra.utils import instantiate
    from omegaconf import OmegaConf

    from sgbd.checkpoint import Checkpoint
    from sgbd.jobs.configuration import config_folder
    from sgbd.recipe import describe

    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("train", ["objectness=none", "superpixels.n_segments=12"])
    model = {**OmegaConf.to_container(config.model), "node_channels": 9, "edge_channels": 0}
    recipe = {
        "superpixels": describe(instantiate(config.superpixels), "superpixels"),
        "graph": describe(instantiate(config.graph), "graph"),
        "features": {"node": ["rgb", "position", "depth", "normal"], "edge": []},
        "model": model,
        "objectness": None,
        "partition": OmegaConf.to_container(config.partition),
        "objects": OmegaConf.to_container(config.objects),
    }
    path = tmp_path_factory.mktemp("model") / "checkpoint.safetensors"
    Checkpoint(instantiate(config.model, node_channels=9, edge_channels=0), None, recipe).save(path)
    return path


@pytest.fixture
def full_after(monkeypatch: pytest.MonkeyPatch):
    """Simulate a full disk when a file with one of the given names is synced."""
    fsync = os.fsync

    def fill(*names: str) -> None:
        def refuse(descriptor: int) -> None:
            path = Path(f"/proc/self/fd/{descriptor}").readlink()
            if any(name in path.name for name in names):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            fsync(descriptor)

        monkeypatch.setattr(os, "fsync", refuse)

    yield fill
    monkeypatch.setattr(os, "fsync", fsync)


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="tells files by their descriptors as Linux does")
def test_a_disk_that_is_full_in_training_costs_no_finished_epoch(
    command: Command, frames: Path, full_after, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here = (*SMALL, f"dataset.root={frames}", "workers=0", "pictures=0")
    assert command("train", *here, "hydra.run.dir=whole") == 0
    # The disk gets full at successively later steps.
    in_training = ("checkpoint.safetensors", "state.pt", "history.csv", "history.csv")
    for file in (*in_training, "curves.png", "frames.csv", "result.json"):
        full_after(f".{file}.")
        assert command("train", *here, "hydra.run.dir=broken") == 1
        told = capsys.readouterr().err
        assert f"the disk is full while writing {tmp_path / 'broken' / file}" in told
        assert f"go on with: python -m sgbd.train {' '.join(here)} hydra.run.dir=" in told
        assert not list((tmp_path / "broken").glob("*.tmp"))
    full_after()
    assert command("train", *here, "hydra.run.dir=broken") == 0
    for same in ("checkpoint.safetensors", "scores.json"):
        assert (tmp_path / "whole" / same).read_bytes() == (tmp_path / "broken" / same).read_bytes()
    assert pd.read_csv(tmp_path / "broken" / "history.csv")["epoch"].tolist() == [1, 2]


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="tells files by their descriptors as Linux does")
@pytest.mark.parametrize("file", ["scores.md", "frames.csv", "1_scene"])
def test_a_disk_that_is_full_in_evaluation(
    command: Command, frames: Path, file: str, full_after, trained: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    full_after(f".{file}")
    here = ("dataset=folder", f"dataset.root={frames}", f"checkpoint={trained}", "workers=0", "pictures=1")
    assert command("evaluate", *here, "hydra.run.dir=run") == 1
    told = capsys.readouterr().err
    assert "the disk is full while writing" in told
    assert file in told
    assert not [path for path in (tmp_path / "run").rglob("*") if file in path.name], "neither half a file nor litter"


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="tells files by their descriptors as Linux does")
def test_a_disk_that_is_full_in_prediction_leaves_whole_files(
    command: Command, frames: Path, full_after, trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    full_after("scene6_overlay")
    assert command("predict", f"rgb={frames / 'test'}", f"checkpoint={trained}", "output=out") == 1
    assert "the disk is full while writing out/scene6_overlay.png" in capsys.readouterr().err
    written = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert written == [
        "scene5.json",
        "scene5_labels.png",
        "scene5_overlay.png",
        "scene6.json",
        "scene6_labels.png",
    ]


def test_prediction_does_not_replace_ground_truth(
    command: Command, frames: Path, trained: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = frames / "test"
    before = (folder / "scene5_labels.png").read_bytes()
    assert command("predict", f"rgb={folder}", f"checkpoint={trained}", f"output={folder}") == 1
    assert "2 label images of the frames themselves would be replaced, such as" in capsys.readouterr().err
    assert (folder / "scene5_labels.png").read_bytes() == before


def test_prediction_needs_no_trained_model(command: Command, tmp_path: Path) -> None:
    frame = desk()
    write(frame, "desk", tmp_path / "frames")
    camera = "intrinsics={fx: 525, fy: 525, cx: 319.5, cy: 239.5}"
    assert command("predict", "rgb=frames/desk_rgb.png", "depth=frames/desk_depth.png", camera, "output=out") == 0
    objects = json.loads((tmp_path / "out/desk.json").read_text())["objects"]
    labels = iio.imread(tmp_path / "out/desk_labels.png")
    assert len(objects) == labels.max() > 0
    assert np.mean(frame.instances[labels > 0] > 1) > 0.75, "objects, not the table"


def test_prediction_names_what_it_cannot_read_and_goes_on(
    command: Command, frames: Path, trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = frames / "test"
    frame = scene(7)
    for name, depth in {
        "bits": (frame.depth * 50).astype(np.uint8),
        "colours": np.zeros((*frame.depth.shape, 3), np.uint8),
        "missing": np.zeros(frame.depth.shape, np.uint16),
        "size": np.full((10, 10), 1000, np.uint16),
    }.items():
        write(frame, name, folder)
        iio.imwrite(folder / f"{name}_depth.png", depth)
    write(frame, "cut", folder)
    whole = (folder / "cut_depth.png").read_bytes()
    (folder / "cut_depth.png").write_bytes(whole[: len(whole) // 2])
    assert command("predict", f"rgb={folder}", f"checkpoint={trained}", "output=out") == 0
    said = capsys.readouterr()
    for name in ("bits", "colours", "missing", "size", "cut"):
        assert f"skipped {name}: " in said.err
    assert "Objects of 2 frames: out (5 skipped)" in said.out
    assert sorted(path.stem for path in (tmp_path / "out").glob("*.json")) == ["scene5", "scene6"]
    assert command("predict", f"rgb={folder}", f"checkpoint={trained}", "output=strict", "on_error=fail") == 1
