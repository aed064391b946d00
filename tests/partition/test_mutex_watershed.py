from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.partition import MutexWatershed, agglomerate
from tests.partition.graphs import graphs, numbered, random_pairs


def watershed_slowly(num_nodes: int, pairs: np.ndarray, weight: np.ndarray) -> list[int]:
    """The mutex watershed by definition, with sets for groups and for mutually exclusive nodes."""
    group = [{node} for node in range(num_nodes)]
    mutex: set[tuple[int, int]] = set()
    for edge in sorted(range(len(weight)), key=lambda e: (-abs(weight[e]), pairs[0, e], pairs[1, e])):
        a, b = group[pairs[0, edge]], group[pairs[1, edge]]
        if a is b:
            continue
        if weight[edge] <= 0:
            mutex |= {(i, j) for i in a for j in b} | {(j, i) for i in a for j in b}
        elif not any((i, j) in mutex for i in a for j in b):
            joined = a | b
            # A constraint of one member applies to the whole group.
            mutex |= {(i, k) for i in joined for j, k in mutex if j in joined}
            mutex |= {(k, i) for i in joined for j, k in mutex if j in joined}
            for node in joined:
                group[node] = joined
    return numbered([group[node] for node in range(num_nodes) if min(group[node]) == node], num_nodes)


@pytest.mark.parametrize("num_nodes", [1, 2, 3, 4])
def test_all_small_graphs_against_the_definition(num_nodes: int):
    for seed, pairs in enumerate(graphs(num_nodes)):
        # Few distinct weights give ties on most graphs.
        for weight in (
            np.random.default_rng(seed).uniform(-1, 1, pairs.shape[1]),
            np.random.default_rng(seed).integers(-2, 3, pairs.shape[1]).astype(float),
        ):
            segment = agglomerate(num_nodes, pairs, weight, "absolute_maximum", cannot_link=True)
            assert segment.tolist() == watershed_slowly(num_nodes, pairs, weight)


@given(st.integers(1, 12), st.floats(0.1, 1), st.booleans(), st.integers(0, 2**32 - 1))
@settings(max_examples=80)
def test_random_graphs_against_the_definition(num_nodes: int, density: float, ties: bool, seed: int):
    pairs = random_pairs(num_nodes, density, seed)
    weight = np.random.default_rng(seed).uniform(-1, 1, pairs.shape[1])
    if ties:
        weight = np.round(3 * weight)
    segment = agglomerate(num_nodes, pairs, weight, "absolute_maximum", cannot_link=True)
    assert segment.tolist() == watershed_slowly(num_nodes, pairs, weight)
    # For a repeated pair, the more certain edge counts.
    twice = np.concatenate([pairs, pairs[::-1]], axis=1)
    both = agglomerate(num_nodes, twice, np.concatenate([weight, -weight / 2]), "absolute_maximum", cannot_link=True)
    assert both.tolist() == segment.tolist()


def test_one_sure_cut_outweighs_many_merges():
    pairs = [[0, 0, 0, 1, 2], [1, 2, 3, 3, 3]]
    probability = [0.9, 0.9, 0.8, 0.05, 0.8]
    # 1 and 3 are forbidden first; then 0 goes with 1 and 2, and 3 stays alone.
    assert MutexWatershed()(4, pairs, probability, np.ones(5)).tolist() == [0, 0, 0, 1]
    # If the border length adds certainty, the long borders decide.
    assert MutexWatershed(border_weight="length")(4, pairs, probability, [9, 9, 9, 1, 9]).tolist() == [0, 0, 0, 0]
    # A lower threshold makes the cut with 0.05 less certain and the merge with 0.8 more certain.
    assert MutexWatershed(0.04)(4, pairs, probability, np.ones(5)).tolist() == [0, 0, 0, 0]


def test_probabilities_of_zero_and_one_are_ties_of_finite_strength():
    segment = MutexWatershed()(3, [[0, 0, 1], [1, 2, 2]], [1.0, 0.0, 1.0], np.ones(3))
    assert segment.tolist() == [0, 0, 1]
