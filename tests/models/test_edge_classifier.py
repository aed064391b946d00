"""The common contract of all edge classifiers, and what user-defined classes inherit from the base class."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn
from torch_geometric.loader import DataLoader

from sgbd.models import EdgeClassifier, EdgeTransformer, GatedGCN, SharedMLP, SymmetricGCN
from tests.graph_samples import graph_of_pairs, grid_graph, path_graph

MODELS = [SharedMLP, GatedGCN, SymmetricGCN, EdgeTransformer]


class DirectedProduct(EdgeClassifier):
    """A user-defined model: it implements only `score`, which depends on the direction."""

    def __init__(self, node_channels: int, edge_channels: int = 0) -> None:
        super().__init__(node_channels, edge_channels)
        self.weight = nn.Parameter(torch.arange(1.0, 1 + 2 * node_channels + edge_channels))

    def score(self, source: Tensor, target: Tensor, edge: Tensor) -> Tensor:
        return torch.cat([source, target, edge], dim=1) @ self.weight


def build(model: type[EdgeClassifier], node_channels: int = 3, edge_channels: int = 2) -> EdgeClassifier:
    """Return a model with random weights and running moments, so that nothing is symmetric by accident."""
    torch.manual_seed(1)
    built = model(node_channels, edge_channels)
    for tensor in (*built.parameters(), *built.buffers()):
        if tensor.is_floating_point():
            tensor.data = torch.rand_like(tensor) + 0.1 if tensor.dim() == 1 else torch.randn_like(tensor) * 0.3
    return built


def test_user_model_scores_with_the_edge_features_of_the_direction_it_is_asked_in() -> None:
    data = path_graph([1, 0])
    data.edge_label_index = torch.tensor([[2, 0], [1, 1]])
    model = DirectedProduct(3, 2).train()
    # Directed edges in order: (0, 1), (1, 2), (1, 0), (2, 1).
    expected = torch.stack(
        [
            torch.cat([data.x[2], data.x[1], data.edge_attr[3]]) @ model.weight,
            torch.cat([data.x[0], data.x[1], data.edge_attr[0]]) @ model.weight,
        ]
    )
    torch.testing.assert_close(model(data), expected)


def test_evaluation_averages_the_two_directions() -> None:
    data = path_graph([1, 0])
    data.edge_label_index = torch.tensor([[2], [1]])
    model = DirectedProduct(3, 2).eval()
    forth = torch.cat([data.x[1], data.x[2], data.edge_attr[1]]) @ model.weight
    back = torch.cat([data.x[2], data.x[1], data.edge_attr[3]]) @ model.weight
    torch.testing.assert_close(model(data), ((forth + back) / 2)[None])
    assert not torch.isclose(forth, back)


@pytest.mark.parametrize("edge_channels", [0, 2])
@pytest.mark.parametrize("model", [*MODELS, DirectedProduct])
def test_evaluation_is_symmetric_to_the_last_bit(model: type[EdgeClassifier], edge_channels: int) -> None:
    data = grid_graph(9, 11, edge_channels=edge_channels)
    built = build(model, edge_channels=edge_channels)
    generator = torch.Generator().manual_seed(3)
    turned = data.clone()
    turn = torch.rand(data.edge_label_index.size(1), generator=generator) < 0.5
    turned.edge_label_index = torch.where(turn, data.edge_label_index.flip(0), data.edge_label_index)
    with torch.no_grad():
        assert torch.equal(built.eval()(data), built(turned))
        built.train()
        # In training, the direction matters, except for the model on undirected edges.
        assert torch.equal(built(data), built(turned)) == (model is SymmetricGCN)


@pytest.mark.parametrize("edge_channels", [0, 2])
@pytest.mark.parametrize("model", MODELS)
def test_a_subset_in_another_order_gets_the_same_logits(model: type[EdgeClassifier], edge_channels: int) -> None:
    data = grid_graph(5, 6, edge_channels=edge_channels)
    built = build(model, edge_channels=edge_channels).eval()
    chosen = torch.tensor([7, 3, 3, 40, 0])
    subset = data.clone()
    subset.edge_label_index = data.edge_label_index[:, chosen]
    with torch.no_grad():
        torch.testing.assert_close(built(subset), built(data)[chosen], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("edge_channels", [0, 2])
@pytest.mark.parametrize("model", MODELS)
def test_a_batch_gives_what_its_graphs_give_alone(model: type[EdgeClassifier], edge_channels: int) -> None:
    graphs = [grid_graph(3, 4, edge_channels=edge_channels, seed=seed) for seed in range(3)]
    batch = next(iter(DataLoader(graphs, batch_size=3)))
    built = build(model, edge_channels=edge_channels).eval()
    with torch.no_grad():
        torch.testing.assert_close(built(batch), torch.cat([built(graph) for graph in graphs]), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("model", MODELS)
def test_every_parameter_learns(model: type[EdgeClassifier]) -> None:
    data = grid_graph(5, 6)
    torch.manual_seed(0)
    built = model(3, 2).train()
    built(data).square().sum().backward()
    still = [name for name, value in built.named_parameters() if value.grad is None or not value.grad.any()]
    assert still == []


@pytest.mark.parametrize("model", [GatedGCN, SymmetricGCN, EdgeTransformer])
def test_message_passing_sees_edges_that_are_not_asked_for(model: type[EdgeClassifier]) -> None:
    data = path_graph([1, 0, 1])
    data.edge_label_index = torch.tensor([[0], [1]])
    built = build(model).eval()
    with torch.no_grad():
        before = built(data)
        data.x[3] += 10.0
        assert not torch.allclose(built(data), before)


def test_shared_mlp_sees_the_pair_only() -> None:
    data = path_graph([1, 0, 1])
    data.edge_label_index = torch.tensor([[0], [1]])
    built = build(SharedMLP).eval()
    with torch.no_grad():
        before = built(data)
        data.x[2:] += 10.0
        assert torch.equal(built(data), before)


@pytest.mark.parametrize("model", [GatedGCN, SymmetricGCN])
def test_gated_convolutions_read_the_edge_state_that_they_passed_on(model: type[EdgeClassifier]) -> None:
    data = path_graph([1, 0, 1])
    data.edge_label_index = torch.tensor([[0], [1]])
    built = build(model).eval()
    with torch.no_grad():
        before = built(data)
        data.edge_attr[2] += 5.0  # the directed edge (2, 3)
        assert not torch.allclose(built(data), before)


def test_features_are_standardised_by_the_moments_of_the_training_set() -> None:
    data = path_graph([1, 0, 1])
    model = DirectedProduct(3, 2).eval()
    model.standardize_nodes.fit([data.x])
    model.standardize_edges.fit([data.edge_attr[:2], data.edge_attr[2:]])
    scaled = data.clone()
    scaled.x = (data.x - data.x.mean(0)) / data.x.std(0, correction=0)
    scaled.edge_attr = (data.edge_attr - data.edge_attr.mean(0)) / data.edge_attr.std(0, correction=0)
    torch.testing.assert_close(model(data), DirectedProduct(3, 2).eval()(scaled))


@pytest.mark.parametrize("model", MODELS)
def test_a_graph_without_edges_gives_no_logits(model: type[EdgeClassifier]) -> None:
    data = graph_of_pairs(torch.empty(2, 0, dtype=torch.int64), [], nodes=1)
    assert build(model).eval()(data).shape == (0,)


@pytest.mark.parametrize("model", MODELS)
def test_features_of_another_width_are_refused(model: type[EdgeClassifier]) -> None:
    with pytest.raises(ValueError, match=r"built for 4 node feature columns; data.x has shape \(3, 3\)"):
        model(4, 2)(path_graph([1, 0]))
    with pytest.raises(ValueError, match=r"built for 1 edge feature columns; data.edge_attr has shape \(4, 2\)"):
        model(3, 1)(path_graph([1, 0]))
    without = path_graph([1, 0])
    without.edge_attr = None
    with pytest.raises(ValueError, match=r"data\.edge_attr has none"):
        model(3, 2)(without)


@pytest.mark.parametrize("model", MODELS)
def test_a_pair_that_is_no_edge_is_refused(model: type[EdgeClassifier]) -> None:
    data = path_graph([1, 0])
    data.edge_label_index = torch.tensor([[0], [2]])
    with pytest.raises(ValueError, match=r"pair \(0, 2\)"):
        model(3, 2).eval()(data)


@pytest.mark.parametrize("channels", [(0, 0), (-1, 3)])
def test_a_model_needs_features(channels: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="at least one feature column"):
        SharedMLP(*channels)


@pytest.mark.parametrize(
    ("model", "options"),
    [
        (SharedMLP, {"hidden_channels": []}),
        (GatedGCN, {"num_layers": 0}),
        (SymmetricGCN, {"hidden_channels": 0}),
        (SymmetricGCN, {"num_layers": 0}),
        (EdgeTransformer, {"hidden_channels": 30, "heads": 4}),
    ],
)
def test_impossible_sizes_are_refused(model: type[EdgeClassifier], options: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        model(3, 2, **options)
