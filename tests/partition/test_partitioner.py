"""The common contract of all partitioners: input, output, errors and the effect of objectness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hydra.utils import instantiate
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from sgbd.partition import (
    AverageLinkage,
    ConnectedComponents,
    GreedyMulticut,
    Multicut,
    MutexWatershed,
    Partitioner,
)
from sgbd.partition.partitioner import joint_probability
from tests.partition.graphs import random_pairs

CLASSES = [AverageLinkage, ConnectedComponents, GreedyMulticut, Multicut, MutexWatershed]
PARTITIONERS = [*(kind() for kind in CLASSES), AverageLinkage(cannot_link=True)]


@pytest.mark.parametrize("partition", PARTITIONERS)
def test_graphs_without_edges_or_nodes(partition: Partitioner):
    nothing = np.empty(0, dtype=np.float32)
    assert partition(0, np.empty((2, 0), dtype=np.int64), nothing, nothing).shape == (0,)
    assert partition(3, np.empty((2, 0), dtype=np.int64), nothing, nothing).tolist() == [0, 1, 2]
    assert partition(1, np.empty((2, 0), dtype=np.int64), nothing, nothing).dtype == np.int64


@pytest.mark.parametrize("partition", PARTITIONERS)
@pytest.mark.parametrize(
    ("num_nodes", "pairs", "probability", "length", "message"),
    [
        (2, [0, 1], [0.5], [1], r"shape \[2, E\]"),
        (2, [[0], [1]], [0.5, 0.5], [1], r"must have shape \[1\]"),
        (2, [[0], [1]], [0.5], [], r"must have shape \[1\]"),
        (2, [[0], [2]], [0.5], [1], "superpixels 0 to 1"),
        (2, [[1], [1]], [0.5], [1], "paired with itself"),
        (2, [[0], [1]], [1.5], [1], "apply the sigmoid"),
        (2, [[0], [1]], [float("nan")], [1], "must be in 0 to 1"),
        (2, [[0], [1]], [0.5], [-1], "border lengths"),
        (-1, [[], []], [], [], "must not be negative"),
    ],
)
def test_what_is_no_graph(partition, num_nodes, pairs, probability, length, message):
    with pytest.raises(ValueError, match=message):
        partition(num_nodes, pairs, probability, length)


@pytest.mark.parametrize("partition", PARTITIONERS)
@given(st.integers(1, 14), st.floats(0.1, 1), st.integers(0, 2**32 - 1))
def test_neither_order_nor_direction_of_pairs_matters(
    partition: Partitioner, num_nodes: int, density: float, seed: int
):
    pairs = random_pairs(num_nodes, density, seed)
    generator = np.random.default_rng(seed)
    # Borders of one pixel: sums do not depend on the order, except for ties decided by rounding.
    probability, length = generator.random(pairs.shape[1]), np.ones(pairs.shape[1])
    segment = partition(num_nodes, pairs, probability, length)
    assert segment.dtype == np.int64
    _, first = np.unique(segment, return_index=True)
    assert (np.diff(first) > 0).all(), "numbered in the order of first appearance"
    order = generator.permutation(pairs.shape[1])
    ends = pairs[:, order]
    swapped = np.where(generator.random(len(order)) < 0.5, ends, ends[::-1])
    assert (partition(num_nodes, swapped, probability[order], length[order]) == segment).all()


@pytest.mark.parametrize("partition", PARTITIONERS)
def test_clear_probabilities_leave_no_choice(partition: Partitioner):
    truth = np.array([0, 0, 1, 1, 0, 2, 1])
    pairs = random_pairs(7, 1.0, 0)
    same = truth[pairs[0]] == truth[pairs[1]]
    segment = partition(7, pairs, np.where(same, 0.9, 0.1), np.ones(len(same)))
    assert segment.tolist() == truth.tolist()


@pytest.mark.parametrize("kind", CLASSES)
def test_objectness_keeps_an_object_off_the_table(kind: type):
    # 0 and 1 are an object, 2 and 3 the table; the edge between 1 and 2 says merge.
    graph = (4, [[0, 1, 2], [1, 2, 3]], [0.9, 0.8, 0.9], [5, 5, 5])
    objectness = [0.9, 0.9, 0.1, 0.1]
    assert kind()(*graph, objectness).tolist() == [0, 0, 0, 0], "off unless asked for"
    assert kind(objectness_weight=1.0)(*graph, objectness).tolist() == [0, 0, 1, 1]
    assert kind(objectness_weight=1.0)(*graph).tolist() == [0, 0, 0, 0], "not known"


def test_the_joint_probability():
    pairs, probability = np.array([[0, 0], [1, 2]]), np.array([0.8, 0.5])
    joint = joint_probability(pairs, probability, [0.9, 0.4, 0.9], 2.0)
    assert joint == pytest.approx([0.8 * 0.25, 0.5])
    assert joint_probability(pairs, probability, [0.9, 0.4, 0.9], 0.0) is probability
    assert joint_probability(pairs, probability, None, 2.0) is probability
    with pytest.raises(ValueError, match=r"one objectness for each superpixel, got shape \[2\]"):
        joint_probability(pairs, probability, [0.9, 0.4], 1.0)
    with pytest.raises(ValueError, match="apply the sigmoid"):
        joint_probability(pairs, probability, [0.9, 1.4, 0.0], 1.0)


@pytest.mark.parametrize("kind", CLASSES)
def test_impossible_options_are_refused(kind: type):
    with pytest.raises(ValueError, match="threshold must be a probability"):
        kind(threshold=1.0)
    with pytest.raises(ValueError, match="objectness_weight"):
        kind(objectness_weight=-1.0)


@pytest.mark.parametrize(
    ("file", "partition"),
    [
        ("average_linkage", AverageLinkage()),
        ("components", ConnectedComponents()),
        ("kernighan_lin", Multicut()),
        ("multicut", GreedyMulticut()),
        ("mutex_watershed", MutexWatershed()),
    ],
)
def test_the_shipped_configurations(file: str, partition: Partitioner):
    folder = Path(__file__).parents[2] / "conf" / "partition"
    assert len(list(folder.glob("*.yaml"))) == 5
    config = OmegaConf.load(folder / f"{file}.yaml")
    assert repr(instantiate(config)) == repr(partition)
    assert set(config) - {"_target_"} == set(vars(partition)), "every option is shown"
