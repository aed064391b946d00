from pathlib import Path

import numpy as np
import pytest
import torch

from sgbd import Segmenter
from sgbd.checkpoint import Checkpoint, CheckpointError
from sgbd.data import SuperpixelGraphDataset
from sgbd.frame import FrameError
from sgbd.graph import GraphBuilder
from sgbd.label_map import unpack
from sgbd.models import ObjectnessHead, SharedMLP
from sgbd.partition import ConnectedComponents
from sgbd.preparation import prepare
from sgbd.recipe import describe
from sgbd.reduction import enlarged, reduced
from sgbd.segmentation import ObjectRule, classify, paint, partition_graph
from sgbd.superpixels import Slic
from tests.scenes import Scenes, scene

FEATURES = {"node": ["rgb", "depth"], "edge": ["convexity"]}
CHANNELS = {"node_channels": 4, "edge_channels": 4}


@pytest.fixture
def checkpoint() -> Checkpoint:
    torch.manual_seed(0)
    recipe = {
        "superpixels": describe(Slic(40, min_size=4)),
        "graph": describe(GraphBuilder()),
        "features": FEATURES,
        "model": {"_target_": "sgbd.models.SharedMLP", "hidden_channels": [8], **CHANNELS},
        "objectness": {"_target_": "sgbd.models.ObjectnessHead", "hidden_channels": [8], "node_channels": 4},
        "partition": {"_target_": "sgbd.partition.ConnectedComponents", "threshold": 0.5},
        "objects": {"_target_": "sgbd.segmentation.ObjectRule", "min_objectness": 0.3, "min_area": 5},
    }
    return Checkpoint(SharedMLP(**CHANNELS, hidden_channels=[8]), ObjectnessHead(4, [8]), recipe)


def test_a_frame_and_its_prepared_graph_are_segmented_alike(checkpoint: Checkpoint, tmp_path: Path) -> None:
    segmenter = Segmenter.load(checkpoint.save(tmp_path / "model.safetensors"))
    folder = prepare(Scenes("test"), segmenter.superpixels, segmenter.graph, tmp_path / "graphs", workers=0)
    graphs = SuperpixelGraphDataset(folder, "test", FEATURES["node"], FEATURES["edge"])
    for frame, data in zip(Scenes("test"), graphs, strict=True):
        result = segmenter.segment_frame(frame)
        classification = classify(segmenter.model, segmenter.objectness, data)
        segments = partition_graph(data, classification, segmenter.partition, segmenter.rule)
        from_cache = paint(unpack(data.label_map, (frame.height, frame.width)), data, classification, segments)
        assert (result.instances == from_cache.instances).all()
        assert result.scores.tolist() == from_cache.scores.tolist()
        assert result.edge_probability.tolist() == from_cache.edge_probability.tolist()


def test_arrays_in_metres_and_millimetres_give_the_same_objects(checkpoint: Checkpoint) -> None:
    segmenter, frame = Segmenter(checkpoint), scene(0)
    millimeters = (frame.depth * 1000).round().astype(np.uint16)
    meters = millimeters.astype(np.float32) * np.float32(0.001)
    results = [segmenter.segment(frame.rgb, depth) for depth in (millimeters, meters)]
    assert (results[0].instances == results[1].instances).all()
    assert results[0].instances.dtype == np.int32
    assert results[0].instances.shape == frame.depth.shape
    assert results[0].superpixels.shape == frame.depth.shape


def test_a_reduced_frame_is_segmented_and_its_maps_are_enlarged(checkpoint: Checkpoint) -> None:
    frame = scene(0)
    result = Segmenter(checkpoint, reduce=3).segment_frame(frame)
    expected = Segmenter(checkpoint).segment_frame(reduced(frame, 3))
    for name in ("instances", "superpixels"):
        whole = enlarged(getattr(expected, name), 3, frame.height, frame.width)
        assert getattr(result, name).tolist() == whole.tolist()
    assert result.scores.tolist() == expected.scores.tolist()
    assert result.instances.shape == frame.depth.shape


@pytest.mark.parametrize("reduce", [0, -1, 1.5, True])
def test_frames_are_reduced_by_positive_integers(checkpoint: Checkpoint, reduce: float) -> None:
    with pytest.raises(ValueError, match="reduce must be a positive integer"):
        Segmenter(checkpoint, reduce=reduce)


def test_partition_and_rule_can_take_the_place_of_the_recipes(checkpoint: Checkpoint) -> None:
    frame = scene(0)
    all_apart = Segmenter(checkpoint, partition=ConnectedComponents(0.999), rule=ObjectRule(min_objectness=0.0))
    result = all_apart.segment_frame(frame)
    assert len(result.scores) == result.superpixels.max() + 1
    nothing = Segmenter(checkpoint, rule=ObjectRule(min_objectness=1.0)).segment_frame(frame)
    assert len(nothing.scores) == 0
    assert not nothing.instances.any()


def test_arrays_that_are_no_frame_are_refused(checkpoint: Checkpoint) -> None:
    frame = scene(0)
    with pytest.raises(FrameError, match="both must be"):
        Segmenter(checkpoint).segment(frame.rgb, frame.depth[1:])


@pytest.mark.parametrize("device", ["cuda:99", "abacus"])
def test_a_device_that_is_not_there_is_refused(checkpoint: Checkpoint, device: str) -> None:
    with pytest.raises(ValueError, match=rf"device {device} cannot be used here: .*use device=cpu"):
        Segmenter(checkpoint, device=device)


def test_a_recipe_with_gaps_is_refused(checkpoint: Checkpoint) -> None:
    del checkpoint.recipe["superpixels"]
    with pytest.raises(CheckpointError, match="the recipe names no class"):
        Segmenter(checkpoint)
