"""The compiled messages and their gradient, compared with PyTorch operations."""

from __future__ import annotations

import copy

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from sgbd.machine.compiled import HAS_NUMBA
from sgbd.models import gated_gcn
from sgbd.models.gated_gcn import GatedConvolution
from sgbd.models.gated_messages import gated_messages, has_messages_compiled


def updated(
    convolution: GatedConvolution, nodes: Tensor, edges: Tensor, edge_index: Tensor, compiled: bool
) -> list[Tensor]:
    """Return the new states and the gradients of all inputs."""
    convolution = copy.deepcopy(convolution)
    nodes, edges = nodes.clone().requires_grad_(), edges.clone().requires_grad_()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gated_gcn, "has_messages_compiled", lambda *_: compiled)
        new_nodes, new_edges = convolution(nodes, edges, edge_index)
    (new_nodes.square().sum() + (new_edges * new_nodes.detach().sum()).square().sum()).backward()
    assert nodes.grad is not None
    assert edges.grad is not None
    gradients = [weight.grad for weight in convolution.parameters() if weight.grad is not None]
    assert len(gradients) == len(list(convolution.parameters()))
    return [new_nodes, new_edges, nodes.grad, edges.grad, *gradients]


@settings(max_examples=30, deadline=None)
@given(nodes=st.integers(2, 9), edges=st.integers(1, 30), channels=st.integers(1, 9), seed=st.integers(0, 999))
def test_states_and_gradients_are_those_of_the_operations(nodes: int, edges: int, channels: int, seed: int) -> None:
    torch.manual_seed(seed)
    convolution = GatedConvolution(channels)
    edge_index = torch.randint(0, nodes, (2, edges))
    if edges == 1:
        convolution.eval()  # a single row has no variance for normalisation
    given_states = (torch.randn(nodes, channels), torch.randn(edges, channels), edge_index)
    ours, theirs = (updated(convolution, *given_states, compiled) for compiled in (True, False))
    for mine, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(mine, other, rtol=1e-6, atol=1e-6)


def test_rows_in_any_memory_layout() -> None:
    torch.manual_seed(0)
    projected, terms, gradient = torch.randn(8, 3).t(), torch.randn(2, 5).t(), torch.ones(1).expand(5, 2)
    neighbor, center = torch.tensor([0, 1, 2, 0, 1]), torch.tensor([[1, 9], [0, 9], [0, 9], [2, 9], [1, 9]])[:, 0]
    results = []
    for change in (Tensor.contiguous, Tensor.clone):
        rows = change(projected).requires_grad_()
        logits, own, weighted, total = gated_messages(rows, change(terms), change(neighbor), change(center))
        torch.autograd.backward(
            [logits, own, weighted, total], [gradient, *(torch.ones(1).expand(3, 2) for _ in range(3))]
        )
        results.append([logits, own, weighted, total, rows.grad])
    for first, second in zip(*results, strict=True):
        assert torch.equal(first, second)


def test_by_hand() -> None:
    """One edge from node 1 to node 0, one channel: a gate of sigmoid(1 + 3 - 4) = 1/2 lets half of the 6 pass."""
    projected = torch.tensor([[1.0, 9.0, 2.0, 9.0], [9.0, 3.0, 5.0, 6.0]], requires_grad=True)
    terms = torch.tensor([[-4.0]], requires_grad=True)
    logits, own, weighted, total = gated_messages(projected, terms, torch.tensor([1]), torch.tensor([0]))
    assert logits.tolist() == [[0]]
    assert own.tolist() == [[2], [5]]
    assert weighted.tolist() == [[3], [0]]
    assert total.tolist() == [[0.5], [0]]
    (weighted.sum() + 2 * total.sum() + 3 * own.sum()).backward()
    assert projected.grad is not None
    assert terms.grad is not None
    # d weighted / d logit = 6 / 4, d total / d logit = 1 / 4, d weighted / d message = 1 / 2.
    assert projected.grad.tolist() == [[2, 0, 3, 0], [0, 2, 3, 0.5]]
    assert terms.grad.tolist() == [[2]]


def test_only_numbers_that_loops_can_reach() -> None:
    assert has_messages_compiled(torch.zeros(2, 4), torch.zeros(1, 1)) == HAS_NUMBA
    assert not has_messages_compiled(torch.zeros(2, 4), torch.zeros(1, 1, dtype=torch.bfloat16))
    assert not has_messages_compiled(torch.zeros(2, 4, dtype=torch.float64))
    assert not has_messages_compiled(torch.zeros(2, 4, device="meta"))
