"""Semantic masks derived from the meshes of the scenes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sgbd.sources import FrameReadError, Tod
from sgbd.sources.image import read_labels
from sgbd.sources.semantic_masks import write_semantic_masks
from tests.sources.test_tod import masks, write_view

MUG, GUITAR = "/models/03797390/1a2b/model.obj", "/models/03467517/3c4d/model.obj"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Two scenes without semantic masks: one with a mug and a guitar, one without a description."""
    segmentation, _ = masks()
    for number in range(2):
        write_view(tmp_path / f"training_set/scene_{number:05d}", 2, segmentation, None)
    description = {"object_descriptions": [{"mesh_filename": mesh} for mesh in (MUG, GUITAR)]}
    (tmp_path / "training_set/scene_00000/scene_description.txt").write_text(json.dumps(description))
    return tmp_path


def test_masks_hold_the_categories_of_the_meshes(root: Path) -> None:
    before = Tod(root, "train")[0].categories
    done = write_semantic_masks(Tod(root, "train"), progress=False)
    assert done.frames == {"written": 1, "not described": 1}
    assert done.unknown == {"guitar": 1}
    segmentation, semseg = masks()
    mask = read_labels(root / "training_set/scene_00000/semseg_00002.png")
    np.testing.assert_array_equal(mask, np.where(segmentation == 3, 0, semseg))
    # The categories read from the masks equal those read from the meshes.
    assert Tod(root, "train")[0].categories == before == {2: "mug"}
    assert not (root / "training_set/scene_00001/semseg_00002.png").exists()


def test_other_categories_can_be_named(root: Path) -> None:
    source = Tod(root, "train", seen=None, category_names=["guitar", "mug"])
    assert write_semantic_masks(source, progress=False).unknown == {}
    mask = read_labels(root / "training_set/scene_00000/semseg_00002.png")
    segmentation, _ = masks()
    np.testing.assert_array_equal(mask, np.select([segmentation == 1, segmentation == 2, segmentation == 3], [3, 2, 1]))


def test_masks_that_are_there_stay(root: Path) -> None:
    path = root / "training_set/scene_00000/semseg_00002.png"
    write_semantic_masks(Tod(root, "train"), progress=False)
    before = path.stat().st_mtime_ns
    done = write_semantic_masks(Tod(root, "train"), progress=False)
    assert done.frames == {"kept": 1, "not described": 1}
    assert path.stat().st_mtime_ns == before


def test_a_broken_segmentation_is_named_and_leaves_no_mask(root: Path) -> None:
    (root / "training_set/scene_00000/segmentation_00002.png").write_bytes(b"")
    with pytest.raises(FrameReadError, match=r"segmentation_00002\.png"):
        write_semantic_masks(Tod(root, "train"), progress=False)
    assert not list(root.rglob("semseg_*"))
