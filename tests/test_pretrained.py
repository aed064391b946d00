"""The packaged model: small, complete, and accurate on frames that it was not trained on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import sgbd.checkpoint
from sgbd import Segmenter
from sgbd.checkpoint import PRETRAINED_FILE, Checkpoint, CheckpointError, find_checkpoint
from sgbd.frame import Frame
from sgbd.metrics import ContingencyTable, overlap_scores
from sgbd.partition import ConnectedComponents
from sgbd.segmentation import ObjectRule
from sgbd.sources import Folder
from tests.desk import CAMERA, desk


@pytest.fixture(scope="module")
def segmenter() -> Segmenter:
    return Segmenter.pretrained()


def overlap_f(segmenter: Segmenter, frame: Frame) -> float:
    """Return overlap F of the segments that the model predicts to be objects."""
    found = segmenter.segment_frame(frame).instances
    table = ContingencyTable.from_label_maps(np.where(found > 0, found + 1, 0), frame.instances)
    return overlap_scores(table).f_measure


def test_the_file_is_at_most_0_4_megabytes() -> None:
    assert 0 < PRETRAINED_FILE.stat().st_size <= 400_000


def test_it_holds_its_whole_recipe_and_writes_back_to_the_same_file() -> None:
    checkpoint = Checkpoint.load(PRETRAINED_FILE)
    assert {"superpixels", "graph", "features", "model", "objectness", "partition", "objects"} <= set(checkpoint.recipe)
    assert checkpoint.objectness is not None, "without a head it could not tell objects from the table"
    assert checkpoint.to_bytes(half_precision=True) == PRETRAINED_FILE.read_bytes()


def test_boxes_on_a_table_are_found(segmenter: Segmenter) -> None:
    assert overlap_f(segmenter, desk()) > 0.75


def test_objects_of_real_frames_are_found(segmenter: Segmenter, shared_data: Path) -> None:
    frames = Folder(shared_data / "mosd_learn", intrinsics=CAMERA)
    assert np.mean([overlap_f(segmenter, frames[index]) for index in (0, 10, 20)]) > 0.85


def test_what_a_program_sets_in_pytorch_for_other_networks_changes_nothing(segmenter: Segmenter) -> None:
    frame = desk()
    expected = segmenter.segment_frame(frame)
    with torch.autocast("cpu"):
        in_autocast = segmenter.segment_frame(frame)
    with torch.device("meta"):  # stands for a GPU
        with_a_default_device = segmenter.segment_frame(frame)
    torch.set_default_dtype(torch.float64)
    try:
        with_a_default_dtype = Segmenter.pretrained().segment_frame(frame)
    finally:
        torch.set_default_dtype(torch.float32)
    for result in (in_autocast, with_a_default_device, with_a_default_dtype):
        assert (result.instances == expected.instances).all()
        assert result.scores.tolist() == expected.scores.tolist()


def test_its_partition_and_rule_can_be_replaced() -> None:
    partition, rule = ConnectedComponents(0.9), ObjectRule(min_objectness=1.0)
    segmenter = Segmenter.pretrained(partition=partition, rule=rule)
    assert segmenter.partition is partition
    assert not segmenter.segment_frame(desk()).instances.any()


def test_the_word_pretrained_means_it_whatever_else_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pretrained").mkdir()
    assert find_checkpoint("pretrained", tmp_path) == PRETRAINED_FILE
    assert find_checkpoint("./pretrained/", tmp_path) == Path("pretrained/checkpoint.safetensors")


def test_an_installation_without_it_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sgbd.checkpoint, "PRETRAINED_FILE", tmp_path / "sgbd.safetensors")
    for load in (Segmenter.pretrained, lambda: find_checkpoint("pretrained", tmp_path)):
        with pytest.raises(CheckpointError, match=r"no pretrained model: .*sgbd\.safetensors is missing.*pip"):
            load()
