from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.partition import AverageLinkage, agglomerate
from tests.partition.graphs import graphs, numbered, random_pairs


def agglomerate_slowly(
    num_nodes: int, pairs: np.ndarray, weight: np.ndarray, share: np.ndarray, cannot_link: bool
) -> list[int]:
    """Average linkage by definition: the mean over all edges between two groups is recomputed in every step."""
    groups = [{node} for node in range(num_nodes)]
    forbidden: list[tuple[int, int]] = []

    def is_forbidden(a: set[int], b: set[int]) -> bool:
        return any((i in a and j in b) or (i in b and j in a) for i, j in forbidden)

    while True:
        best, choice, positive = 0.0, None, False
        for a, b in itertools.combinations(range(len(groups)), 2):
            between = [
                e
                for e, (i, j) in enumerate(pairs.T.tolist())
                if (i in groups[a] and j in groups[b]) or (i in groups[b] and j in groups[a])
            ]
            if not between or is_forbidden(groups[a], groups[b]):
                continue
            mean = (weight[between] * share[between]).sum() / share[between].sum()
            strength = abs(mean) if cannot_link else mean
            if strength > best:
                best, choice, positive = strength, (a, b), mean > 0
        if choice is None:
            return numbered(groups, num_nodes)
        a, b = choice
        if positive:
            groups[a] |= groups.pop(b)
        else:
            forbidden += itertools.product(groups[a], groups[b])


def shares(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed + 1).integers(1, 60, count).astype(float)


@pytest.mark.parametrize("cannot_link", [False, True])
@pytest.mark.parametrize("num_nodes", [1, 2, 3, 4])
def test_all_small_graphs_against_the_definition(num_nodes: int, cannot_link: bool):
    for seed, pairs in enumerate(graphs(num_nodes)):
        weight = np.random.default_rng(seed).uniform(-1, 1, pairs.shape[1])
        share = shares(pairs.shape[1], seed)
        segment = agglomerate(num_nodes, pairs, weight, "mean", share, cannot_link)
        assert segment.tolist() == agglomerate_slowly(num_nodes, pairs, weight, share, cannot_link)


@given(st.integers(1, 11), st.floats(0.1, 1), st.booleans(), st.integers(0, 2**32 - 1))
@settings(max_examples=80)
def test_random_graphs_against_the_definition(num_nodes: int, density: float, cannot_link: bool, seed: int):
    pairs = random_pairs(num_nodes, density, seed)
    weight = np.random.default_rng(seed).uniform(-1, 1, pairs.shape[1])
    share = shares(pairs.shape[1], seed)
    segment = agglomerate(num_nodes, pairs, weight, "mean", share, cannot_link)
    assert segment.tolist() == agglomerate_slowly(num_nodes, pairs, weight, share, cannot_link)
    # Repeated pairs count as one pair with the sum of their votes.
    twice = np.concatenate([pairs, pairs[::-1]], axis=1)
    both = agglomerate(num_nodes, twice, np.tile(weight, 2), "mean", np.tile(share, 2), cannot_link)
    assert both.tolist() == segment.tolist()


def test_the_mean_counts_border_pixels():
    # 0-1 is merged first. Its border to 2 then has 30 pixels with 0.6 and 10 with 0.1: 0.475 on average.
    graph = (3, [[0, 0, 1], [1, 2, 2]], [0.9, 0.6, 0.1], [5, 30, 10])
    assert AverageLinkage(0.47)(*graph).tolist() == [0, 0, 0]
    assert AverageLinkage(0.48)(*graph).tolist() == [0, 0, 1]
    assert AverageLinkage(0.34, "none")(*graph).tolist() == [0, 0, 0]
    assert AverageLinkage(0.36, "none")(*graph).tolist() == [0, 0, 1]
    mean = (np.log(31) * 0.6 + np.log(11) * 0.1) / np.log(31 * 11)
    assert AverageLinkage(mean - 0.01, "log")(*graph).tolist() == [0, 0, 0]
    assert AverageLinkage(mean + 0.01, "log")(*graph).tolist() == [0, 0, 1]


def test_a_sure_cut_forbids_for_good():
    # 1-2 is a more certain cut than the merges, but their mean outvotes it unless cuts forbid merging.
    graph = (3, [[0, 0, 1], [1, 2, 2]], [0.95, 0.9, 0.01], [10, 30, 10])
    assert AverageLinkage()(*graph).tolist() == [0, 0, 0]
    assert AverageLinkage(cannot_link=True)(*graph).tolist() == [0, 0, 1]


def test_pairs_that_do_not_touch_count_like_a_pixel():
    assert AverageLinkage()(2, [[0], [1]], [0.6], [0]).tolist() == [0, 0]
    assert AverageLinkage(border_weight="log")(2, [[0], [1]], [0.4], [0]).tolist() == [0, 1]


def test_border_weights_that_do_not_exist():
    with pytest.raises(ValueError, match="'length', 'log' or 'none'"):
        AverageLinkage(border_weight="area")  # type: ignore[arg-type]
