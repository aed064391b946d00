from __future__ import annotations

import itertools

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.partition import (
    ConnectedComponents,
    GreedyMulticut,
    greedy_additive_edge_contraction,
    multicut_cost,
)
from tests.partition.graphs import graphs, least_cost, partitions, signed_weights


def contract_slowly(num_nodes: int, pairs: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """GAEC on a matrix of weights: the textbook form."""
    groups = [{node} for node in range(num_nodes)]
    while True:
        best, choice = 0.0, None
        for a, b in itertools.combinations(range(len(groups)), 2):
            between = sum(
                w
                for i, j, w in zip(*pairs, weight, strict=True)
                if (i in groups[a] and j in groups[b]) or (i in groups[b] and j in groups[a])
            )
            if between > best:
                best, choice = between, (a, b)
        if choice is None:
            break
        a, b = choice
        groups[a] |= groups.pop(b)
    segment = np.empty(num_nodes, dtype=np.int64)
    for number, group in enumerate(sorted(groups, key=min)):
        segment[list(group)] = number
    return segment


@pytest.mark.parametrize("num_nodes", [1, 2, 3, 4, 5])
def test_all_small_graphs_against_all_partitions(num_nodes: int):
    every_partition = np.stack(list(partitions(num_nodes)))
    optimal = total = 0
    for seed, pairs in enumerate(graphs(num_nodes)):
        weight = signed_weights(pairs.shape[1], seed)
        segment = greedy_additive_edge_contraction(num_nodes, pairs, weight)
        cost = multicut_cost(pairs, weight, segment)
        cut = every_partition[:, pairs[0]] != every_partition[:, pairs[1]]
        least = (cut * weight).sum(axis=1).min() if pairs.size else 0.0
        assert cost >= least - 1e-9
        # Not worse than all nodes separate or together, and merging any two segments brings no gain.
        assert cost <= weight.sum()
        for a, b in itertools.combinations(range(segment.max() + 1), 2):
            assert multicut_cost(pairs, weight, np.where(segment == b, a, segment)) >= cost
        graph = nx.Graph(pairs.T.tolist())
        if not pairs.size or nx.is_forest(graph) or (weight >= 0).all() or (weight <= 0).all():
            assert cost == pytest.approx(least)
        optimal += cost <= least + 1e-9
        total += 1
    # The greedy method is exact for up to three nodes, and nearly always on these graphs with random weights.
    assert optimal == total if num_nodes <= 3 else optimal >= 0.95 * total


@given(st.integers(2, 7), st.data())
@settings(max_examples=60, deadline=None)
def test_trees_are_solved_exactly(num_nodes: int, data: st.DataObject):
    parents = [data.draw(st.integers(0, node - 1)) for node in range(1, num_nodes)]
    pairs = np.array([parents, range(1, num_nodes)])
    weight = np.array(data.draw(st.lists(st.integers(-9, 9), min_size=num_nodes - 1, max_size=num_nodes - 1)), float)
    segment = greedy_additive_edge_contraction(num_nodes, pairs, weight)
    assert multicut_cost(pairs, weight, segment) == least_cost(num_nodes, pairs, weight) == weight[weight < 0].sum()


@given(st.integers(1, 8), st.data())
@settings(max_examples=60, deadline=None)
def test_weights_that_agree_with_a_partition_give_it_back(num_nodes: int, data: st.DataObject):
    truth = np.array(data.draw(st.lists(st.integers(0, 3), min_size=num_nodes, max_size=num_nodes)))
    pairs = np.array(list(itertools.combinations(range(num_nodes), 2)), dtype=np.int64).reshape(-1, 2).T
    same = truth[pairs[0]] == truth[pairs[1]]
    segment = greedy_additive_edge_contraction(num_nodes, pairs, np.where(same, 1.0, -1.0))
    assert ((segment[pairs[0]] == segment[pairs[1]]) == same).all()


def test_all_attractive_and_all_repulsive():
    pairs = np.array(list(itertools.combinations(range(6), 2))).T
    assert greedy_additive_edge_contraction(6, pairs, np.ones(15)).tolist() == [0] * 6
    assert greedy_additive_edge_contraction(6, pairs, -np.ones(15)).tolist() == list(range(6))
    assert greedy_additive_edge_contraction(6, pairs, np.zeros(15)).tolist() == list(range(6))


@given(st.integers(1, 12), st.integers(0, 2**32 - 1), st.data())
@settings(max_examples=80, deadline=None)
def test_the_heap_does_what_the_textbook_says(num_nodes: int, seed: int, data: st.DataObject):
    generator = np.random.default_rng(seed)
    every = np.array(list(itertools.combinations(range(num_nodes), 2)), dtype=np.int64).reshape(-1, 2)
    pairs = every[generator.random(len(every)) < data.draw(st.floats(0.1, 1))].T
    weight = signed_weights(pairs.shape[1], seed)
    expected = contract_slowly(num_nodes, pairs, weight)
    assert (greedy_additive_edge_contraction(num_nodes, pairs, weight) == expected).all()
    # Neither the order nor the direction of pairs matters, and repeated pairs add up.
    order = generator.permutation(pairs.shape[1])
    twice = np.concatenate([pairs[::-1][:, order], pairs], axis=1)
    halves = np.concatenate([weight[order] / 2, weight / 2])
    assert (greedy_additive_edge_contraction(num_nodes, twice, halves) == expected).all()


def test_parallel_edges_outvote_the_first():
    # 0-1 is contracted first; then 1-2 (+2) and 0-2 (-3) are one edge of weight -1.
    pairs = np.array([[0, 0, 1], [1, 2, 2]])
    assert greedy_additive_edge_contraction(3, pairs, np.array([5.0, -3.0, 2.0])).tolist() == [0, 0, 1]
    assert greedy_additive_edge_contraction(3, pairs, np.array([5.0, -3.0, 3.5])).tolist() == [0, 0, 0]


def test_ties_go_to_the_first_pair():
    pairs = np.array([[0, 1, 0], [1, 2, 2]])
    weight = np.array([1.0, 1.0, -4.0])  # 0-1 and 1-2 are tied; merging all would cost
    assert greedy_additive_edge_contraction(3, pairs, weight).tolist() == [0, 0, 1]


def test_one_false_merge_is_outvoted():
    pairs = np.array([[0, 0, 1, 3, 3, 4, 0, 1, 2], [1, 2, 2, 4, 5, 5, 3, 4, 5]])
    probability = [1, 1, 1, 1, 1, 1, 0.6, 0, 0]
    assert GreedyMulticut()(6, pairs, probability, np.full(9, 10)).tolist() == [0, 0, 0, 1, 1, 1]
    assert ConnectedComponents()(6, pairs, probability, np.full(9, 10)).tolist() == [0] * 6


def test_weights_of_edges():
    probability = np.array([0.5, 0.8, 0.0, 1.0])
    length = np.array([7.0, 3.0, 1.0, 1.0])
    assert GreedyMulticut().weights(probability, length) == pytest.approx(
        [0, 3 * np.log(4), -np.log(1e6 - 1), np.log(1e6 - 1)]
    )
    assert GreedyMulticut(0.8, "none").weights(probability, length)[:2] == pytest.approx([-np.log(4), 0])
    assert GreedyMulticut(border_weight="log").weights(probability, length)[1] == pytest.approx(np.log(4) ** 2)
    assert GreedyMulticut(epsilon=0.1).weights(probability, length)[3] == pytest.approx(np.log(9))


def test_options_that_do_not_exist():
    with pytest.raises(ValueError, match="'length', 'log' or 'none'"):
        GreedyMulticut(border_weight="area")
    with pytest.raises(ValueError, match="epsilon"):
        GreedyMulticut(epsilon=0)
