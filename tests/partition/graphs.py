"""Signed graphs for tests of partitioners: all small graphs, and random ones with exactly summable weights."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from sgbd.partition import multicut_cost


def partitions(num_nodes: int) -> Iterator[np.ndarray]:
    """Yield all partitions of a set, as restricted growth strings."""

    def grow(prefix: list[int]) -> Iterator[list[int]]:
        if len(prefix) == num_nodes:
            yield prefix
            return
        for group in range(max(prefix, default=-1) + 2):
            yield from grow([*prefix, group])

    yield from (np.array(partition, dtype=np.int64) for partition in grow([]))


def graphs(num_nodes: int) -> Iterator[np.ndarray]:
    """Yield all graphs on labelled nodes, as pairs [2, E]."""
    every = list(itertools.combinations(range(num_nodes), 2))
    for size in range(len(every) + 1):
        for pairs in itertools.combinations(every, size):
            yield np.array(pairs, dtype=np.int64).reshape(-1, 2).T


def least_cost(num_nodes: int, pairs: np.ndarray, weight: np.ndarray) -> float:
    return min(multicut_cost(pairs, weight, segment) for segment in partitions(num_nodes))


def signed_weights(count: int, seed: int) -> np.ndarray:
    """Return distinct weights whose sums are exact in any order."""
    generator = np.random.default_rng(seed)
    return generator.integers(-(2**20), 2**20, count) / 2**10 + generator.permutation(count) / 2**20


def random_pairs(num_nodes: int, density: float, seed: int) -> np.ndarray:
    """Return the sorted pairs [2, E] of a random graph."""
    every = np.array(list(itertools.combinations(range(num_nodes), 2)), dtype=np.int64).reshape(-1, 2)
    return every[np.random.default_rng(seed).random(len(every)) < density].T


def numbered(groups: list[set[int]], num_nodes: int) -> list[int]:
    """Renumber segments in the order of first appearance."""
    segment = [0] * num_nodes
    for number, group in enumerate(sorted(groups, key=min)):
        for node in group:
            segment[node] = number
    return segment
