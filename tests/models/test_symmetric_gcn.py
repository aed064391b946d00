"""The convolution on undirected edges compared with a plain loop, and the invariances of its logits."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch_geometric.data import Data

from sgbd.models.symmetric_gcn import SymmetricConvolution, SymmetricGCN, undirected
from tests.graph_samples import graph_of_pairs, grid_graph, path_graph

SQUARE = torch.tensor([[0, 0, 1, 2, 1], [1, 2, 3, 3, 2]])
"""Pairs of four nodes, all adjacent except 0 and 3."""


def randomised(module: torch.nn.Module) -> torch.nn.Module:
    """Give every weight and running moment a random value, so that nothing agrees by accident."""
    torch.manual_seed(1)
    for tensor in (*module.parameters(), *module.buffers()):
        if tensor.is_floating_point():
            tensor.data = torch.rand_like(tensor) + 0.1 if tensor.dim() == 1 else torch.randn_like(tensor) * 0.3
    return module.eval()


def model(edge_channels: int = 2) -> SymmetricGCN:
    built = randomised(SymmetricGCN(3, edge_channels, hidden_channels=8, num_layers=3))
    assert isinstance(built, SymmetricGCN)
    return built


def plain_loop(layer: SymmetricConvolution, nodes: Tensor, edges: Tensor, pairs: Tensor) -> tuple[Tensor, Tensor]:
    """The formula of `SymmetricConvolution`, node by node and edge by edge."""
    width = nodes.size(1)
    (a, u, v), (a_bias, u_bias, v_bias) = layer.node_linear.weight.split(width), layer.node_linear.bias.split(width)
    c = layer.edge_linear.weight

    def normed(norm: torch.nn.BatchNorm1d, value: Tensor) -> Tensor:
        assert norm.running_mean is not None
        assert norm.running_var is not None
        return (value - norm.running_mean) / (norm.running_var + norm.eps).sqrt() * norm.weight + norm.bias

    logits = {}
    for k, (i, j) in enumerate(pairs.t().tolist()):
        logits[i, j] = logits[j, i] = (a @ nodes[i] + a_bias) + (a @ nodes[j] + a_bias) + c @ edges[k]
    new_edges = [edges[k] + normed(layer.edge_norm, logits[i, j]).relu() for k, (i, j) in enumerate(pairs.t().tolist())]
    new_nodes = []
    for i in range(len(nodes)):
        around = [j for (start, j) in logits if start == i]
        gates = sum((logits[i, j].sigmoid() for j in around), torch.zeros(width))
        messages = sum((logits[i, j].sigmoid() * (v @ nodes[j] + v_bias) for j in around), torch.zeros(width))
        update = u @ nodes[i] + u_bias + messages / (gates + 1e-6)
        new_nodes.append(nodes[i] + normed(layer.node_norm, update).relu())
    return torch.stack(new_nodes), torch.stack(new_edges) if new_edges else edges


@pytest.mark.parametrize("pairs", [SQUARE, SQUARE[:, :1], SQUARE[:, :0]], ids=["square", "one edge", "no edge"])
def test_a_convolution_is_the_formula(pairs: Tensor) -> None:
    layer = randomised(SymmetricConvolution(6))
    assert isinstance(layer, SymmetricConvolution)
    nodes, edges = torch.randn(4, 6), torch.randn(pairs.size(1), 6)
    with torch.no_grad():
        got_nodes, got_edges = layer(nodes, edges, pairs)
        want_nodes, want_edges = plain_loop(layer, nodes, edges, pairs)
    torch.testing.assert_close(got_nodes, want_nodes, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(got_edges, want_edges, rtol=1e-5, atol=1e-5)
    # If all updates were clipped to 0, all of the above would agree trivially.
    assert not torch.equal(got_nodes, nodes)


def test_the_ends_of_a_pair_may_change_places_in_a_convolution() -> None:
    layer = randomised(SymmetricConvolution(6))
    nodes, edges = torch.randn(4, 6), torch.randn(5, 6)
    turned = torch.where(torch.tensor([True, False, True, True, False]), SQUARE.flip(0), SQUARE)
    with torch.no_grad():
        for got, want in zip(layer(nodes, edges, turned), layer(nodes, edges, SQUARE), strict=True):
            torch.testing.assert_close(got, want, rtol=1e-5, atol=1e-6)


def test_one_edge_is_made_of_two_directions() -> None:
    # (0, 1) and (1, 2), in both directions.
    edge_index = torch.tensor([[0, 1, 1, 2], [1, 2, 0, 1]])
    attributes = torch.tensor([[1.0, 5.0], [2.0, 0.0], [4.0, 5.0], [-2.0, 1.0]])
    pairs, edges = undirected(edge_index, attributes, 3)
    assert pairs.tolist() == [[0, 1], [1, 2]]
    assert edges.tolist() == [[2.5, 5.0, 1.5, 0.0], [0.0, 0.5, 2.0, 0.5]]


def test_directions_find_each_other_in_any_order() -> None:
    edge_index = torch.cat([SQUARE, SQUARE.flip(0)], dim=1)
    attributes = torch.randn(10, 2, generator=torch.Generator().manual_seed(0))
    pairs, edges = undirected(edge_index, attributes, 4)
    want = {tuple(pair): row for pair, row in zip(pairs.t().tolist(), edges.tolist(), strict=True)}
    order = torch.randperm(10, generator=torch.Generator().manual_seed(1))
    pairs, edges = undirected(edge_index[:, order], attributes[order], 4)
    assert {tuple(pair): row for pair, row in zip(pairs.t().tolist(), edges.tolist(), strict=True)} == want
    assert len(want) == 5


@pytest.mark.parametrize(
    ("edges", "alone"),
    [
        ([[0, 1], [1, 0], [1, 2]], r"\(1, 2\)"),
        ([[0, 1], [1, 0], [2, 1]], r"\(2, 1\)"),
        ([[0, 1], [2, 1]], r"\(0, 1\)"),
        ([[0, 1], [1, 0], [2, 2]], r"\(2, 2\)"),
    ],
)
def test_an_edge_without_its_opposite_is_refused(edges: list[list[int]], alone: str) -> None:
    with pytest.raises(ValueError, match=f"every edge needs its opposite in edge_index; the edge {alone} has none"):
        undirected(torch.tensor(edges).t(), torch.zeros(len(edges), 1), 3)
    data = graph_of_pairs(torch.tensor([[0], [1]]), [1.0], nodes=3)
    data.edge_index, data.edge_attr = torch.tensor(edges).t(), torch.zeros(len(edges), 2)
    with pytest.raises(ValueError, match="needs its opposite"):
        model()(data)


def permuted(data: Data, node: Tensor, edge: Tensor) -> Data:
    """Return the graph with nodes and directed edges reordered; `node` is the new number of each node."""
    other = data.clone()
    other.x = torch.empty_like(data.x)
    other.x[node] = data.x
    other.edge_index, other.edge_attr = node[data.edge_index][:, edge], data.edge_attr[edge]
    other.edge_label_index = node[data.edge_label_index]
    return other


@pytest.mark.parametrize("edge_channels", [0, 2])
def test_the_order_of_nodes_and_edges_does_not_matter(edge_channels: int) -> None:
    data = grid_graph(4, 5, edge_channels=edge_channels)
    generator = torch.Generator().manual_seed(2)
    count = data.edge_index.size(1)
    other = permuted(data, torch.randperm(20, generator=generator), torch.randperm(count, generator=generator))
    built = model(edge_channels)
    with torch.no_grad():
        logits = built(data)
        torch.testing.assert_close(built(other), logits, rtol=1e-4, atol=1e-5)
    assert logits.std() > 1e-3


def test_exchanging_the_features_of_the_two_directions_does_not_matter() -> None:
    data, half = grid_graph(4, 5), grid_graph(4, 5).edge_label_index.size(1)
    other = data.clone()
    other.edge_attr = data.edge_attr.roll(half, dims=0)
    assert not torch.equal(other.edge_attr, data.edge_attr)
    built = model()
    with torch.no_grad():
        torch.testing.assert_close(built(other), built(data), rtol=1e-5, atol=1e-6)


def test_that_the_two_directions_differ_is_seen() -> None:
    data = path_graph([1, 0])
    other = data.clone()
    # The mean of both directions of the edge (0, 1) is the same, their difference is not.
    other.edge_attr[0] += 1.0
    other.edge_attr[2] -= 1.0
    built = model()
    with torch.no_grad():
        assert not torch.allclose(built(other), built(data))


@pytest.mark.parametrize("training", [False, True])
def test_nodes_without_edges(training: bool) -> None:
    data = graph_of_pairs(torch.empty(2, 0, dtype=torch.int64), [], nodes=3)
    assert model().train(training)(data).shape == (0,)


def test_a_single_edge_can_be_trained_on() -> None:
    trained = model().train()
    trained(path_graph([1.0])).sum().backward()
    for layer in trained.layers:
        assert layer.edge_norm.weight.grad.isfinite().all()
    # Without a variance of their own, its states are normalised as in evaluation.
    layer, states = trained.layers[0], torch.randn(2, 8)
    ends, edge = torch.tensor([[0], [1]]), torch.randn(1, 8)
    assert torch.equal(layer(states, edge, ends)[1], layer.eval()(states, edge, ends)[1])
