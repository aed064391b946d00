"""A cached node block next to prepared graphs, tested with a block that needs no weights: the mean colours."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from sgbd.agglomeration import AgglomeratedGraph
from sgbd.data import GraphCacheError, SuperpixelGraphDataset
from sgbd.features import node_columns
from sgbd.graph import GraphBuilder
from sgbd.node_block import NodeBlock, NodeBlockError, mean_over_superpixels, required_block, split_groups
from sgbd.node_block_cache import find_node_block, node_block_folder, prepare_node_block
from sgbd.preparation import PreparationError, graph_file_name, prepare
from sgbd.superpixels import FastSlic
from tests.scenes import Scenes
from tests.test_agglomeration import checkpoint as first_stage


class Colors(NodeBlock):
    group = "colors"

    def __init__(self, scale: float = 1 / 255) -> None:
        self.scale = scale
        self.computed = 0

    @property
    def names(self) -> tuple[str, ...]:
        return ("colors_0", "colors_1", "colors_2")

    def planes(self, images):
        self.computed += len(images)
        return [image.transpose(2, 0, 1).astype(np.float32) * np.float32(self.scale) for image in images]

    def recipe(self):
        return {"_target_": f"{__name__}.Colors", "scale": self.scale}


@pytest.fixture
def prepared(tmp_path: Path) -> Path:
    return prepare(Scenes("train"), FastSlic(n_segments=12), GraphBuilder(), tmp_path, progress=False)


def add(folder: Path, block: NodeBlock) -> Path:
    return prepare_node_block(folder, Scenes("train"), block, progress=False)


def test_the_columns_are_appended_in_the_order_of_the_superpixels(prepared: Path) -> None:
    add(prepared, Colors())
    dataset = SuperpixelGraphDataset(prepared, node_features=["colors", "depth", "rgb"])
    assert dataset.node_channels == 7
    whole = SuperpixelGraphDataset(prepared)
    for data, every in zip(dataset, whole, strict=True):
        assert torch.equal(data.x[:, :4], every.x[:, node_columns(["rgb", "depth"])])
        # The mean colour is also a feature of the graphs.
        assert torch.allclose(data.x[:, 4:], every.x[:, node_columns(["rgb"])], atol=1e-5)
    assert whole.node_channels == len(node_columns()), "all features are those of every graph"


def test_the_nodes_of_a_second_stage_get_their_own_columns(tmp_path: Path) -> None:
    torch.manual_seed(0)
    graph = AgglomeratedGraph(first_stage(GraphBuilder()), threshold=0.4)
    folder = prepare(Scenes("train"), FastSlic(n_segments=40), graph, tmp_path, progress=False)
    add(folder, Colors())
    dataset = SuperpixelGraphDataset(folder, node_features=["colors", "rgb"])
    assert sum(data.node_of_superpixel.numel() - data.num_nodes for data in dataset) > 0, "some superpixels are merged"
    for data in dataset:
        assert torch.allclose(data.x[:, -3:], data.x[:, :3], atol=1e-5)


def test_the_block_alone(prepared: Path) -> None:
    add(prepared, Colors())
    data = SuperpixelGraphDataset(prepared, node_features=["colors"], edge_features=[])[0]
    assert data.x.shape[1] == 3
    assert data.x.dtype == torch.float32


def test_it_is_computed_once_and_goes_on_where_it_was(prepared: Path) -> None:
    block = Colors()
    folder = add(prepared, block)
    assert block.computed == 6
    add(prepared, block)
    assert block.computed == 6
    lost = folder / "train" / graph_file_name("scene2")
    content = lost.read_bytes()
    lost.unlink()
    (folder / "train" / graph_file_name("scene4")).write_bytes(b"cut")
    (folder / "train" / "index.json").unlink()
    (folder / "train" / ".x.tmp").touch()
    assert add(prepared, block) == folder
    assert block.computed == 8
    assert lost.read_bytes() == content
    assert not (folder / "train" / ".x.tmp").exists()


def test_the_graphs_are_not_touched(prepared: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in prepared.rglob("*") if path.is_file()}
    add(prepared, Colors())
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_other_settings_are_another_block(prepared: Path) -> None:
    first, second = add(prepared, Colors()), add(prepared, Colors(scale=2.0))
    assert first != second
    with pytest.raises(PreparationError, match="several blocks of the group colors"):
        find_node_block(prepared, "colors")
    name = node_block_folder(Colors(scale=2.0))
    data = SuperpixelGraphDataset(prepared, node_features=["rgb", "colors"], node_block=name)[0]
    assert torch.allclose(data.x[:, 3:], 510 * data.x[:, :3], rtol=1e-4)


def test_frames_that_changed_are_computed_anew(tmp_path: Path) -> None:
    files = [tmp_path / f"{number}.txt" for number in range(6)]
    for file in files:
        file.write_text("frame")

    class OnDisk(Scenes):
        def files(self, index: int) -> tuple[Path, ...]:
            return (files[index],)

    def prepare_graphs() -> Path:
        return prepare(OnDisk("train"), FastSlic(n_segments=12), GraphBuilder(), tmp_path / "cache", progress=False)

    block = Colors()
    folder = prepare_graphs()
    prepare_node_block(folder, OnDisk("train"), block, progress=False)
    later = time.time() + 5
    os.utime(files[3], (later, later))
    assert prepare_graphs() == folder
    with pytest.raises(GraphCacheError, match="or of other frames"):
        SuperpixelGraphDataset(folder, node_features=["colors"])
    prepare_node_block(folder, OnDisk("train"), block, progress=False)
    assert block.computed == 7
    assert len(SuperpixelGraphDataset(folder, node_features=["colors"])) == 6


def test_errors_say_what_to_do(prepared: Path) -> None:
    with pytest.raises(ValueError, match=r"unknown node feature group dino; .*(?s:.)* node_block=dino_vits16"):
        SuperpixelGraphDataset(prepared, node_features=["rgb", "dino"])
    with pytest.raises(PreparationError, match="prepare them first"):
        prepare_node_block(prepared, Scenes("test"), Colors(), progress=False)
    add(prepared, Colors())
    prepare(Scenes("test"), FastSlic(n_segments=12), GraphBuilder(), prepared.parent, progress=False)
    with pytest.raises(GraphCacheError, match="not complete for test"):
        SuperpixelGraphDataset(prepared, "test", node_features=["colors"])


def test_which_groups_need_a_block() -> None:
    block = Colors()
    assert split_groups(None) == (None, [])
    assert split_groups(["colors", "rgb"]) == (["rgb"], ["colors"])
    assert required_block(["rgb"], block) is None
    assert required_block(None, block) is None
    assert required_block(["rgb", "colors"], block) is block
    with pytest.raises(NodeBlockError, match="unknown node feature group dino; choose from rgb, .*, colors"):
        required_block(["dino"], block)
    with pytest.raises(NodeBlockError, match="node_block=dino_vits16 has the group dino"):
        required_block(["dino"], None)


def test_the_recipe_is_readable(prepared: Path) -> None:
    recipe = json.loads((add(prepared, Colors()) / "recipe.json").read_text())
    assert recipe["group"] == "colors"
    assert recipe["names"] == ["colors_0", "colors_1", "colors_2"]
    assert recipe["scale"] == 1 / 255


def test_means_over_superpixels_by_hand() -> None:
    label_map = np.array([[0, 0, 1], [2, 0, 1]], np.int32)
    planes = np.array([[[1, 2, 3], [4, 6, 5]], [[0, 0, 1], [7, 3, 0]]], np.float32)
    assert mean_over_superpixels(label_map, planes).tolist() == [[3, 1], [4, 0.5], [4, 7]]
