from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.partition import (
    GreedyMulticut,
    Multicut,
    greedy_additive_edge_contraction,
    kernighan_lin,
    multicut_cost,
)
from tests.partition.graphs import graphs, partitions, random_pairs, signed_weights


def refined(num_nodes: int, pairs: np.ndarray, weight: np.ndarray) -> np.ndarray:
    return kernighan_lin(pairs, weight, greedy_additive_edge_contraction(num_nodes, pairs, weight))


@pytest.mark.parametrize("num_nodes", [2, 3, 4, 5])
def test_all_small_graphs_against_all_partitions(num_nodes: int):
    every_partition = np.stack(list(partitions(num_nodes)))
    optimal = total = 0
    for seed, pairs in enumerate(graphs(num_nodes)):
        weight = signed_weights(pairs.shape[1], seed)
        greedy = greedy_additive_edge_contraction(num_nodes, pairs, weight)
        cost = multicut_cost(pairs, weight, kernighan_lin(pairs, weight, greedy))
        cut = every_partition[:, pairs[0]] != every_partition[:, pairs[1]]
        least = (cut * weight).sum(axis=1).min() if pairs.size else 0.0
        assert least - 1e-9 <= cost <= multicut_cost(pairs, weight, greedy)
        optimal += cost <= least + 1e-9
        total += 1
    # Local search is not exact in general: it misses the optimum of a few of the 1024 graphs with five nodes.
    assert optimal == total if num_nodes <= 4 else optimal >= 0.99 * total


def test_it_takes_back_what_the_greedy_contraction_joined_too_early():
    # 1 and 2 are merged first, although they belong to different sides.
    pairs = np.array([[0, 0, 1, 1, 1, 2, 2], [1, 2, 2, 3, 4, 3, 4]])
    weight = np.array([4.0, -3.0, 4.5, -3.0, -3.0, 3.0, 3.0])
    greedy = greedy_additive_edge_contraction(5, pairs, weight)
    best = refined(5, pairs, weight)
    assert greedy.tolist() == [0, 0, 0, 1, 2]
    assert best.tolist() == [0, 0, 1, 1, 1]
    assert multicut_cost(pairs, weight, greedy) == -3 - 3 + 3 + 3
    assert multicut_cost(pairs, weight, best) == -3 + 4.5 - 3 - 3


@given(st.integers(2, 40), st.floats(0.05, 1), st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_never_worse_than_greedy_connected_and_at_rest(num_nodes: int, density: float, seed: int):
    pairs = random_pairs(num_nodes, density, seed)
    weight = signed_weights(pairs.shape[1], seed)
    greedy = greedy_additive_edge_contraction(num_nodes, pairs, weight)
    segment = kernighan_lin(pairs, weight, greedy, max_rounds=100)
    cost = multicut_cost(pairs, weight, segment)
    assert cost <= multicut_cost(pairs, weight, greedy)
    graph = nx.empty_graph(num_nodes)
    graph.add_edges_from(pairs.T.tolist())
    for label in range(segment.max() + 1):
        assert nx.is_connected(graph.subgraph(np.flatnonzero(segment == label).tolist()))
    # Moving any single node to a neighbouring segment or a new segment brings no gain.
    for node in range(num_nodes):
        around = segment[pairs[1][pairs[0] == node]].tolist() + segment[pairs[0][pairs[1] == node]].tolist()
        for label in {*around, num_nodes}:
            moved = segment.copy()
            moved[node] = label
            assert multicut_cost(pairs, weight, moved) >= cost - 1e-9


@given(st.integers(2, 30), st.integers(0, 2**32 - 1))
def test_it_mends_any_start(num_nodes: int, seed: int):
    """Two cliques that repel each other are found from a random partition."""
    generator = np.random.default_rng(seed)
    truth = np.arange(num_nodes) % 2
    pairs = random_pairs(num_nodes, 1.0, 0)
    weight = np.where(truth[pairs[0]] == truth[pairs[1]], 1.0, -1.0)
    segment = kernighan_lin(pairs, weight, generator.integers(0, 3, num_nodes), max_rounds=100)
    assert multicut_cost(pairs, weight, segment) == weight[weight < 0].sum()


def test_no_rounds_leave_the_greedy_partition():
    gains = 0
    for seed in range(10):
        pairs = random_pairs(30, 0.3, seed)
        generator = np.random.default_rng(seed)
        graph = (30, pairs, generator.random(pairs.shape[1]), generator.integers(1, 50, pairs.shape[1]))
        greedy = GreedyMulticut()(*graph)
        assert (Multicut(max_rounds=0)(*graph) == greedy).all()
        weight = GreedyMulticut().weights(graph[2], graph[3])
        gains += multicut_cost(pairs, weight, Multicut()(*graph)) < multicut_cost(pairs, weight, greedy) - 1
    assert gains >= 2, "on some of these graphs the greedy partition is not at rest"
    with pytest.raises(ValueError, match="max_rounds must be an integer from 0 on"):
        Multicut(max_rounds=-1)
