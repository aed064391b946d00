"""The perceptron, held against PyG's, and its short ways in evaluation against the long one."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch_geometric.nn import MLP

from sgbd.models.perceptron import EVALUATED_AT_ONCE, Perceptron

FORMS: list[dict[str, Any]] = [
    {},
    {"norm": False},
    {"plain_last": False, "bias": False},
    {"plain_last": False, "norm": False},
    {"dropout": 0.5},
]


def pair(form: dict[str, Any]) -> tuple[Perceptron, MLP]:
    """The same weights and moments, all of them random, in ours and in PyG's."""
    torch.manual_seed(0)
    theirs = MLP(
        [8, 6, 5, 2],
        norm="batch_norm" if form.get("norm", True) else None,
        norm_kwargs={"allow_single_element": True} if form.get("norm", True) else None,
        **{key: value for key, value in form.items() if key != "norm"},
    )
    for tensor in (*theirs.parameters(), *theirs.buffers()):
        if tensor.is_floating_point():
            tensor.data = torch.rand_like(tensor) + 0.1 if tensor.dim() == 1 else torch.randn_like(tensor)
    ours = Perceptron([8, 6, 5, 2], **form)
    ours.load_state_dict(theirs.state_dict())
    return ours, theirs


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("rows", [0, 1, 2, 40])
@pytest.mark.parametrize("training", [True, False])
def test_results_are_those_of_pyg(form: dict[str, Any], rows: int, training: bool) -> None:
    if training and rows == 0 and form.get("norm", True):
        pytest.skip("there is nothing to normalise by in an empty batch")
    ours, theirs = (network.train(training) for network in pair(form))
    inputs = torch.randn(rows, 8)
    torch.manual_seed(1)
    expected = theirs(inputs)
    torch.manual_seed(1)
    torch.testing.assert_close(ours(inputs), expected)
    for name, value in theirs.state_dict().items():
        torch.testing.assert_close(ours.state_dict()[name], value)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("rows", [0, 1, EVALUATED_AT_ONCE + 3])
def test_the_short_ways_give_what_the_long_one_gives(form: dict[str, Any], rows: int) -> None:
    network = pair(form)[0].eval()
    nodes, edges, ends = torch.randn(7, 3), torch.randn(rows, 2), torch.randint(0, 7, (2, rows))
    whole = torch.cat([nodes[ends[0]], nodes[ends[1]], edges], dim=1)
    expected = network(whole)
    torch.testing.assert_close(network.evaluate(whole), expected, rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(network.evaluate_pairs(nodes, edges, ends), expected, rtol=1e-5, atol=1e-5)


def test_pairs_without_edge_features() -> None:
    network = Perceptron([6, 4, 1]).eval()
    nodes, ends = torch.randn(5, 3), torch.randint(0, 5, (2, 9))
    expected = network(torch.cat([nodes[ends[0]], nodes[ends[1]]], dim=1))
    torch.testing.assert_close(network.evaluate_pairs(nodes, nodes.new_empty(9, 0), ends), expected)
