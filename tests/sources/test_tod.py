"""Reading tiny datasets in TOD's layout."""

from __future__ import annotations

import json
import logging
import os
import pickle
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hydra.utils import instantiate
from omegaconf import OmegaConf
from PIL import Image

from sgbd.frame import FrameError, Intrinsics
from sgbd.sources import TOD_CATEGORIES, TODZ_SEEN, DatasetNotFoundError, FrameReadError, Tod
from sgbd.sources.tod import VisibleObject

SIZE = (12, 16)
MUG = 1 + TOD_CATEGORIES.index("mug")
BOWL = 1 + TOD_CATEGORIES.index("bowl")


def write_view(
    scene: Path,
    view: int,
    segmentation: npt.NDArray[np.uint8],
    semseg: npt.NDArray[np.uint8] | None,
    suffix: str = "jpeg",
) -> None:
    scene.mkdir(parents=True, exist_ok=True)
    height, width = segmentation.shape
    Image.fromarray(np.full((height, width, 3), 10 * view, np.uint8)).save(scene / f"rgb_{view:05d}.{suffix}")
    Image.fromarray(np.full((height, width), 1000 + view, np.uint16)).save(scene / f"depth_{view:05d}.png")
    indexed = Image.fromarray(segmentation)
    indexed.putpalette([value % 256 for value in range(768)])  # TOD's masks are palette images
    indexed.save(scene / f"segmentation_{view:05d}.png")
    if semseg is not None:
        Image.fromarray(semseg).save(scene / f"semseg_{view:05d}.png")


def masks() -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Write a table with a mug of 12 pixels and a bowl of 4 pixels on it."""
    segmentation = np.zeros(SIZE, np.uint8)
    segmentation[4:] = 1
    segmentation[5:8, 2:6] = 2
    segmentation[5:7, 10:12] = 3
    semseg = np.select([segmentation == 1, segmentation == 2, segmentation == 3], [26, MUG, BOWL]).astype(np.uint8)
    return segmentation, semseg


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Write two training scenes and one test scene with views 0 (room), 1 (empty table), 2 and 3."""
    segmentation, semseg = masks()
    table = np.minimum(segmentation, 1)
    for scene in ("training_set/scene_00000", "training_set/scene_00007", "test_set/scene_00000"):
        folder = tmp_path / scene
        write_view(folder, 0, np.zeros(SIZE, np.uint8), np.zeros(SIZE, np.uint8))
        write_view(folder, 1, table, table * 26)
        write_view(folder, 2, segmentation, semseg)
        write_view(folder, 3, np.where(segmentation == 3, 1, segmentation), np.where(semseg == BOWL, 26, semseg))
        (folder / "scene_description.txt").write_text(json.dumps({"object_descriptions": []}))
    return tmp_path


def test_folders_are_the_splits_and_views_without_objects_are_left_out(root: Path) -> None:
    train, test = Tod(root, "train"), Tod(root, "test")
    assert train.splits == test.splits == ("train", "test")
    assert train.names == (
        "training_set/scene_00000/00002",
        "training_set/scene_00000/00003",
        "training_set/scene_00007/00002",
        "training_set/scene_00007/00003",
    )
    assert test.names == ("test_set/scene_00000/00002", "test_set/scene_00000/00003")
    assert train.filtered == {"background_views": 4, "near_empty": 0, "unseen_objects": 0, "not_drawn": 0}
    assert len(Tod(root, "test", first_view=0)) == 4


def test_a_validation_folder_is_a_split(root: Path) -> None:
    segmentation, semseg = masks()
    write_view(root / "validation_set/scene_00001", 2, segmentation, semseg)
    source = Tod(root, "val")
    assert source.splits == ("train", "val", "test")
    assert source.names == ("validation_set/scene_00001/00002",)


def test_a_frame_has_everything(root: Path) -> None:
    frame = Tod(root, "train")[0]
    segmentation, _ = masks()
    assert frame.name == "training_set/scene_00000/00002"
    assert np.abs(frame.rgb.astype(int) - 20).max() <= 2
    assert np.allclose(frame.depth, 1.002)
    assert frame.instances is not None
    assert np.array_equal(frame.instances, segmentation)
    assert frame.categories == {2: "mug", 3: "bowl"}


