"""mOSD's own layout: labelled point clouds, most of them organised."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pypcd4", reason="needs the extra sgbd[pcd]")

from sgbd.frame import Frame, FrameError
from sgbd.sources import DatasetNotFoundError, FrameReadError, Mosd
from tests.sources.real_layouts import SCENE_CAMERA, mosd_labels, with_holes, write_cloud, write_mosd

SIZE = (64, 48)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Frame]]:
    root = tmp_path_factory.mktemp("mosd")
    return root, write_mosd(root)


def test_organised_and_unorganised_clouds_are_read(tree: tuple[Path, dict[str, Frame]]) -> None:
    root, frames = tree
    (root / "learn/._learn0.pcd").write_bytes(b"")  # as macOS leaves on some file systems
    source = Mosd(root, intrinsics=SCENE_CAMERA, resolution=SIZE)
    assert source.splits == ("test",)
    assert source.names == ("learn/learn0", "learn/learn2", "learn/learn10", "test/test0")
    for frame in source:
        true = frames[frame.name]
        seen = true.depth > 0
        assert frame.intrinsics == SCENE_CAMERA
        np.testing.assert_allclose(frame.depth, true.depth, atol=1e-5)
        np.testing.assert_array_equal(frame.rgb[seen], true.rgb[seen])
        expected = np.where(seen, np.where(true.instances > 1, true.instances, 1), -1)  # type: ignore[operator]
        np.testing.assert_array_equal(frame.instances, expected)


def test_the_camera_may_be_fitted(tree: tuple[Path, dict[str, Frame]]) -> None:
    camera = Mosd(tree[0], intrinsics=None)[0].intrinsics
    assert camera is not None
    assert [camera.fx, camera.fy, camera.cx, camera.cy] == pytest.approx([50, 50, 31.5, 23.5], abs=0.01)


def test_the_databases_own_division(tree: tuple[Path, dict[str, Frame]]) -> None:
    parts = {"train": ["learn"], "test": ["test"]}
    train = Mosd(tree[0], "train", parts=parts)
    assert train.splits == ("train", "test")
    assert train.names == ("learn/learn0", "learn/learn2", "learn/learn10")
    assert Mosd(tree[0], "test", parts=parts).names == ("test/test0",)
    with pytest.raises(DatasetNotFoundError, match="no part is split 'val', only train, test"):
        len(Mosd(tree[0], "val", parts=parts))


def test_a_wrong_camera_for_unorganised_points_is_told(tree: tuple[Path, dict[str, Frame]]) -> None:
    source = Mosd(tree[0], intrinsics={"fx": 5000, "fy": 5000, "cx": 0, "cy": 0}, resolution=SIZE)
    with pytest.raises(FrameReadError, match=r"test0\.pcd: only \d+ of \d+ points lie in the 64x48 pixels"):
        source[3]


def test_bad_labels_and_missing_colours_name_the_file(tmp_path: Path) -> None:
    frame = with_holes(0)
    write_cloud(tmp_path / "learn/learn0.pcd", frame, np.full(frame.depth.shape, 15), "binary")
    write_cloud(tmp_path / "test/test0.pcd", frame, None, "binary")
    with pytest.raises(FrameReadError, match=r"learn0\.pcd: labels without a meaning: 15"):
        Mosd(tmp_path)[0]
    assert Mosd(tmp_path)[1].instances is None


def test_what_is_missing_and_how_to_get_it(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError) as error:
        len(Mosd(tmp_path / "nowhere"))
    for text in ("does not exist", "learn0.pcd", "PointCloudLibrary", "dataset=tabletop"):
        assert text in str(error.value)
    (tmp_path / "learn").mkdir()
    with pytest.raises(DatasetNotFoundError, match="no point cloud .* in learn"):
        len(Mosd(tmp_path))
    write_cloud(tmp_path / "learn/learn0.pcd", with_holes(0), mosd_labels(with_holes(0)), "binary")
    with pytest.raises(DatasetNotFoundError, match="there is no folder test"):
        len(Mosd(tmp_path))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"split": "all"}, "train, val, test"),
        ({"parts": {"test": "learn"}}, "list of parts"),
        ({"parts": {"testing": ["learn"]}}, "list of parts"),
        ({"parts": {"train": ["learn"], "test": ["test", "learn"]}}, "learn would be in train and in test"),
        ({"resolution": [640]}, "width and height"),
        ({"intrinsics": {"f": 1}}, "fx, fy, cx, cy"),
    ],
)
def test_bad_options_are_refused(tmp_path: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises((ValueError, FrameError), match=message):
        Mosd(tmp_path, **options)  # type: ignore[arg-type]


def test_options_are_in_the_fingerprint_and_a_source_can_be_sent(tree: tuple[Path, dict[str, Frame]]) -> None:
    source = Mosd(tree[0])
    assert source.fingerprint() != Mosd(tree[0], resolution=SIZE).fingerprint()
    assert source.fingerprint() != Mosd(tree[0], intrinsics=SCENE_CAMERA).fingerprint()
    assert pickle.loads(pickle.dumps(source)).fingerprint() == source.fingerprint()


def test_real_frames_as_point_clouds_are_what_they_are_as_images(shared_data: Path, tmp_path: Path) -> None:
    from sgbd.sources import Folder
    from sgbd.sources.image import read_labels
    from sgbd.sources.label_rule import MOSD
    from sgbd.sources.mosd import KINECT
    from tests.sources.pcd_files import pack_colors, write_pcd

    source = Folder(shared_data / "mosd_learn", labels=MOSD, intrinsics=KINECT)
    frame = source[17]
    rows, columns = np.indices(frame.depth.shape)
    z = np.where(frame.depth > 0, frame.depth, np.nan)
    fields = {
        "x": ((columns - KINECT.cx) / KINECT.fx * z).astype(np.float32),
        "y": ((rows - KINECT.cy) / KINECT.fy * z).astype(np.float32),
        "z": z.astype(np.float32),
        "rgba": pack_colors(frame.rgb),
        "label": read_labels(source.files(17)[2]).astype(np.uint32),
    }
    (tmp_path / "learn").mkdir()
    present = np.flatnonzero(frame.depth.ravel() > 0)
    write_pcd(tmp_path / "learn/learn0.pcd", fields, 480, 640, "binary")
    points = {name: values.ravel()[present] for name, values in fields.items()}
    write_pcd(tmp_path / "learn/learn1.pcd", points, 1, len(present), "binary")
    organized, unorganized = Mosd(tmp_path, parts={"test": ["learn"]})
    for read in (organized, unorganized):
        np.testing.assert_allclose(read.depth, frame.depth, atol=1e-5)
        np.testing.assert_array_equal(read.instances, frame.instances)
    np.testing.assert_array_equal(organized.rgb, frame.rgb)
