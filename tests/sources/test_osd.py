"""OSD's layout, with depth images and with point clouds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sgbd.frame import FrameError
from sgbd.sources import DatasetNotFoundError, FrameReadError, Osd
from sgbd.sources.mosd import KINECT
from tests.sources.real_layouts import save, write_osd


def test_frames_with_depth_images(tmp_path: Path) -> None:
    frames = write_osd(tmp_path)
    source = Osd(tmp_path)
    assert source.splits == ("test",)
    assert source.names == ("learn0", "learn2", "learn10", "test1")
    for frame in source:
        true = frames[frame.name]
        np.testing.assert_array_equal(frame.rgb, true.rgb)
        np.testing.assert_allclose(frame.depth, true.depth, atol=6e-4)
        # In OSD, table and wall are both background.
        np.testing.assert_array_equal(frame.instances, np.where(true.instances > 1, true.instances, 0))  # type: ignore[operator]
        assert frame.intrinsics == KINECT


def test_frames_with_point_clouds(tmp_path: Path) -> None:
    pytest.importorskip("pypcd4", reason="needs the extra sgbd[pcd]")
    frames = write_osd(tmp_path, clouds=True)
    frame = Osd(tmp_path, depth="pcd", intrinsics=None)[1]
    np.testing.assert_allclose(frame.depth, frames["learn2"].depth, atol=1e-5)
    assert frame.intrinsics is not None
    assert frame.intrinsics.fx == pytest.approx(50, abs=0.01)
    with pytest.raises(DatasetNotFoundError, match=r"no folder disparity; use dataset\.depth=pcd"):
        len(Osd(tmp_path))


def test_the_databases_own_division(tmp_path: Path) -> None:
    write_osd(tmp_path)
    parts = {"test": ["test"], "train": ["learn"]}
    assert Osd(tmp_path, "train", parts=parts).splits == ("train", "test")
    assert Osd(tmp_path, "train", parts=parts).names == ("learn0", "learn2", "learn10")
    assert Osd(tmp_path, "test", parts=parts).names == ("test1",)


def test_frames_without_annotation_have_no_truth(tmp_path: Path) -> None:
    write_osd(tmp_path)
    (tmp_path / "annotation/test1.png").unlink()
    assert Osd(tmp_path)[3].instances is None
    (tmp_path / "annotation/learn0.png").write_bytes(b"")
    with pytest.raises(FrameReadError, match=r"learn0\.png: the file is empty"):
        Osd(tmp_path)[0]


def test_raw_disparities_are_not_taken_for_depth(tmp_path: Path) -> None:
    frames = write_osd(tmp_path)
    raw = np.where(frames["learn0"].depth > 0, 700, 2047).astype(np.uint16)
    save(tmp_path / "disparity/learn0.png", raw)
    with pytest.raises(FrameReadError, match=r"learn0\.png: these are Kinect's raw disparities.*dataset\.depth=pcd"):
        Osd(tmp_path)[0]


def test_what_is_missing_and_how_to_get_it(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError) as error:
        len(Osd(tmp_path / "nowhere"))
    for text in ("does not exist", "image_color/learn0.png", "acin.tuwien.ac.at", "dataset=tabletop"):
        assert text in str(error.value)
    with pytest.raises(DatasetNotFoundError, match="no folder image_color"):
        len(Osd(tmp_path))
    write_osd(tmp_path)
    (tmp_path / "image_color/test1.png").unlink()
    with pytest.raises(DatasetNotFoundError, match=r"no image test\*\.png"):
        len(Osd(tmp_path))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parts": {"test": ["table"]}}, "learn and test; got table"),
        ({"depth": "depth"}, "disparity, pcd; got 'depth'"),
        ({"depth_scale": 0}, "depth_scale must be positive"),
        ({"intrinsics": {"f": 1}}, "fx, fy, cx, cy"),
    ],
)
def test_bad_options_are_refused(tmp_path: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises((ValueError, FrameError), match=message):
        Osd(tmp_path, **options)  # type: ignore[arg-type]


def test_the_fingerprint_follows_files_and_options(tmp_path: Path) -> None:
    write_osd(tmp_path)
    digests = [Osd(tmp_path).fingerprint(), Osd(tmp_path, depth_scale=0.002).fingerprint()]
    (tmp_path / "annotation/test1.png").unlink()
    digests.append(Osd(tmp_path).fingerprint())
    assert len(set(digests)) == 3