def test_a_source_is_a_sequence(root: Path) -> None:
    source = Tod(root, "test")
    assert source[-1].name == source[1].name == source.names[1]
    assert [frame.name for frame in source] == list(source.names)
    with pytest.raises(IndexError, match="2 frames"):
        source[2]
    with pytest.raises(IndexError):
        source[-3]


def test_categories_follow_the_majority_of_an_objects_pixels(root: Path) -> None:
    scene = root / "training_set/scene_00000"
    segmentation, semseg = masks()
    semseg[5, 2:6] = BOWL  # 4 of the mug's 12 pixels
    semseg[5:7, 10:12] = [[26, 26], [26, BOWL]]  # mostly table: no category
    write_view(scene, 2, segmentation, semseg)
    assert Tod(root, "train")[0].categories == {2: "mug"}


def test_an_unknown_category_names_the_file_and_the_choices(root: Path) -> None:
    segmentation, semseg = masks()
    semseg[6, 3] = 27
    write_view(root / "training_set/scene_00000", 2, segmentation, semseg)
    with pytest.raises(FrameReadError, match=r"semseg_00002\.png: category 27 is unknown; 1 to 25 are ashcan.*26 is"):
        Tod(root, "train")[0]


def test_other_category_names_can_be_given(root: Path) -> None:
    segmentation, semseg = masks()
    semseg = np.select([semseg == 26, semseg == MUG, semseg == BOWL], [3, 2, 1]).astype(np.uint8)
    for view in (2, 3):
        write_view(root / "test_set/scene_00000", view, segmentation, semseg)
    source = Tod(root, "test", category_names=["cup", "plate"], seen=["cup"])
    assert source[0].categories == {2: "plate", 3: "cup"}
    assert source.category_names == ("cup", "plate")
    assert source.seen == {"cup"}


def test_without_semantic_masks_the_mesh_tells_the_category(root: Path) -> None:
    scene = root / "test_set/scene_00000"
    (scene / "semseg_00002.png").unlink()
    meshes = ["/models/03797390/1a2b/models/model_normalized.obj", "/models/99999999/3c4d/model.obj"]
    (scene / "scene_description.txt").write_text(
        json.dumps({"object_descriptions": [{"mesh_filename": mesh} for mesh in meshes]})
    )
    assert Tod(root, "test")[0].categories == {2: "mug"}
    (scene / "scene_description.txt").unlink()
    assert Tod(root, "test")[0].categories == {}


def test_seen_defaults_to_todz_and_can_be_none(root: Path) -> None:
    assert Tod(root).seen == TODZ_SEEN
    assert Tod(root, seen=None).seen == frozenset()
    with pytest.raises(ValueError, match=r"\['teapot'\].*ashcan"):
        Tod(root, seen=["mug", "teapot"])


def test_the_camera_is_given_or_described_or_tods_own(root: Path) -> None:
    own = Tod(root, "test")[0].intrinsics
    assert own is not None
    assert own.fx == own.fy == pytest.approx(6 / np.tan(np.radians(22.5)))
    assert (own.cx, own.cy) == (7.5, 5.5)
    description = root / "test_set/scene_00000/scene_description.txt"
    described = {"fx": 20.0, "fy": 21.0, "cx": 8.0, "cy": 6.0}
    description.write_text(json.dumps({"intrinsics": described}))
    assert Tod(root, "test")[0].intrinsics == Intrinsics(**described)
    given = {"fx": 30.0, "fy": 30.0, "cx": 8.0, "cy": 6.0}
    assert Tod(root, "test", intrinsics=given)[0].intrinsics == Intrinsics(**given)


@pytest.mark.parametrize(
    ("text", "message"),
    [("{", "as JSON"), ("[]", "JSON object; got list"), ('{"intrinsics": {"fx": 1}}', "exactly the values fx")],
)
def test_a_bad_description_is_named(root: Path, text: str, message: str) -> None:
    (root / "test_set/scene_00000/scene_description.txt").write_text(text)
    with pytest.raises(FrameReadError, match=rf"scene_description\.txt: .*{message}"):
        Tod(root, "test")[0]


