"""The compiled passes of the gated graph convolution, compared with PyTorch operations."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch_geometric.data import Data

from sgbd.machine.compiled import HAS_NUMBA
from sgbd.models import GatedGCN, SymmetricGCN, gated_messages, in_evaluation
from tests.graph_samples import graph_of_pairs, grid_graph

pytestmark = pytest.mark.skipif(not HAS_NUMBA, reason="numba is not installed: there is no compiled pass to test")


Model = GatedGCN | SymmetricGCN
MODELS = [GatedGCN, SymmetricGCN]


def _random(model: Model) -> Model:
    torch.manual_seed(1)
    for tensor in (*model.parameters(), *model.buffers()):
        if tensor.is_floating_point():
            tensor.data = torch.rand_like(tensor) + 0.5 if tensor.dim() == 1 else torch.randn_like(tensor) / 3
    return model.eval()


def _both_ways(model: Model, data: Data, monkeypatch: pytest.MonkeyPatch) -> tuple[Tensor, Tensor]:
    with torch.no_grad():
        compiled = model(data)
        with monkeypatch.context() as patch:
            patch.setattr(in_evaluation, "HAS_NUMBA", False)
            patch.setattr(gated_messages, "HAS_NUMBA", False)
            plain = model(data)
    return compiled, plain


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("channels", [(3, 2), (3, 0), (0, 2)])
@pytest.mark.parametrize("hidden", [1, 8, 13])
def test_the_compiled_pass_gives_the_same_logits(
    kind: type[Model], channels: tuple[int, int], hidden: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = grid_graph(7, 9, *channels)
    # Edges in arbitrary order, as in a foreign graph, and a superpixel without neighbours.
    shuffled = torch.randperm(data.edge_index.size(1), generator=torch.Generator().manual_seed(0))
    data.edge_index, data.edge_attr = data.edge_index[:, shuffled], data.edge_attr[shuffled]
    data.x = torch.cat([data.x, data.x[:1]])
    model = _random(kind(*channels, hidden_channels=hidden, num_layers=3))
    before = {name: value.clone() for name, value in model.state_dict().items()}
    compiled, plain = _both_ways(model, data, monkeypatch)
    torch.testing.assert_close(compiled, plain, rtol=1e-5, atol=1e-5)
    # A single hidden unit may be inactive.
    assert hidden == 1 or len(plain.unique()) > 50, "the logits must tell pairs apart"
    for name, value in model.state_dict().items():
        assert torch.equal(value, before[name]), f"{name} must not change"


@pytest.mark.parametrize("kind", MODELS)
def test_gates_that_are_shut_or_open(kind: type[Model], monkeypatch: pytest.MonkeyPatch) -> None:
    data = grid_graph(4, 5)
    model = _random(kind(3, 2, hidden_channels=8))
    data.edge_attr = data.edge_attr * 1e3
    compiled, plain = _both_ways(model, data, monkeypatch)
    assert torch.isfinite(compiled).all()
    torch.testing.assert_close(compiled, plain, rtol=1e-5, atol=1e-2)


@pytest.mark.parametrize("kind", MODELS)
def test_a_graph_without_edges(kind: type[Model]) -> None:
    model = _random(kind(3, 2))
    with torch.no_grad():
        assert model(graph_of_pairs(torch.empty(2, 0, dtype=torch.int64), [], nodes=1)).shape == (0,)


@pytest.mark.parametrize("kind", MODELS)
def test_gradients_are_given_where_they_are_asked_for(kind: type[Model]) -> None:
    model = _random(kind(3, 2))
    model(grid_graph(3, 3)).sum().backward()
    assert all(parameter.grad is not None for parameter in model.parameters())
