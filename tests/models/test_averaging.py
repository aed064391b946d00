"""Several networks as one that gives the mean of their logits."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.models import GatedGCN, ObjectnessHead, SharedMLP
from sgbd.models.averaging import average_heads, average_models
from tests.graph_samples import grid_graph


def unlike(network, seed: int):
    """Draw every parameter and moment of a network anew, but its standardisation."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for name, value in network.state_dict().items():
            if value.is_floating_point() and not name.startswith("standardize"):
                value.copy_(torch.randn(value.shape, generator=generator) / 2)
                if name.endswith("running_var"):
                    value.copy_(value.abs() + 0.5)
    return network.eval()


@settings(max_examples=20, deadline=None)
@given(st.integers(1, 4), st.integers(1, 9), st.integers(1, 3), st.sampled_from([0, 4]))
def test_logits_are_the_mean_of_the_members(count: int, channels: int, layers: int, edge_channels: int) -> None:
    graph = grid_graph(4, 5, edge_channels=edge_channels)
    models = [unlike(GatedGCN(3, edge_channels, channels, layers), seed) for seed in range(count)]
    wide = average_models(models)
    assert wide.hidden_channels == count * channels
    for context in (torch.no_grad(), torch.inference_mode(), torch.enable_grad()):  # compiled passes, then operations
        with context:
            expected = torch.stack([model(graph) for model in models]).mean(0)
            torch.testing.assert_close(wide(graph), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("hidden", [(4,), (8, 3), (5, 4, 3)])
def test_object_logits_are_the_mean_of_the_members(hidden: tuple[int, ...]) -> None:
    graph = grid_graph(4, 5)
    heads = [unlike(ObjectnessHead(3, hidden), seed) for seed in range(3)]
    wide = average_heads(heads)
    assert [layer.out_features for layer in wide.mlp.lins] == [*(3 * width for width in hidden), 1]
    with torch.no_grad():
        expected = torch.stack([head(graph) for head in heads]).mean(0)
        torch.testing.assert_close(wide(graph), expected, rtol=1e-4, atol=1e-4)


def test_a_weight_stands_in_the_block_of_its_member() -> None:
    one, two = (unlike(GatedGCN(3, 4, 2, 1), seed) for seed in (0, 1))
    weight = average_models([one, two]).layers[0].node_linear.weight
    assert weight.shape == (16, 4)
    # Rows: A of both members, then B, U and V; columns: the states of both members.
    assert torch.equal(weight[0:2, :2], one.layers[0].node_linear.weight[0:2])
    assert torch.equal(weight[2:4, 2:], two.layers[0].node_linear.weight[0:2])
    assert torch.equal(weight[12:14, :2], one.layers[0].node_linear.weight[6:8])
    assert torch.count_nonzero(weight[0:2, 2:]) == torch.count_nonzero(weight[2:4, :2]) == 0


def test_networks_that_differ_are_refused() -> None:
    with pytest.raises(ValueError, match="only GatedGCN can be averaged; got .*SharedMLP"):
        average_models([GatedGCN(3, 4), SharedMLP(3, 4)])
    with pytest.raises(ValueError, match="only GatedGCN"):
        average_models([])
    with pytest.raises(ValueError, match="the same layers and the same features"):
        average_models([GatedGCN(3, 4, 8), GatedGCN(3, 4, 6)])
    with pytest.raises(ValueError, match="the same layers and the same features"):
        average_heads([ObjectnessHead(3, (4,)), ObjectnessHead(4, (4,))])
    elsewhere = GatedGCN(3, 4)
    elsewhere.standardize_nodes.mean += 1
    with pytest.raises(ValueError, match="trained on the same graphs"):
        average_models([GatedGCN(3, 4), elsewhere])
