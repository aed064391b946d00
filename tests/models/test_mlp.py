"""The shipped variants of the shared MLP."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf

from sgbd.models import EdgeClassifier, SharedMLP
from tests.graph_samples import grid_graph, path_graph

CONF = Path(__file__).parents[2] / "conf" / "model"


def shipped(name: str, node_channels: int, edge_channels: int) -> EdgeClassifier:
    return instantiate(OmegaConf.load(CONF / f"{name}.yaml"), node_channels=node_channels, edge_channels=edge_channels)


def parameters(model: torch.nn.Module) -> int:
    return sum(value.numel() for value in model.parameters())


def test_reference_has_the_papers_number_of_parameters() -> None:
    assert parameters(shipped("mlp_reference", 15, 0)) == 103_682


def test_reference_logits_are_never_negative() -> None:
    model = shipped("mlp_reference", 3, 2).train()
    logits = model(grid_graph(8, 8))
    assert (logits >= 0).all()
    assert (logits > 0).any()


def test_default_logits_have_either_sign() -> None:
    torch.manual_seed(0)
    logits = shipped("mlp", 3, 2).train()(grid_graph(8, 8))
    assert (logits > 0).any()
    assert (logits < 0).any()


@pytest.mark.parametrize(
    ("name", "hidden"),
    [("mlp", (128, 256, 256)), ("mlp_reference", (128, 256, 256)), ("mlp_paper_text", (256, 1024, 256))],
)
def test_widths(name: str, hidden: tuple[int, ...]) -> None:
    model = shipped(name, 15, 4)
    assert [layer.in_features for layer in model.mlp.lins] == [34, *hidden]
    assert [layer.out_features for layer in model.mlp.lins] == [*hidden, 1]


@pytest.mark.parametrize("name", ["mlp", "mlp_reference", "mlp_paper_text"])
@pytest.mark.parametrize("pairs", [0, 1, 700])
def test_evaluation_gives_what_the_layers_give_one_by_one(name: str, pairs: int) -> None:
    torch.manual_seed(0)
    model = shipped(name, 3, 2)
    for norm in model.mlp.norms:
        # Use moments as after training: those of a new layer have no effect.
        torch.nn.init.normal_(norm.module.running_mean)
        torch.nn.init.uniform_(norm.module.running_var, 0.5, 2.0)
        torch.nn.init.normal_(norm.module.weight)
        torch.nn.init.normal_(norm.module.bias)
    model.eval()
    source, target, edge = torch.randn(pairs, 3), torch.randn(pairs, 3), torch.randn(pairs, 2)
    expected = model.mlp(torch.cat([source, target, edge], dim=1)).squeeze(1)
    torch.testing.assert_close(model.score(source, target, edge), expected, rtol=1e-4, atol=1e-4)
    assert expected.shape == (pairs,)


@pytest.mark.parametrize("name", ["gated_gcn", "attention"])
def test_message_passing_models_are_as_large_as_the_mlp(name: str) -> None:
    assert 90_000 < parameters(shipped(name, 18, 11)) < 110_000


def test_a_single_pair_can_be_trained_on() -> None:
    data = path_graph([1.0])
    logits = SharedMLP(3, 2).train()(data)
    assert logits.shape == (1,)
    assert torch.isfinite(logits).all()
