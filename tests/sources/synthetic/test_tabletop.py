"""The dataset on disk: written completely and once, independent of the number of workers, and readable as TOD."""

from __future__ import annotations

import errno
import json
import shutil
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hydra.utils import instantiate
from omegaconf import OmegaConf
from PIL import Image

pytest.importorskip("mujoco", reason="needs the extra sgbd[synthetic]")
pytest.importorskip("embreex", reason="needs the extra sgbd[synthetic]")
pytest.importorskip("trimesh", reason="needs the extra sgbd[synthetic]")

from sgbd.sources import TOD_CATEGORIES, TODZ_SEEN, DatasetNotFoundError, Tod
from sgbd.sources.synthetic import GenerationError, MissingExtraError, Tabletop, generation, scene
from sgbd.sources.synthetic.variety import VARIETIES

SIZES: dict[str, Any] = {
    "train_frames": 3,
    "val_frames": 1,
    "test_frames": 4,
    "views_per_scene": 2,
    "objects": (3, 4),
    "resolution": (96, 72),
    "seed": 1,
}
CONF = Path(__file__).parents[3] / "conf" / "dataset"


def contents(root: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A generated dataset; tests that modify it use a copy."""
    folder = tmp_path_factory.mktemp("tabletop")
    Tabletop(folder, **SIZES).generate(workers=0, progress=False)
    return folder


def copied(root: Path, target: Path) -> Path:
    shutil.copytree(root, target / "copy")
    return target / "copy"


def test_all_splits_are_written_in_the_layout_of_tod(root: Path) -> None:
    source = Tabletop(root, "test", **SIZES)
    assert source.generated
    assert source.splits == ("train", "val", "test")
    assert [len(Tabletop(root, split, **SIZES)) for split in ("train", "val", "test")] == [3, 1, 4]
    plain = Tod(source.root, "test")
    assert plain.names == source.names == tuple(f"test_set/scene_0000{k}/0000{v}" for k in (0, 1) for v in (2, 3))
    frame = source[0]
    assert frame.rgb.shape == (72, 96, 3)
    assert frame.depth.min() > 0
    assert frame.camera.fx == pytest.approx(0.89 * 96)
    np.testing.assert_array_equal(frame.depth, plain[0].depth)


def test_training_and_validation_frames_hold_seen_categories_only(root: Path) -> None:
    for split in ("train", "val"):
        for frame in Tabletop(root, split, **SIZES):
            assert set(frame.categories.values()) <= TODZ_SEEN
            assert frame.categories


def test_test_frames_hold_unseen_categories_too(root: Path) -> None:
    held = {name for frame in Tabletop(root, "test", **SIZES) for name in frame.categories.values()}
    assert held - TODZ_SEEN
    assert held <= set(TOD_CATEGORIES)


def test_packaging_is_an_object_without_a_category(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    boxes = replace(VARIETIES["wide"], packaging=1.0)
    monkeypatch.setitem(VARIETIES, "wide", boxes)
    options = {**SIZES, "train_frames": 1, "val_frames": 0, "test_frames": 0, "variety": "wide", "sensor": "varied"}
    source = Tabletop(tmp_path, "train", **options)
    source.generate(workers=0, progress=False)
    frame = source[0]
    assert frame.categories == {}
    assert frame.instances is not None
    assert len(source.objects(0)) == len(np.unique(frame.instances[frame.instances > 1])) >= 1
    assert {item.category for item in source.objects(0)} == {None}
    description = json.loads((source.root / "training_set/scene_00000/scene_description.txt").read_text())
    assert {item["category"] for item in description["object_descriptions"]} <= {"carton", "roll"}
    assert {item["synset"] for item in description["object_descriptions"]} == {None}
    focal = description["intrinsics"]["fx"]
    assert frame.camera.fx == pytest.approx(focal)
    assert 0.78 * 96 <= focal <= 1.08 * 96


def test_frames_are_chosen_and_objects_ignored_without_making_anything_anew(root: Path) -> None:
    category = next(iter(Tabletop(root, "train", **SIZES)[0].categories.values()))
    source = Tabletop(root, "train", **SIZES, seen=[category], unseen_objects="ignore", max_train_frames=2)
    assert source.generated
    assert source.root == Tabletop(root, "train", **SIZES).root
    assert len(source) == 2
    assert {name for frame in source for name in frame.categories.values()} <= {category}
    assert any((frame.instances == -1).any() for frame in source if frame.instances is not None)
    assert source.seen == {category}
    assert len(Tabletop(root, "test", **SIZES, seen=[category], max_train_frames=2)) == 4


def test_the_description_agrees_with_the_masks(root: Path) -> None:
    source = Tabletop(root, "test", **SIZES)
    for index, frame in enumerate(source):
        folder, _, view = source.names[index].rpartition("/")
        description = json.loads((source.root / folder / "scene_description.txt").read_text())
        assert frame.instances is not None
        for item in description["object_descriptions"]:
            visible = int((frame.instances == item["instance"]).sum())
            assert item["visible_pixels"][int(view) - 2] == visible
            if visible:
                assert frame.categories[item["instance"]] == item["category"]
        assert 3 <= len(description["object_descriptions"]) <= 4
        assert len(description["views"]) == 2


def test_depth_is_uint16_millimetres(root: Path) -> None:
    path = next(Tabletop(root, **SIZES).root.rglob("depth_*.png"))
    depth = np.asarray(Image.open(path))
    assert depth.dtype == np.uint16
    assert 300 < np.median(depth) < 6000


def test_worker_processes_write_the_same_bytes(root: Path, tmp_path: Path) -> None:
    other = Tabletop(tmp_path, **SIZES)
    other.generate(workers=2, progress=False)
    assert contents(other.root) == contents(Tabletop(root, **SIZES).root)


def test_what_is_there_is_not_made_again(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generation, "write_scene", forbidden)
    monkeypatch.setattr(generation, "require_extra", forbidden)
    Tabletop(root, **SIZES).generate(workers=0, progress=False)


def test_a_killed_generation_continues_where_it_stopped(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = Tabletop(copied(root, tmp_path), **SIZES)
    before = contents(source.root)
    # The state after a kill: no lists yet, one scene missing and another one partly written.
    for name in ("train.txt", "val.txt", "test.txt"):
        (source.root / name).unlink()
    shutil.rmtree(source.root / "test_set" / "scene_00001")
    half = source.root / "test_set" / ".scene_00001.4711"
    half.mkdir()
    (half / "rgb_00002.jpeg").write_bytes(b"\xff\xd8 truncated")
    with pytest.raises(DatasetNotFoundError, match="was not finished"):
        len(Tabletop(tmp_path / "copy", **SIZES))
    written = []
    write_scene = generation.write_scene

    def record(*arguments: Any) -> Path:
        written.append(arguments[2:])
        return write_scene(*arguments)

    monkeypatch.setattr(generation, "write_scene", record)
    source.generate(workers=0, progress=False)
    assert written == [("test", 1)]
    assert contents(source.root) == before


def test_another_recipe_has_another_folder(root: Path) -> None:
    first, other = Tabletop(root, **SIZES), Tabletop(root, **{**SIZES, "seed": 2})
    assert first.root.parent == other.root.parent
    assert first.root != other.root
    assert not other.generated


def test_a_folder_with_another_recipe_is_not_touched(root: Path, tmp_path: Path) -> None:
    source = Tabletop(copied(root, tmp_path), **SIZES)
    recipe = source.root / "dataset.json"
    recipe.write_text(recipe.read_text().replace('"seed": 1', '"seed": 9'))
    before = contents(source.root)
    assert not source.generated
    with pytest.raises(GenerationError, match="holds frames of another recipe"):
        source.generate(workers=0, progress=False)
    assert contents(source.root) == before


def test_reading_before_generating_says_how_to_generate(tmp_path: Path) -> None:
    source = Tabletop(tmp_path / "none", **SIZES)
    with pytest.raises(DatasetNotFoundError, match="does not exist"):
        len(source)
    with pytest.raises(DatasetNotFoundError, match="have not been generated") as caught:
        _ = source.splits
    assert "generate()" in str(caught.value)
    assert "sgbd[synthetic]" in str(caught.value)
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("package", ["mujoco", "embreex", "trimesh"])
def test_a_missing_package_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    for module in [name for name in sys.modules if name.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError, match=rf"needs {package}.*sgbd\[synthetic\]"):
        Tabletop(tmp_path, **SIZES).generate(workers=0, progress=False)
    assert not list(tmp_path.iterdir())


def test_reading_needs_no_package_of_the_extra(root: Path) -> None:
    script = (
        "import sys\n"
        "for name in ('mujoco', 'embreex', 'trimesh'): sys.modules[name] = None\n"
        "from sgbd.sources.synthetic import Tabletop\n"
        f"source = Tabletop({str(root)!r}, 'test', **{SIZES!r})\n"
        "source.generate()\n"
        "assert source[3].categories\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=300)


def test_a_full_disk_is_a_clear_error_and_leaves_no_half_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    source = Tabletop(tmp_path, **SIZES)
    with monkeypatch.context() as patch:
        patch.setattr(Image.Image, "save", full)
        with pytest.raises(GenerationError, match="No space left on device.*finished scenes are kept"):
            source.generate(workers=0, progress=False)
    assert not list((source.root / "training_set").iterdir())
    assert not source.generated


def test_an_interruption_leaves_no_half_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    source = Tabletop(tmp_path, **SIZES)
    with monkeypatch.context() as patch:
        patch.setattr(scene, "photograph", interrupted)
        with pytest.raises(KeyboardInterrupt):
            source.generate(workers=0, progress=False)
    assert not list((source.root / "training_set").iterdir())


def test_a_scene_that_cannot_be_drawn_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise scene.SceneError("no viewpoint")

    monkeypatch.setattr(scene, "arrange", fail)
    with pytest.raises(GenerationError, match="scene 0 of split 'train' in .*no viewpoint"):
        Tabletop(tmp_path, **SIZES).generate(workers=0, progress=False)


def test_two_generations_at_once_make_each_scene_once(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    template, written = Tabletop(root, **SIZES).root, []

    def copy_scene(target: Path, recipe: Any, split: str, number: int) -> Path:
        folder, _ = recipe.scenes(split)[number]
        written.append(folder)
        return Path(shutil.copytree(template / folder, target / folder))

    monkeypatch.setattr(generation, "write_scene", copy_scene)
    threads = [
        threading.Thread(target=Tabletop(tmp_path, **SIZES).generate, kwargs={"workers": 0, "progress": False})
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(written) == sorted(set(written))
    assert len(written) == 5
    assert Tabletop(tmp_path, **SIZES).generated


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"objects": [5]}, "objects must be two numbers, least and largest"),
        ({"resolution": [640, 480, 3]}, "resolution must be two numbers, width and height"),
        ({"sensor": "radar"}, "no sensor 'radar'; choose from clean, kinect"),
        ({"split": "training"}, "no split 'training'; choose from train, val, test"),
    ],
)
def test_bad_options_are_refused(tmp_path: Path, option: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Tabletop(tmp_path, **option)


@pytest.mark.parametrize(
    ("name", "frames", "sensor"),
    [
        ("tabletop", (400, 50, 100), "clean"),
        ("tabletop_tiny", (8, 4, 6), "clean"),
        ("tabletop_todz", (7118, 400, 881), "clean"),
        ("tabletop_kinect", (400, 50, 100), "kinect"),
        ("tabletop_wide", (2000, 150, 100), "varied"),
        ("tabletop_assorted", (3000, 150, 100), "varied"),
        ("tabletop_stacked", (6000, 150, 100), "varied"),
    ],
)
def test_shipped_configurations(name: str, frames: tuple[int, int, int], sensor: str, tmp_path: Path) -> None:
    config = OmegaConf.load(CONF / f"{name}.yaml")
    config.data_dir = str(tmp_path)
    options = OmegaConf.to_container(config, resolve=True)
    del options["data_dir"]  # type: ignore[union-attr, arg-type]
    source = instantiate(options, split="val")
    assert isinstance(source, Tabletop)
    assert source.split == "val"
    assert tuple(source.recipe.frames(split) for split in ("train", "val", "test")) == frames
    assert source.recipe.sensor == sensor
    assert source.root.parent == tmp_path / "tabletop"
    assert source.root.name.startswith(f"{name}-")


def forbidden(*_: Any) -> None:
    raise AssertionError("nothing should be made")


def test_a_split_without_frames_is_no_split(tmp_path: Path) -> None:
    source = Tabletop(tmp_path, **{**SIZES, "test_frames": 0, "val_frames": 0})
    source.generate(workers=0, progress=False)
    assert source.splits == ("train",)
