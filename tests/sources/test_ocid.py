"""OCID's layout: both setups and both kinds of scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sgbd.frame import Frame, FrameError
from sgbd.sources import DatasetNotFoundError, FrameReadError, LabelRule, Ocid
from sgbd.sources.ocid import XTION
from tests.sources.real_layouts import OCID_SEQUENCES, save, write_ocid

ZERO_SHOT = {"train": ["ARID20", "ARID10"], "test": ["YCB10"]}


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Frame]]:
    root = tmp_path_factory.mktemp("ocid")
    return root, write_ocid(root)


def test_all_frames_are_for_testing_by_default(tree: tuple[Path, dict[str, Frame]]) -> None:
    root, frames = tree
    source = Ocid(root)
    assert source.splits == ("test",)
    assert len(source) == 10
    assert source.names[0] == "ARID20/floor/bottom/seq01/result_2018-08-20-14-53-00"
    assert set(source.sequences) == set(OCID_SEQUENCES)
    for frame in source:
        true = frames[frame.name]
        np.testing.assert_array_equal(frame.rgb, true.rgb)
        np.testing.assert_allclose(frame.depth, true.depth, atol=6e-4)
        # Both supports of a table scene become support; object ids equal those on the floor, or are one higher.
        shift = 1 if "/table/" in frame.name else 0
        expected = np.where(true.instances > 1, true.instances + shift, true.instances)  # type: ignore[operator]
        np.testing.assert_array_equal(frame.instances, expected)
        assert frame.intrinsics == XTION


def test_hidden_files_are_no_frames(tmp_path: Path) -> None:
    write_ocid(tmp_path)
    # On some file systems, macOS leaves such a file beside every other.
    for folder in tmp_path.rglob("rgb"):
        (folder / "._result_2018-08-20-14-53-00.png").write_bytes(b"")
    assert len(Ocid(tmp_path)) == 10


def test_the_second_support_can_be_background(tree: tuple[Path, dict[str, Frame]]) -> None:
    rule = LabelRule(background=[0, 1], support=[2], objects=["3-"])
    source = Ocid(tree[0], parts={"test": ["ARID20/table"]}, table_labels=rule)
    assert len(source) == 2
    instances = source[0].instances
    assert instances is not None
    assert instances[12, 0] == 0
    assert instances[-1, 0] == 1


def test_zero_shot_trains_on_arid_and_tests_on_ycb(tree: tuple[Path, dict[str, Frame]]) -> None:
    sources = {split: Ocid(tree[0], split, parts=ZERO_SHOT, val_share=0.25) for split in ("train", "val", "test")}
    assert sources["train"].splits == ("train", "val", "test")
    assert [len(source) for source in sources.values()] == [6, 2, 2]
    train, val = sources["train"].sequences, sources["val"].sequences
    assert sorted([*train, *val]) == sorted(OCID_SEQUENCES[:4])
    assert sources["test"].sequences == ("YCB10/table/bottom/cuboid/seq01",)
    drawn = {Ocid(tree[0], "val", parts=ZERO_SHOT, seed=seed).sequences for seed in range(20)}
    assert len(drawn) > 1
    whole = Ocid(tree[0], "train", parts=ZERO_SHOT, val_share=0)
    assert (len(whole), whole.splits) == (8, ("train", "test"))
    own = {"train": ["ARID20"], "val": ["ARID10"], "test": ["YCB10"]}
    assert [len(Ocid(tree[0], split, parts=own)) for split in own] == [4, 4, 2]


def test_frames_with_point_clouds(tmp_path: Path) -> None:
    pytest.importorskip("pypcd4", reason="needs the extra sgbd[pcd]")
    frames = write_ocid(tmp_path, clouds=True)
    frame = Ocid(tmp_path, depth="pcd", intrinsics=None)[0]
    np.testing.assert_allclose(frame.depth, frames[frame.name].depth, atol=1e-5)
    assert frame.intrinsics is not None
    assert frame.intrinsics.cx == pytest.approx(31.5, abs=0.01)
    with pytest.raises(DatasetNotFoundError, match=r"no folder depth in ARID20/floor.*use dataset\.depth=pcd"):
        len(Ocid(tmp_path))


def test_what_is_missing_and_how_to_get_it(tmp_path: Path) -> None:
    with pytest.raises(DatasetNotFoundError) as error:
        len(Ocid(tmp_path / "nowhere"))
    for text in ("does not exist", "label/result_", "acin.tuwien.ac.at", "dataset=tabletop"):
        assert text in str(error.value)
    with pytest.raises(DatasetNotFoundError, match="no folder ARID20"):
        len(Ocid(tmp_path))
    (tmp_path / "ARID20/floor").mkdir(parents=True)
    with pytest.raises(DatasetNotFoundError, match="no sequence in ARID20"):
        len(Ocid(tmp_path))
    (tmp_path / "ARID20/floor/top/seq01/rgb").mkdir(parents=True)
    (tmp_path / "ARID20/floor/top/seq01/depth").mkdir()
    arid = {"test": ["ARID20"]}
    with pytest.raises(DatasetNotFoundError, match="no colour image"):
        len(Ocid(tmp_path, parts=arid))
    with pytest.raises(DatasetNotFoundError, match="no part is split 'train'"):
        len(Ocid(tmp_path, "train", parts=arid))
    with pytest.raises(DatasetNotFoundError, match="1 sequences, too few to hold one out"):
        len(Ocid(tmp_path, "train", parts={"train": ["ARID20"]}))


def test_a_missing_or_broken_file_is_named(tmp_path: Path) -> None:
    write_ocid(tmp_path)
    first, second, third = Ocid(tmp_path).names[:3]
    (tmp_path / first.replace("/result", "/label/result")).with_suffix(".png").unlink()
    path = (tmp_path / second.replace("/result", "/depth/result")).with_suffix(".png")
    path.write_bytes(path.read_bytes()[:-5])
    save((tmp_path / third.replace("/result", "/label/result")).with_suffix(".png"), np.full((48, 64), 3, np.uint8))
    source = Ocid(tmp_path, table_labels=LabelRule(objects=["5-"]))
    for index, message in enumerate((r"label.*does not exist", r"depth.*truncated", "labels without a meaning: 3")):
        with pytest.raises(FrameReadError, match=message):
            source[index]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parts": {"train": ["ARID20"], "test": ["ARID20/table"]}}, "ARID20/table would be in train and in test"),
        ({"parts": {}}, "list of parts"),
        ({"val_share": 1.0}, "val_share must be a share"),
        ({"seed": -1}, "seed must not be negative"),
        ({"depth": "disparity"}, "depth, pcd; got 'disparity'"),
        ({"depth_scale": -1}, "depth_scale must be positive"),
        ({"intrinsics": {"f": 1}}, "fx, fy, cx, cy"),
    ],
)
def test_bad_options_are_refused(tmp_path: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises((ValueError, FrameError), match=message):
        Ocid(tmp_path, **options)  # type: ignore[arg-type]


def test_the_recipe_of_all_splits_is_one(tree: tuple[Path, dict[str, Frame]]) -> None:
    options = [Ocid(tree[0], split, parts=ZERO_SHOT).options() for split in ("train", "val", "test")]
    assert options[0] == options[1] == options[2]
    assert len({Ocid(tree[0], split, parts=ZERO_SHOT).fingerprint() for split in ("train", "val", "test")}) == 3