def test_text_lists_are_the_splits(root: Path) -> None:
    (root / "train.txt").write_text("\ufeff# a comment\n\ntraining_set/scene_00007/rgb_00003.jpeg\n")
    (root / "val.txt").write_text(
        "training_set/scene_00000/rgb_00003.jpeg\r\ntraining_set/scene_00000/rgb_00001.jpeg\r\n"
    )
    assert Tod(root, "train").names == ("training_set/scene_00007/00003",)
    val = Tod(root, "val")
    assert val.splits == ("train", "val")
    assert val.names == ("training_set/scene_00000/00003", "training_set/scene_00000/00001")
    assert [frame.name for frame in val] == list(val.names)
    with pytest.raises(DatasetNotFoundError, match="no list of split 'test', only of train, val"):
        len(Tod(root, "test"))


@pytest.mark.parametrize("prefix", ["/data/of/another/machine/v5/training_set/", "training_set/", ""])
def test_todz_arrays_are_read_by_pattern(root: Path, prefix: str) -> None:
    paths = [f"{prefix}scene_00007/rgb_00002.jpeg", f"{prefix}scene_00000/rgb_00003.jpeg"]
    np.save(root / "train_ids.npy", np.array(paths))
    np.save(root / "test_open_ids.npy", np.array([path.encode() for path in paths[:1]]))
    assert Tod(root, "train").names == ("training_set/scene_00007/00002", "training_set/scene_00000/00003")
    assert Tod(root, "test").names == ("training_set/scene_00007/00002",)
    assert Tod(root, "test")[0].categories == {2: "mug", 3: "bowl"}


def test_any_image_of_a_frame_may_stand_for_it(root: Path) -> None:
    # The lists that the authors of TOD-Z publish name the segmentations.
    write_view(root / "training_set/scene_00008", 4, *masks(), suffix="png")
    paths = ["scene_00007/segmentation_00002.png", "scene_00008/semseg_00004.png", "scene_00007/depth_00003.png"]
    np.save(root / "train_ids.npy", np.array([f"/data/v5/training_set/{path}" for path in paths]))
    train = Tod(root, "train")
    assert train.names == tuple(f"training_set/scene_{name}" for name in ("00007/00002", "00008/00004", "00007/00003"))
    assert [train.files(index)[0].name for index in range(3)] == ["rgb_00002.jpeg", "rgb_00004.png", "rgb_00003.jpeg"]
    assert train[0].categories == {2: "mug", 3: "bowl"}


