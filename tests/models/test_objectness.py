"""The objectness head."""

from __future__ import annotations

import pytest
import torch
from torch_geometric.loader import DataLoader

from sgbd.models import ObjectnessHead, object_targets
from tests.graph_samples import graph_of_pairs, grid_graph, path_graph


def test_targets() -> None:
    assert object_targets(torch.tensor([-1, 0, 1, 2, 17])).tolist() == [-1.0, 0.0, 0.0, 1.0, 1.0]


def test_input_is_own_neighbours_and_graph_mean() -> None:
    data = path_graph([1, 0], node_channels=1)
    data.x = torch.tensor([[1.0], [2.0], [6.0]])
    head = ObjectnessHead(1, hidden_channels=[4]).eval()
    seen = []
    head.mlp.register_forward_pre_hook(lambda module, inputs: seen.append(inputs[0]))
    head(data)
    assert seen[0].tolist() == [[1.0, 2.0, 3.0], [2.0, 3.5, 3.0], [6.0, 2.0, 3.0]]


def test_a_batch_gives_what_its_graphs_give_alone() -> None:
    graphs = [grid_graph(3, 4, seed=seed) for seed in range(3)]
    head = ObjectnessHead(3).eval()
    batch = next(iter(DataLoader(graphs, batch_size=3)))
    with torch.no_grad():
        torch.testing.assert_close(head(batch), torch.cat([head(graph) for graph in graphs]), rtol=1e-5, atol=1e-6)


def test_a_superpixel_without_neighbours() -> None:
    data = graph_of_pairs(torch.empty(2, 0, dtype=torch.int64), [], nodes=1)
    assert torch.isfinite(ObjectnessHead(3).eval()(data)).all()


def test_bad_sizes_are_refused() -> None:
    with pytest.raises(ValueError, match="objectness=none"):
        ObjectnessHead(0)
    with pytest.raises(ValueError, match=r"built for 4 node feature columns; data.x has shape \(2, 3\)"):
        ObjectnessHead(4)(path_graph([1]))
