"""Plain folders of frames: tiny ones, and real ones next to a development checkout."""

from __future__ import annotations

import logging
import pickle
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hydra.utils import instantiate
from omegaconf import OmegaConf
from PIL import Image

from sgbd.frame import FrameError, Intrinsics
from sgbd.sources import DatasetNotFoundError, Folder, FrameReadError, LabelRule
from sgbd.sources.label_rule import MOSD, PLAIN

DEPTH = np.array([[0, 500], [1000, 1500]], np.uint16)
COLORS = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
CONF = Path(__file__).parents[2] / "conf/dataset"


def save(path: Path, array: npt.NDArray[np.generic]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(array).save(path)


def write_triple(folder: Path, name: str, labels: list[list[int]] | None = None) -> None:
    save(folder / f"{name}_rgb.png", COLORS)
    save(folder / f"{name}_depth.png", DEPTH)
    if labels is not None:
        save(folder / f"{name}_labels.png", np.array(labels, np.uint8))


def test_triples_are_read(tmp_path: Path) -> None:
    write_triple(tmp_path, "b", [[0, 1], [2, 3]])
    write_triple(tmp_path, "a_rgb_1")
    (tmp_path / "notes.txt").write_text("not a frame")
    save(tmp_path / "overview.png", COLORS)
    source = Folder(tmp_path)
    assert source.names == ("a_rgb_1", "b")
    assert source.splits == ("test",)
    unlabeled, labeled = source
    assert unlabeled.instances is None
    assert np.array_equal(labeled.rgb, COLORS)
    assert labeled.depth.ravel().tolist() == pytest.approx([0, 0.5, 1, 1.5])
    assert labeled.instances is not None
    assert labeled.instances.tolist() == [[0, 1], [2, 3]]
    assert (labeled.name, labeled.intrinsics, labeled.categories) == ("b", None, {})
    assert (source.category_names, source.seen) == ((), frozenset())


def test_subfolders_with_equal_names_are_read(tmp_path: Path) -> None:
    for name in ("x", "y"):
        save(tmp_path / f"rgb/{name}.png", COLORS)
        save(tmp_path / f"depth/{name}.png", DEPTH)
    save(tmp_path / "labels/y.png", np.array([[0, 1], [2, 2]], np.uint8))
    source = Folder(tmp_path)
    assert source.names == ("x", "y")
    assert source[0].instances is None
    assert source[1].instances is not None
    assert source[1].instances.tolist() == [[0, 1], [2, 2]]


def test_file_name_endings_may_be_upper_case_and_colours_jpeg(tmp_path: Path) -> None:
    write_triple(tmp_path, "a")
    (tmp_path / "a_rgb.png").unlink()
    Image.fromarray(COLORS).save(tmp_path / "a_rgb.JPG", format="JPEG")
    (tmp_path / "a_depth.png").rename(tmp_path / "a_depth.PNG")
    assert Folder(tmp_path)[0].rgb.shape == (2, 2, 3)


def test_hidden_files_are_no_frames(tmp_path: Path) -> None:
    write_triple(tmp_path, "a")
    # On some file systems, macOS leaves such files beside all others.
    for kind in ("rgb", "depth", "labels"):
        (tmp_path / f"._a_{kind}.png").write_bytes(b"")
    assert Folder(tmp_path).names == ("a",)


def test_subfolders_train_val_test_are_splits(tmp_path: Path) -> None:
    write_triple(tmp_path / "train", "one")
    write_triple(tmp_path / "test", "two")
    assert Folder(tmp_path, "train").names == ("one",)
    assert Folder(tmp_path, "test").names == ("two",)
    assert Folder(tmp_path, "test").splits == ("train", "test")
    with pytest.raises(DatasetNotFoundError, match="no split 'val', only train, test"):
        len(Folder(tmp_path, "val"))


def test_depth_scale_and_camera(tmp_path: Path) -> None:
    write_triple(tmp_path, "a")
    camera = {"fx": 3, "fy": 4, "cx": 1, "cy": 1}
    frame = Folder(tmp_path, depth_scale=0.002, intrinsics=camera)[0]
    assert frame.depth.ravel().tolist() == pytest.approx([0, 1, 2, 3])
    assert frame.intrinsics == Intrinsics(3, 4, 1, 1)


def test_the_depth_scale_may_be_a_number_of_numpy(tmp_path: Path) -> None:
    write_triple(tmp_path, "a")
    scale = np.float32(0.5)
    assert Folder(tmp_path, depth_scale=scale).fingerprint() == Folder(tmp_path, depth_scale=0.5).fingerprint()


def test_a_rule_overrides_detection(tmp_path: Path) -> None:
    write_triple(tmp_path, "a", [[0, 1], [20, 30]])
    assert Folder(tmp_path).label_rule == MOSD
    instances = Folder(tmp_path, labels=LabelRule())[0].instances
    assert instances is not None
    assert instances.tolist() == [[0, 1], [20, 30]]


def test_detection_is_logged_with_what_it_took(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_triple(tmp_path, "a", [[0, 1], [20, 30]])
    with caplog.at_level(logging.INFO):
        instances = Folder(tmp_path)[0].instances
    assert instances is not None
    assert instances.tolist() == [[-1, 1], [2, 3]]
    assert "recognised as mOSD's" in caplog.text


def test_detection_looks_at_all_parts_of_a_long_sequence(tmp_path: Path) -> None:
    for number in range(70):
        write_triple(tmp_path, f"{number:03d}", [[0, 1], [20, 12 if number == 66 else 30]])
    assert Folder(tmp_path).label_rule == PLAIN


def test_detection_leaves_broken_files_to_reading(tmp_path: Path) -> None:
    write_triple(tmp_path, "a", [[0, 1], [20, 30]])
    write_triple(tmp_path, "b", [[0, 1], [20, 30]])
    (tmp_path / "a_labels.png").write_bytes(b"broken")
    source = Folder(tmp_path)
    assert source[1].instances is not None
    with pytest.raises(FrameReadError, match=r"a_labels\.png"):
        source[0]


def test_a_label_without_a_meaning_names_the_file(tmp_path: Path) -> None:
    write_triple(tmp_path, "a", [[0, 1], [12, 17]])
    with pytest.raises(FrameReadError, match=r"a_labels\.png: labels without a meaning: 12, 17"):
        Folder(tmp_path, labels=MOSD)[0]


def test_a_missing_folder_says_what_is_expected(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError) as error:
        len(Folder(tmp_path / "nowhere"))
    for text in ("nowhere", "does not exist", "NAME_depth.png", "dataset=tabletop"):
        assert text in str(error.value)


def test_a_folder_without_frames_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError, match=r"no colour image.*\n  It holds nothing\n"):
        len(Folder(tmp_path))


def test_colours_without_any_depth_are_an_error(tmp_path: Path) -> None:
    save(tmp_path / "a_rgb.png", COLORS)
    (tmp_path / "a_depth.tiff").touch()
    with pytest.raises(DatasetNotFoundError, match=r"none of the 1 colour images .* has a depth image") as error:
        len(Folder(tmp_path))
    assert "\n  It holds a_depth.tiff, a_rgb.png\n" in str(error.value)


def test_few_of_many_files_are_named_where_no_frame_is_found(tmp_path: Path) -> None:
    for number in range(9):
        (tmp_path / f"color_{number}.png").touch()
    with pytest.raises(DatasetNotFoundError, match=r"It holds color_0.png, .*, color_5.png and 3 more\n"):
        len(Folder(tmp_path))


@pytest.mark.parametrize("subfolders", [False, True])
def test_one_missing_depth_image_is_that_frames_error(tmp_path: Path, subfolders: bool) -> None:
    for name in ("a", "b"):
        save(tmp_path / (f"rgb/{name}.png" if subfolders else f"{name}_rgb.png"), COLORS)
    missing, present = (tmp_path / (f"depth/{n}.png" if subfolders else f"{n}_depth.png") for n in "ab")
    save(present, DEPTH)
    source = Folder(tmp_path)
    assert source[1].depth.shape == (2, 2)
    with pytest.raises(FrameReadError, match="does not exist") as error:
        source[0]
    assert error.value.path == missing


def test_two_images_of_one_kind_are_an_error(tmp_path: Path) -> None:
    write_triple(tmp_path, "a")
    Image.fromarray(COLORS).save(tmp_path / "a_rgb.jpg")
    with pytest.raises(FrameReadError, match="frame 'a' has two rgb images"):
        len(Folder(tmp_path))


@pytest.mark.parametrize(
    ("depth", "message"),
    [
        (np.ones((3, 2), np.uint16), "rgb is 2x2 and depth 2x3"),
        (np.zeros((2, 2), np.uint16), "every depth value is missing"),
        (np.ones((2, 2), np.uint8), "8 bits"),
        (np.ones((2, 2, 3), np.uint8), "3 channels"),
    ],
)
def test_bad_depth_is_refused_and_the_frame_named(tmp_path: Path, depth: npt.NDArray[np.generic], message: str) -> None:
    write_triple(tmp_path, "frame_7")
    save(tmp_path / "frame_7_depth.png", depth)
    with pytest.raises(FrameError, match=f"frame_7.*{message}"):
        Folder(tmp_path)[0]


def test_labels_of_another_size_are_refused(tmp_path: Path) -> None:
    write_triple(tmp_path, "a", [[0, 1, 2], [0, 1, 2]])
    with pytest.raises(FrameError, match=r"'a'.*\(2, 3\)"):
        Folder(tmp_path)[0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"split": "all"}, "train, val, test"),
        ({"labels": "mosd"}, "'auto' or a LabelRule"),
        ({"depth_scale": 0}, "depth_scale must be positive"),
        (
            {"depth_scale": "1/5000"},
            "depth_scale must be positive, a number .* 0.0002 for 5000 units a metre; got 1/5000",
        ),
        ({"intrinsics": {"f": 1}}, "fx, fy, cx, cy"),
    ],
)
def test_bad_options_are_refused(tmp_path: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Folder(tmp_path, **options)  # type: ignore[arg-type]


def test_the_fingerprint_follows_files_and_options(tmp_path: Path) -> None:
    write_triple(tmp_path, "a", [[0, 1], [2, 3]])
    digests = [
        Folder(tmp_path).fingerprint(),
        Folder(tmp_path, labels=MOSD).fingerprint(),
        Folder(tmp_path, depth_scale=0.01).fingerprint(),
        Folder(tmp_path, intrinsics=Intrinsics(1, 1, 1, 1)).fingerprint(),
    ]
    assert Folder(tmp_path, labels=PLAIN).fingerprint() == digests[0]
    write_triple(tmp_path, "b")
    digests.append(Folder(tmp_path).fingerprint())
    assert len(set(digests)) == 5


def test_detection_is_done_once_and_sent_along(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_triple(tmp_path, "a", [[0, 1], [20, 30]])
    source = Folder(tmp_path)
    source.fingerprint()
    with caplog.at_level(logging.INFO):
        copy = pickle.loads(pickle.dumps(source))
        assert copy[0].instances.tolist() == [[-1, 1], [2, 3]]
    assert not caplog.records


def test_notices_about_a_folder_are_said_once_for_all_its_splits(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for split in ("train", "val", "test"):
        write_triple(tmp_path / split, "a", [[0, 1], [2, 3]])
    with caplog.at_level(logging.INFO):
        for split in ("train", "val", "test", "test"):
            Folder(tmp_path, split).fingerprint()
    messages = [record.getMessage() for record in caplog.records]
    assert len(messages) == 2
    assert sum("camera is unknown" in message for message in messages) == 1
    assert sum("labels are read as" in message for message in messages) == 1


def test_plot_without_truth_has_two_panels(tmp_path: Path) -> None:
    write_triple(tmp_path, "a")
    titles = [axis.get_title() for axis in Folder(tmp_path).plot(0).axes]
    assert titles[:2] == ["a", "depth (m)"]
    assert not any("objects" in title for title in titles)


@pytest.mark.parametrize(
    ("name", "rule", "camera"), [("folder", PLAIN, None), ("mosd", MOSD, Intrinsics(525, 525, 319.5, 239.5))]
)
def test_the_shipped_configurations_make_the_reader(
    tmp_path: Path, name: str, rule: LabelRule, camera: Intrinsics | None
) -> None:
    write_triple(tmp_path, "a", [[0, 1], [2, 3]])
    config = OmegaConf.load(CONF / f"{name}.yaml")
    config.root = str(tmp_path)
    source = instantiate(config, split="test")
    assert type(source) is Folder
    assert source.label_rule == rule
    assert source.intrinsics == camera
    assert source.depth_scale == 0.001


def test_real_frames_are_recognised_and_read(shared_data: Path) -> None:
    root = shared_data / "mosd_learn"
    source = Folder(root)
    assert source.names == tuple(f"learn{number:02d}" for number in range(45))
    assert source.label_rule == MOSD
    ids = set()
    for frame in source:
        labels = np.asarray(Image.open(root / f"{frame.name}_labels.png")).astype(int)
        assert frame.rgb.shape == (480, 640, 3)
        assert frame.instances is not None
        assert np.array_equal(frame.instances == -1, labels == 0)
        assert np.array_equal(frame.instances == 1, (labels >= 1) & (labels <= 9))
        assert np.array_equal(frame.instances[labels >= 20], labels[labels >= 20] // 10)
        assert not frame.depth[frame.instances == -1].any()
        assert 0.5 < np.median(frame.depth[frame.depth > 0]) < 2.5
        ids |= set(np.unique(frame.instances).tolist())
    assert ids == {-1, 1, 2, 3, 4, 5, 6}
