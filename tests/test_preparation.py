import errno
import functools
import json
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
import torch
from filelock import FileLock

import sgbd.preparation
from sgbd.adjacency import bounding_box_pairs
from sgbd.frame import Frame
from sgbd.graph import GraphBuilder, build_graph
from sgbd.graph_file import GraphFileError, read_graph
from sgbd.preparation import PreparationError, frame_fingerprint, graph_file_name, prepare
from sgbd.recipe import RecipeError, graph_recipe
from tests.boxes import Boxes, Grid, SlowGrid, write_boxes


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    write_boxes(tmp_path / "data", 3)
    return tmp_path / "data"


def prepared(dataset: Path, root: Path, **options: Any) -> Path:
    return prepare(Boxes(dataset), Grid(), GraphBuilder(), root, progress=False, **options) / "train"


def index_of(split: Path) -> dict[str, Any]:
    return dict(json.loads((split / "index.json").read_text()))


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.safetensors")}


def times(folder: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("*.safetensors")}


def test_graphs_index_and_recipe_of_a_split(dataset: Path, tmp_path: Path) -> None:
    source = Boxes(dataset)
    split = prepared(dataset, tmp_path / "cache")
    assert sorted(path.name for path in split.iterdir()) == [
        "index.json",
        *(f"train__scene_0__0000{number}.safetensors" for number in range(3)),
    ]
    index = index_of(split)
    assert index["names"] == [f"train/scene_0/0000{number}" for number in range(3)]
    assert index["category_names"] == ["mug", "bowl"]
    assert index["seen"] == ["mug"]
    assert index["skipped"] == []
    graphs = [build_graph(frame, Grid()(frame), category_names=source.category_names) for frame in source]
    for name, graph in zip(index["names"], graphs, strict=True):
        restored = read_graph(split / graph_file_name(name))
        assert list(restored.to_dict()) == list(graph.to_dict())
        assert all(torch.equal(restored[key], graph[key]) for key in graph.keys() if key != "name")  # noqa: SIM118
        assert restored.name == name
    assert index["nodes"] == [48, 48, 48]
    assert index["edges"] == [82, 82, 82]  # 6 x 8 squares: 6 * 7 + 5 * 8
    labels = torch.cat([graph.edge_label for graph in graphs])
    assert index["statistics"]["merge_share"] == pytest.approx(float((labels == 1).double().mean()))
    assert index["statistics"]["nodes_per_graph"] == 48
    assert set(index["statistics"]["seconds_per_frame"]) == {"read", "superpixels", "graph", "write"}
    recipe = json.loads((split.parent / "recipe.json").read_text())
    assert recipe == graph_recipe(source, Grid(), GraphBuilder())
    assert recipe["superpixels"] == {"_target_": "tests.boxes.Grid", "size": 4}


