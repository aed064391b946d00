"""Only training frames get augmented copies."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from skimage.io import imsave

from sgbd.frame_augmentation import FrameAugmentation
from sgbd.graph import GraphBuilder
from sgbd.preparation import prepare
from sgbd.recipe import graph_recipe
from sgbd.sources import Augmented, Folder
from sgbd.superpixels import FastSlic


@pytest.fixture
def root(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    for split in ("train", "test"):
        folder = tmp_path / "frames" / split
        folder.mkdir(parents=True)
        for name in ("a", "b"):
            labels = np.ones((48, 64), np.uint8)
            labels[10:30, 10:40] = 2
            imsave(folder / f"{name}_rgb.png", rng.integers(0, 256, (48, 64, 3)).astype(np.uint8), check_contrast=False)
            depth = np.uint16(1000) - 100 * labels.astype(np.uint16)
            imsave(folder / f"{name}_depth.png", depth, check_contrast=False)
            imsave(folder / f"{name}_labels.png", labels, check_contrast=False)
    return tmp_path / "frames"


def augmented(root: Path, split: str = "train", **options: int) -> Augmented:
    return Augmented(partial(Folder, root), FrameAugmentation(), split, **options)


def test_training_frames_are_followed_by_their_copies(root: Path) -> None:
    source = augmented(root)
    assert source.names == ("a", "a~1", "a~2", "b", "b~1", "b~2")
    assert source.names is source.names, "the preparation asks for the names several times per frame"
    assert source.splits == ("train", "test")
    assert [frame.name for frame in source] == list(source.names)
    plain = Folder(root, "train")
    np.testing.assert_array_equal(source[3].rgb, plain[1].rgb)
    assert source.files(4) == source.files(5) == plain.files(1)
    looks = [frame.rgb.tobytes() for frame in source]
    assert len(set(looks)) == 6


def test_test_frames_have_no_copies(root: Path) -> None:
    source = augmented(root, "test")
    assert source.names == ("a", "b")
    np.testing.assert_array_equal(source[0].depth, Folder(root, "test")[0].depth)


def test_copies_depend_on_name_number_and_seed_alone(root: Path) -> None:
    source = augmented(root)
    backwards = [source[k].rgb for k in reversed(range(6))][::-1]
    for k, rgb in enumerate(backwards):
        np.testing.assert_array_equal(rgb, source[k].rgb)
    more, other = augmented(root, copies=3), augmented(root, seed=1)
    np.testing.assert_array_equal(more[1].rgb, source[1].rgb)
    assert not np.array_equal(other[1].rgb, source[1].rgb)


def test_what_is_done_and_to_what_is_part_of_the_recipe(root: Path) -> None:
    superpixels, graph = FastSlic(n_segments=8), GraphBuilder()
    recipes = [
        graph_recipe(source, superpixels, graph)
        for source in (augmented(root), augmented(root, copies=1), augmented(root, "test"), augmented(root, seed=1))
    ]
    assert recipes[0] == recipes[2]
    assert recipes[0]["dataset"]["options"]["source"]["_target_"] == "sgbd.sources.folder.Folder"
    assert recipes[0]["dataset"]["options"]["augmentation"]["crop"] == 0.6
    assert recipes[0] != recipes[1]
    assert recipes[0] != recipes[3]


def test_graphs_are_prepared_from_copies(root: Path, tmp_path: Path) -> None:
    folder = prepare(augmented(root), FastSlic(n_segments=8), GraphBuilder(), tmp_path / "graphs", progress=False)
    assert len(list((folder / "train").rglob("*~2*"))) == 2


@pytest.mark.parametrize("option", [{"copies": -1}, {"seed": -1}])
def test_bad_options_are_refused(root: Path, option: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="copies and seed must not be negative"):
        augmented(root, **option)
