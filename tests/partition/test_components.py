from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.partition import ConnectedComponents


def test_an_edge_is_kept_if_its_probability_is_above_the_threshold():
    pairs = [[0, 1, 2, 3], [1, 2, 3, 4]]
    segment = ConnectedComponents(0.5)(5, pairs, [0.51, 0.5, 0.9, 0.0], np.ones(4))
    assert segment.tolist() == [0, 0, 1, 1, 2]
    assert segment.dtype == np.int64


def test_one_false_merge_joins_everything():
    # Two triangles; one of the three edges between them is misclassified.
    pairs = np.array([[0, 0, 1, 3, 3, 4, 0, 1, 2], [1, 2, 2, 4, 5, 5, 3, 4, 5]])
    segment = ConnectedComponents()(6, pairs, [1, 1, 1, 1, 1, 1, 0.6, 0, 0], np.full(9, 10))
    assert segment.tolist() == [0] * 6


@given(st.integers(0, 9), st.data())
@settings(deadline=None)
def test_components_are_those_of_networkx(num_nodes: int, data: st.DataObject):
    possible = [(i, j) for i in range(num_nodes) for j in range(num_nodes) if i != j]
    pairs = data.draw(st.lists(st.sampled_from(possible), max_size=14)) if possible else []
    probability = data.draw(st.lists(st.floats(0, 1), min_size=len(pairs), max_size=len(pairs)))
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    segment = ConnectedComponents(0.4)(num_nodes, ends, probability, np.ones(len(pairs)))

    graph = nx.Graph()
    graph.add_nodes_from(range(num_nodes))
    graph.add_edges_from(pair for pair, p in zip(pairs, probability, strict=True) if p > 0.4)
    expected = sorted(sorted(component) for component in nx.connected_components(graph))
    assert [np.flatnonzero(segment == s).tolist() for s in range(segment.max(initial=-1) + 1)] == expected


@pytest.mark.parametrize("threshold", [0, 1, -0.1, 1.5, float("nan")])
def test_a_threshold_that_is_no_probability(threshold: float):
    with pytest.raises(ValueError, match="threshold must be a probability"):
        ConnectedComponents(threshold)