def test_nothing_is_made_twice(dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    split = prepared(dataset, tmp_path / "cache")
    before = times(split)
    monkeypatch.setattr(Boxes, "read", lambda *_: pytest.fail("a frame was read again"))
    assert prepared(dataset, tmp_path / "cache") == split
    assert times(split) == before


def test_splits_share_a_recipe_and_other_recipes_have_other_folders(dataset: Path, tmp_path: Path) -> None:
    write_boxes(dataset, 2, "test")
    cache = tmp_path / "cache"
    first = prepare(Boxes(dataset), Grid(), GraphBuilder(), cache, progress=False)
    assert prepare(Boxes(dataset, "test"), Grid(), GraphBuilder(), cache, progress=False) == first
    assert len(index_of(first / "test")["names"]) == 2
    # An explicitly given default does not change the recipe.
    assert prepare(Boxes(dataset), Grid(size=4), build_graph, cache, progress=False) != first
    others = {
        prepare(Boxes(dataset), superpixels, graph, cache, progress=False)
        for superpixels, graph in [
            (Grid(size=4), GraphBuilder()),
            (Grid(size=8), GraphBuilder()),
            (Grid(), GraphBuilder(bounding_box_pairs)),
            (Grid(), GraphBuilder(functools.partial(bounding_box_pairs))),
        ]
    }
    assert len(others) == 3
    assert first in others


def test_only_graphs_of_changed_and_new_frames_are_made_anew(dataset: Path, tmp_path: Path) -> None:
    split = prepared(dataset, tmp_path / "cache")
    before = times(split)
    changed = dataset / "train" / "scene_0" / "00001.npz"
    os.utime(changed, ns=(1, 1))
    (dataset / "train" / "scene_0" / "00000.npz").unlink()
    write_boxes(dataset / "more", 5)
    (dataset / "more/train/scene_1/00004.npz").rename(dataset / "train/scene_0/00009.npz")
    assert prepared(dataset, tmp_path / "cache") == split
    assert index_of(split)["names"] == [f"train/scene_0/0000{number}" for number in (1, 2, 9)]
    after = times(split)
    assert after["train__scene_0__00002.safetensors"] == before["train__scene_0__00002.safetensors"]
    assert after["train__scene_0__00001.safetensors"] != before["train__scene_0__00001.safetensors"]
    assert prepared(dataset, tmp_path / "cache") == split
    assert times(split) == after


@pytest.mark.parametrize("damage", ["cut", "missing", "index"])
def test_what_is_damaged_is_made_again(dataset: Path, tmp_path: Path, damage: str) -> None:
    split = prepared(dataset, tmp_path / "cache")
    before, stamps = contents(split), times(split)
    victim = split / "train__scene_0__00001.safetensors"
    if damage == "cut":
        victim.write_bytes(victim.read_bytes()[:-1])
    elif damage == "missing":
        victim.unlink()
    else:
        (split / "index.json").write_text("{")
    assert prepared(dataset, tmp_path / "cache") == split
    assert contents(split) == before
    assert [name for name, stamp in times(split).items() if stamp != stamps[name]] == (
        [] if damage == "index" else [victim.name]
    )


def test_a_broken_frame_is_named_skipped_and_tried_again(
    dataset: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    broken = dataset / "train" / "scene_0" / "00001.npz"
    good = broken.read_bytes()
    broken.write_bytes(good[:200])
    split = prepared(dataset, tmp_path / "cache")
    (entry,) = index_of(split)["skipped"]
    assert entry["name"] == "train/scene_0/00001"
    assert "BadZipFile" in entry["reason"]
    assert "1 of 3 frames of train were skipped" in caplog.text
    assert "train/scene_0/00001: BadZipFile" in caplog.text
    assert index_of(split)["names"] == ["train/scene_0/00000", "train/scene_0/00002"]
    stamps = times(split)

    caplog.clear()
    prepared(dataset, tmp_path / "cache")
    assert "train/scene_0/00001: BadZipFile" in caplog.text, "it has to be named each time"

    broken.write_bytes(good)
    prepared(dataset, tmp_path / "cache")
    index = index_of(split)
    assert index["skipped"] == []
    assert len(index["names"]) == 3
    assert stamps.items() <= times(split).items()


def test_a_broken_frame_is_fatal_on_request_and_the_others_are_kept(dataset: Path, tmp_path: Path) -> None:
    broken = dataset / "train" / "scene_0" / "00002.npz"
    broken.write_bytes(b"")
    with pytest.raises(PreparationError, match=r"frame train/scene_0/00002 of train failed \(EOFError.*on_error=skip"):
        prepared(dataset, tmp_path / "cache", on_error="fail")
    (split,) = (tmp_path / "cache").glob("*/train")
    assert len(contents(split)) == 2
    assert not (split / "index.json").exists()


def test_when_every_frame_fails_skipping_is_no_help(dataset: Path, tmp_path: Path) -> None:
    for path in dataset.rglob("*.npz"):
        path.write_bytes(b"not a frame")
    with pytest.raises(PreparationError, match=r"every frame of train failed[^§]*train/scene_0/00002: "):
        prepared(dataset, tmp_path / "cache")
    assert list((tmp_path / "cache").rglob("index.json")) == []


def test_frames_that_vanish_leave_no_index_that_promises_them(dataset: Path, tmp_path: Path) -> None:
    split = prepared(dataset, tmp_path / "cache")
    for path in dataset.rglob("*.npz"):
        path.write_bytes(b"not a frame")
    with pytest.raises(PreparationError, match="every frame"):
        prepared(dataset, tmp_path / "cache")
    assert not (split / "index.json").exists()


def test_a_full_disk_is_fatal_and_leaves_whole_graphs(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fsync, written = os.fsync, []

    def full(descriptor: int) -> None:
        written.append(descriptor)
        if len(written) == 3:  # the recipe, one graph, and half of this one
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(GraphFileError, match=r"00001\.safetensors: the disk is full \(\d+ MiB free"):
        prepared(dataset, tmp_path / "cache", on_error="skip")
    (split,) = (tmp_path / "cache").glob("*/train")
    assert [path.name for path in split.iterdir()] == ["train__scene_0__00000.safetensors"]
    monkeypatch.undo()
    prepared(dataset, tmp_path / "cache")
    assert len(index_of(split)["names"]) == 3


def test_a_cache_folder_that_cannot_be_made(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(PreparationError, match=r"cannot write .*Choose a cache folder that can be written"):
        prepared(dataset, tmp_path / "file")


def test_the_number_of_workers_changes_nothing(tmp_path: Path) -> None:
    write_boxes(tmp_path / "data", 18)
    (tmp_path / "data/train/scene_1/00005.npz").write_bytes(b"")
    alone = prepared(tmp_path / "data", tmp_path / "alone")
    together = prepared(tmp_path / "data", tmp_path / "together", workers=2)
    assert together.parent.name == alone.parent.name
    assert contents(together) == contents(alone)
    assert len(contents(alone)) == 17
    assert (together.parent / "recipe.json").read_bytes() == (alone.parent / "recipe.json").read_bytes()
    first, second = index_of(alone), index_of(together)
    del first["statistics"]["seconds_per_frame"], second["statistics"]["seconds_per_frame"]
    assert first == second


SCRIPT = """
import logging, sys
sys.path.insert(0, {repository!r})
from tests.boxes import Boxes, SlowGrid
from sgbd.graph import GraphBuilder
from sgbd.preparation import prepare
if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    prepare(Boxes({data!r}), SlowGrid(), GraphBuilder(), {cache!r}, workers={workers})
"""


def start(folder: Path, workers: int, seconds: float) -> "subprocess.Popen[str]":
    """Prepare in another process, slowly enough that it is still running when the test continues on a busy machine."""
    script = folder / "prepare_boxes.py"
    script.write_text(
        SCRIPT.format(
            repository=str(Path(__file__).parents[1]),
            data=str(folder / "data"),
            cache=str(folder / "cache"),
            workers=workers,
        )
    )
    environment = {**os.environ, "SLOW_GRID_SECONDS": str(seconds)}
    return subprocess.Popen(
        [sys.executable, str(script)], stderr=subprocess.PIPE, text=True, start_new_session=True, env=environment
    )


MANY = 30


def wait_for_graphs(cache: Path, count: int) -> Path:
    for _ in range(6000):
        files = list(cache.glob("*/train/*.safetensors"))
        if len(files) >= count:
            return files[0].parent
        time.sleep(0.05)
    pytest.fail(f"no {count} graphs after five minutes")


@pytest.fixture
def many(tmp_path: Path) -> Iterator[Path]:
    write_boxes(tmp_path / "data", MANY)
    yield tmp_path
    for process in psutil.process_iter(["cmdline"]):
        assert str(tmp_path) not in " ".join(process.info["cmdline"] or []), "a process is left behind"


def test_killed_at_any_moment_it_goes_on_where_it_was(many: Path, caplog: pytest.LogCaptureFixture) -> None:
    process = start(many, workers=2, seconds=0.5)
    split = wait_for_graphs(many / "cache", 5)
    workers = psutil.Process(process.pid).children(recursive=True)
    assert len(workers) >= 2
    process.kill()
    process.communicate()
    assert psutil.wait_procs(workers, timeout=300)[1] == [], "workers outlive the process that was killed"
    assert not (split / "index.json").exists()
    kept = times(split)
    assert 5 <= len(kept) < MANY
    (split / ".half.safetensors.1.tmp").write_bytes(b"what a kill in the middle of writing leaves")

    with caplog.at_level(logging.INFO, "sgbd.preparation"):
        prepare(Boxes(many / "data"), SlowGrid(), GraphBuilder(), many / "cache", progress=False)
    assert len(index_of(split)["names"]) == MANY
    assert kept.items() <= times(split).items(), "graphs that were done were made again"
    assert f"{MANY - len(kept)} graphs made" in caplog.text
    assert not list(split.glob(".*"))


def test_interrupted_it_stops_cleanly_and_says_how_to_go_on(many: Path) -> None:
    process = start(many, workers=2, seconds=0.5)
    split = wait_for_graphs(many / "cache", 3)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does, also to the workers
    errors = process.communicate(timeout=300)[1]
    assert process.returncode not in (0, None)
    assert f"of {MANY} graphs of train are prepared and kept; run the same command again to go on" in errors
    assert errors.count("Traceback") <= 1, f"only this script itself may show one:\n{errors}"
    assert not list(split.glob(".*"))
    for path in split.glob("*.safetensors"):
        read_graph(path)


def test_of_two_processes_one_prepares_and_the_other_waits(many: Path, caplog: pytest.LogCaptureFixture) -> None:
    other = start(many, workers=0, seconds=0.2)
    split = wait_for_graphs(many / "cache", 2)
    with caplog.at_level(logging.INFO, "sgbd.preparation"):
        prepare(Boxes(many / "data"), SlowGrid(), GraphBuilder(), many / "cache", progress=False)
    assert f"{MANY} graphs made" in other.communicate(timeout=300)[1]
    assert other.returncode == 0
    assert "another process prepares" in caplog.text
    assert "graphs made" not in caplog.text
    assert len(index_of(split)["names"]) == MANY


def test_while_another_process_prepares_this_one_waits(
    dataset: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    split = prepared(dataset, tmp_path / "cache")
    index = (split / "index.json").read_bytes()
    (split / "index.json").unlink()
    stamps = times(split)
    lock = FileLock(split.parent / "train.lock", thread_local=False)
    lock.acquire()

    def finish() -> None:  # as the other process does
        time.sleep(0.5)
        (split / "index.json").write_bytes(index)
        lock.release()

    other = threading.Thread(target=finish)
    with caplog.at_level(logging.INFO, "sgbd.preparation"):
        other.start()
        prepared(dataset, tmp_path / "cache")
    other.join()
    assert "another process prepares" in caplog.text
    assert "graphs made" not in caplog.text
    assert times(split) == stamps


def test_a_finished_cache_can_be_read_only(dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    split = prepared(dataset, tmp_path / "cache")

    def refuse(*_: Any, **__: Any) -> None:
        raise PermissionError(errno.EACCES, "read-only")

    for method in ("mkdir", "unlink", "replace"):
        monkeypatch.setattr(Path, method, refuse)
    monkeypatch.setattr(sgbd.preparation, "one_process_at_a_time", refuse)
    monkeypatch.setattr(sgbd.preparation, "write_whole", refuse)
    assert prepared(dataset, tmp_path / "cache") == split


class Named(Boxes):
    """Boxes with different names."""

    chosen: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return self.chosen


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "'train' of Named has no frames"),
        (("a", "b", "a"), "'a' occurs twice"),
        (("a/b", "a__b"), "'a/b' and 'a__b' would share the file a__b.safetensors: rename one"),
        (("../a",), "cannot be a file name"),
        (("a" * 300,), "too long"),
    ],
)
def test_names_that_cannot_be_files(dataset: Path, tmp_path: Path, names: tuple[str, ...], message: str) -> None:
    source = Named(dataset)
    source.chosen = names
    with pytest.raises(PreparationError, match=message):
        prepare(source, Grid(), GraphBuilder(), tmp_path / "cache", progress=False)


def test_bad_options(dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(PreparationError, match="on_error must be 'skip' or 'fail'; got 'ignore'"):
        prepared(dataset, tmp_path / "cache", on_error="ignore")
    with pytest.raises(RecipeError, match=r"superpixels: .*no importable name"):
        prepare(Boxes(dataset), lambda frame: Grid()(frame), GraphBuilder(), tmp_path / "cache")


def narrow_graph(frame: Frame, label_map: Any, category_names: Any = ()) -> Any:
    data = build_graph(frame, label_map, category_names=category_names)
    data.x = data.x[:, :3]
    return data


def test_undeclared_columns_are_an_error(dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(PreparationError, match=r"have 3 node features, but 21 columns are named"):
        prepare(Boxes(dataset), Grid(), narrow_graph, tmp_path / "cache", progress=False)


def test_the_fingerprint_of_a_frame_follows_its_file(dataset: Path) -> None:
    source = Boxes(dataset)
    before = [frame_fingerprint(source, index) for index in range(3)]
    assert len(set(before)) == 3
    assert [frame_fingerprint(Boxes(dataset), index) for index in range(3)] == before
    source.files(1)[0].write_bytes(b"longer or shorter")
    source.files(2)[0].unlink()
    after = [frame_fingerprint(source, index) for index in range(3)]
    assert [a == b for a, b in zip(before, after, strict=True)] == [True, False, False]


def test_the_report_is_logged(dataset: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "sgbd.preparation"):
        prepared(dataset, tmp_path / "cache")
        prepared(dataset, tmp_path / "cache")
    assert "train: 3 graphs made in" in caplog.text
    assert "0 kept, 0 skipped; 48 nodes and 82 edges a graph" in caplog.text
    assert "train of boxes is prepared already" in caplog.text
