"""The survey of the training graphs before the first epoch."""

from __future__ import annotations

import math

import pytest
import torch

from sgbd.training import TrainingError, survey_graphs
from tests.graph_samples import grid_graph, path_graph


def test_pairs_nodes_and_edges_are_counted() -> None:
    survey = survey_graphs([path_graph([1, 0, -1, 1]), path_graph([0.0])], progress=False)
    assert (survey.merges, survey.cuts) == (2, 2)
    assert survey.nodes.count == 7
    assert survey.edges.count == 10


def test_graphs_without_labelled_pairs_are_not_usable(caplog: pytest.LogCaptureFixture) -> None:
    unknown = path_graph([-1.0, -1.0])
    graphs = [grid_graph(4, 8, seed=0), unknown, grid_graph(4, 8, seed=1)]
    assert survey_graphs(graphs, progress=False).usable.tolist() == [0, 2]
    assert "1 of 3 training graphs have no labelled pair" in caplog.text
    with pytest.raises(TrainingError, match="none of the 2 training graphs"):
        survey_graphs([unknown, unknown], progress=False)


def test_labels_of_one_class_are_told(caplog: pytest.LogCaptureFixture) -> None:
    survey_graphs([path_graph([1.0, 1.0])], progress=False)
    assert "all labelled pairs are of one class (2 merge, 0 cut)" in caplog.text


def test_graphs_without_labels_are_refused() -> None:
    graph = path_graph([1.0])
    del graph.edge_label
    with pytest.raises(TrainingError, match="no edge_label"):
        survey_graphs([graph], progress=False)


@pytest.mark.parametrize("field", ["x", "edge_attr"])
def test_features_that_are_not_finite_are_named(field: str) -> None:
    graphs = [grid_graph(3, 3, seed=seed) for seed in range(6)]
    graphs[5][field][2, 1] = math.nan
    with pytest.raises(TrainingError, match=rf"training graph grid5: {field} holds NaN.*column 1"):
        survey_graphs(graphs, progress=False)


def test_moments_are_those_of_all_graphs() -> None:
    graphs = [grid_graph(3, 3, seed=seed) for seed in range(3)]
    survey = survey_graphs(graphs, progress=False)
    rows = torch.cat([graph.x for graph in graphs])
    torch.testing.assert_close(survey.nodes.mean.float(), rows.mean(0))