def test_lists_can_lie_elsewhere(root: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    elsewhere = tmp_path_factory.mktemp("lists")
    (elsewhere / "test.txt").write_text("test_set/scene_00000/rgb_00003.jpeg\n")
    assert Tod(root, "test", lists=elsewhere).names == ("test_set/scene_00000/00003",)
    one = Tod(root, "val", lists={"val": str(elsewhere / "test.txt")})
    assert one.splits == ("val",)
    assert one.names == ("test_set/scene_00000/00003",)


def test_a_folder_without_lists_is_an_error_when_lists_are_asked_for(
    root: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with pytest.raises(DatasetNotFoundError, match=r"no list of a split in .*test_open_ids\.npy"):
        len(Tod(root, "test", lists=tmp_path_factory.mktemp("empty")))


def test_pickled_arrays_are_never_loaded(root: Path) -> None:
    np.save(root / "train_ids.npy", np.array(["scene_00000/rgb_00002.jpeg", None], dtype=object), allow_pickle=True)
    with pytest.raises(FrameReadError, match=r"train_ids\.npy: the list of frames cannot be read"):
        len(Tod(root, "train"))


def test_an_array_of_numbers_is_no_list(root: Path) -> None:
    np.save(root / "train_ids.npy", np.arange(3))
    with pytest.raises(FrameReadError, match="array of paths"):
        len(Tod(root, "train"))


def test_a_bad_line_is_named(root: Path) -> None:
    (root / "train.txt").write_text(
        "training_set/scene_00000/rgb_00002.jpeg\ntraining_set/scene_00000/feats_00002.npy\n"
    )
    with pytest.raises(FrameReadError, match=r"train\.txt: entry 2 is 'training_set/scene_00000/feats_00002\.npy'"):
        len(Tod(root, "train"))


def test_frames_listed_twice_are_read_once_and_reported(root: Path, caplog: pytest.LogCaptureFixture) -> None:
    (root / "train.txt").write_text("training_set/scene_00000/rgb_00002.jpeg\n" * 3)
    assert len(Tod(root, "train")) == 1
    assert "names 2 frames twice" in caplog.text


@pytest.mark.parametrize("content", ["", "# nothing\n"])
def test_an_empty_list_is_an_error(root: Path, content: str) -> None:
    (root / "train.txt").write_text(content)
    with pytest.raises(DatasetNotFoundError, match=r"train\.txt names no frame"):
        len(Tod(root, "train"))


def test_a_list_of_another_dataset_is_an_error(root: Path) -> None:
    (root / "train.txt").write_text("training_set/scene_99999/rgb_00002.jpeg\n")
    with pytest.raises(DatasetNotFoundError, match=r"none of the 1 frames .* the first is .*scene_99999"):
        len(Tod(root, "train"))


def test_one_listed_frame_that_is_missing_is_that_frames_error(root: Path) -> None:
    (root / "train.txt").write_text(
        "training_set/scene_00000/rgb_00002.jpeg\ntraining_set/scene_99999/rgb_00002.jpeg\n"
    )
    source = Tod(root, "train")
    assert source[0].categories
    with pytest.raises(FrameReadError, match=r"scene_99999.rgb_00002\.jpeg: the file does not exist"):
        source[1]


def test_near_empty_frames_are_left_out_and_counted(root: Path) -> None:
    # View 2 shows two objects, view 3 one; the bowl has 4 pixels.
    filtered = Tod(root, "train", min_objects=2).filtered
    assert (filtered["background_views"], filtered["near_empty"]) == (4, 2)
    assert Tod(root, "train", min_objects=2).names == (
        "training_set/scene_00000/00002",
        "training_set/scene_00007/00002",
    )
    assert len(Tod(root, "train", min_objects=1, min_object_pixels=12)) == 4
    with pytest.raises(DatasetNotFoundError, match=r"none of the 4 frames .*: 4 have fewer than 2 objects of 5 pixels"):
        len(Tod(root, "train", min_objects=2, min_object_pixels=5))


def test_the_rule_against_near_empty_frames_hides_no_broken_file(root: Path) -> None:
    (root / "test_set/scene_00000/segmentation_00003.png").write_bytes(b"")
    source = Tod(root, "test", min_objects=2)
    assert len(source) == 2
    with pytest.raises(FrameReadError, match=r"segmentation_00003\.png"):
        source[1]


def test_what_is_left_out_is_reported_once_with_its_numbers(root: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        for _ in range(2):
            len(Tod(root, "train", min_objects=2, min_object_pixels=3))
    (message,) = [record.getMessage() for record in caplog.records]
    assert "2 frames; left out: 4 views before number 2, 2 with fewer than 2 objects of 3 pixels" in message


def test_frames_with_unseen_objects_can_be_left_out_of_training(root: Path) -> None:
    # View 2 shows a mug and a bowl, view 3 the mug alone.
    source = Tod(root, "train", seen=["mug"], unseen_objects="leave_out")
    assert source.names == ("training_set/scene_00000/00003", "training_set/scene_00007/00003")
    assert source.filtered["unseen_objects"] == 2
    assert len(Tod(root, "test", seen=["mug"], unseen_objects="leave_out")) == 2, "test frames are all kept"
    with pytest.raises(DatasetNotFoundError, match=r"4 show objects of unseen categories \(unseen_objects\)"):
        len(Tod(root, "train", seen=["bowl"], unseen_objects="leave_out"))


def test_unseen_objects_can_be_ignored_in_training(root: Path) -> None:
    segmentation, _ = masks()
    plain, ignoring = (Tod(root, "train", seen=["mug"], unseen_objects=rule)[0] for rule in ("keep", "ignore"))
    assert plain.instances is not None
    assert ignoring.instances is not None
    assert np.array_equal(plain.instances, segmentation)
    assert np.array_equal(ignoring.instances, np.where(segmentation == 3, -1, segmentation.astype(int)))
    assert ignoring.categories == {2: "mug"}
    tested = Tod(root, "test", seen=["mug"], unseen_objects="ignore")[0]
    assert tested.categories == {2: "mug", 3: "bowl"}
    assert len(Tod(root, "train", seen=["mug"], unseen_objects="ignore")) == 4
    # In each scene, view 2 shows one bowl, view 3 none.
    assert len(Tod(root, "train", seen=["bowl"], unseen_objects="ignore", min_objects=1)) == 2


def test_an_object_of_unknown_category_is_unseen(root: Path) -> None:
    for path in (root / "training_set").rglob("semseg_*.png"):
        path.unlink()
    frame = Tod(root, "train", seen=["mug"], unseen_objects="ignore")[0]
    assert frame.instances is not None
    assert set(np.unique(frame.instances).tolist()) == {-1, 0, 1}
    assert frame.categories == {}


def test_a_number_of_training_frames_is_drawn(root: Path) -> None:
    everything = Tod(root, "train").names
    drawn = [Tod(root, "train", max_train_frames=count, subset_seed=3).names for count in range(1, 6)]
    assert [len(names) for names in drawn] == [1, 2, 3, 4, 4]
    for fewer, more in pairwise(drawn):
        assert set(fewer) <= set(more), "a smaller number draws some of what a larger one draws"
    for names in drawn:
        assert list(names) == [name for name in everything if name in names], "the order is the dataset's"
    assert len({Tod(root, "train", max_train_frames=1, subset_seed=seed).names for seed in range(20)}) > 1
    assert Tod(root, "train", max_train_frames=1).filtered["not_drawn"] == 3
    assert len(Tod(root, "test", max_train_frames=1)) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"unseen_objects": "drop"}, "keep, ignore, leave_out; got 'drop'"),
        ({"unseen_objects": "ignore", "seen": None}, "set `seen`"),
        ({"max_train_frames": 0}, "max_train_frames must be at least 1"),
        ({"subset_seed": -1}, "subset_seed must not be negative"),
    ],
)
def test_bad_choices_of_frames_are_refused(root: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Tod(root, **options)


def test_the_objects_of_a_frame_are_told_without_colours_and_depth(root: Path) -> None:
    scene = root / "test_set/scene_00000"
    (scene / "rgb_00002.jpeg").write_bytes(b"")
    (scene / "depth_00002.png").unlink()
    assert Tod(root, "test").objects(0) == [VisibleObject(2, 12, "mug"), VisibleObject(3, 4, "bowl")]
    (scene / "semseg_00002.png").unlink()
    meshes = ["/03797390/1a2b/model.obj", "/03467517/3c4d/model.obj"]
    (scene / "scene_description.txt").write_text(
        json.dumps({"object_descriptions": [{"mesh_filename": mesh} for mesh in meshes]})
    )
    expected = [VisibleObject(2, 12, "mug", "mug"), VisibleObject(3, 4, None, "guitar")]
    assert Tod(root, "test").objects(0) == expected


def test_png_colours_are_read_too(root: Path) -> None:
    segmentation, semseg = masks()
    write_view(root / "validation_set/scene_00000", 2, segmentation, semseg, suffix="png")
    assert np.array_equal(Tod(root, "val")[0].rgb, np.full((*SIZE, 3), 20))


def test_a_missing_root_says_what_is_expected_and_how_to_get_it(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError) as error:
        len(Tod(tmp_path / "nowhere"))
    for text in ("nowhere", "does not exist", "segmentation_00002.png", "dataset=tabletop", "github.com"):
        assert text in str(error.value)
    assert str(pickle.loads(pickle.dumps(error.value))) == str(error.value)


def test_a_missing_split_folder_is_an_error(root: Path) -> None:
    with pytest.raises(DatasetNotFoundError, match="no folder validation_set for split 'val'"):
        len(Tod(root, "val"))


def test_a_folder_of_background_views_is_an_error(tmp_path: Path) -> None:
    write_view(tmp_path / "test_set/scene_00000", 0, np.zeros(SIZE, np.uint8), None)
    with pytest.raises(DatasetNotFoundError, match="names no frame of split 'test'"):
        len(Tod(tmp_path, "test"))


def test_an_unknown_split_lists_the_choices(root: Path) -> None:
    with pytest.raises(ValueError, match="train, val, test"):
        Tod(root, "training")


@pytest.mark.parametrize("kind", ["rgb_00002.jpeg", "depth_00002.png", "segmentation_00002.png", "semseg_00002.png"])
def test_a_truncated_file_is_named(root: Path, kind: str) -> None:
    path = root / "test_set/scene_00000" / kind
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(FrameReadError, match=rf"{kind}.*truncated"):
        Tod(root, "test")[0]


@pytest.mark.parametrize("kind", ["depth", "segmentation"])
def test_a_missing_file_is_named(root: Path, kind: str) -> None:
    (root / f"test_set/scene_00000/{kind}_00002.png").unlink()
    with pytest.raises(FrameReadError, match=rf"{kind}_00002\.png: the file does not exist"):
        Tod(root, "test")[0]


@pytest.mark.parametrize("kind", ["depth", "segmentation", "semseg"])
def test_images_of_different_size_are_refused(root: Path, kind: str) -> None:
    dtype = np.uint16 if kind == "depth" else np.uint8
    Image.fromarray(np.ones((5, 6), dtype)).save(root / f"test_set/scene_00000/{kind}_00002.png")
    with pytest.raises(FrameError, match=r"scene_00000.*(5, 6|6x5)"):
        Tod(root, "test")[0]


def test_the_fingerprint_follows_names_files_and_options(root: Path) -> None:
    first = Tod(root, "test").fingerprint()
    assert first == Tod(str(root), "test").fingerprint()
    assert len(first) == 64
    assert int(first, 16) >= 0
    camera = {"fx": 1, "fy": 1, "cx": 1, "cy": 1}
    others = [
        Tod(root, "train").fingerprint(),
        Tod(root, "test", first_view=0).fingerprint(),
        Tod(root, "test", min_objects=1).fingerprint(),
        Tod(root, "test", intrinsics=camera).fingerprint(),
        Tod(root, "test", seen=["mug"]).fingerprint(),
        Tod(root, "test", unseen_objects="ignore").fingerprint(),
        Tod(root, "test", max_train_frames=1).fingerprint(),
        Tod(root, "test", subset_seed=1).fingerprint(),
    ]
    path = root / "test_set/scene_00000/semseg_00002.png"
    os.utime(path, ns=(0, 12345))
    others.append(Tod(root, "test").fingerprint())
    path.unlink()
    others.append(Tod(root, "test").fingerprint())
    assert len({first, *others}) == 11


def test_the_fingerprint_does_not_depend_on_the_place(root: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    import shutil

    copy = tmp_path_factory.mktemp("copy") / "tod"
    shutil.copytree(root, copy)  # keeps modification times
    assert Tod(copy, "test").fingerprint() == Tod(root, "test").fingerprint()


def test_a_source_can_be_sent_to_another_process(root: Path) -> None:
    source = Tod(root, "test", min_objects=1)
    names = source.names
    copy = pickle.loads(pickle.dumps(source))
    assert copy.names == names
    assert copy[0].categories == source[0].categories


def test_plot_shows_colours_depth_and_truth(root: Path, tmp_path: Path) -> None:
    figure = Tod(root, "test").plot(0)
    titles = [axis.get_title() for axis in figure.axes if axis.get_title()]
    assert titles == ["test_set/scene_00000/00002", "depth (m)", "2 objects"]
    assert {text.get_text() for text in figure.axes[2].texts} == {"mug", "bowl"}
    figure.savefig(tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 1000


def test_the_shipped_configuration_makes_the_default_reader(root: Path) -> None:
    config = OmegaConf.load(Path(__file__).parents[2] / "conf/dataset/tod.yaml")
    config.root = str(root)
    source = instantiate(config, split="test")
    assert type(source) is Tod
    assert source.seen == TODZ_SEEN
    assert source.names == Tod(root, "test").names
    assert source[0].categories == {2: "mug", 3: "bowl"}
