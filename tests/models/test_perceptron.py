"""The perceptron compared with PyG's, and its evaluation shortcuts compared with the full computation."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch_geometric.nn import MLP

from sgbd.machine.torch_threads import torch_threads
from sgbd.models import perceptron
from sgbd.models.linear_layer import ROW_STEP
from sgbd.models.perceptron import ROWS_AT_ONCE, TOO_FEW_TO_SHARE, Perceptron, equal_blocks

FORMS: list[dict[str, Any]] = [
    {},
    {"norm": False},
    {"plain_last": False, "bias": False},
    {"plain_last": False, "norm": False},
    {"dropout": 0.5},
]


def pair(form: dict[str, Any]) -> tuple[Perceptron, MLP]:
    """Return our perceptron and PyG's with the same random weights and moments."""
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
@pytest.mark.parametrize("rows", [0, 1, ROW_STEP + 1, 2 * ROWS_AT_ONCE + 3])
@pytest.mark.parametrize("gradients", [True, False])
def test_the_short_ways_give_what_the_long_one_gives(form: dict[str, Any], rows: int, gradients: bool) -> None:
    network = pair(form)[0].eval()
    nodes, edges, ends = torch.randn(7, 3), torch.randn(rows, 2), torch.randint(0, 7, (2, rows))
    whole = torch.cat([nodes[ends[0]], nodes[ends[1]], edges], dim=1)
    with torch.set_grad_enabled(gradients):
        expected = network(whole)
        torch.testing.assert_close(network.evaluate(whole), expected, rtol=1e-5, atol=1e-5)
        torch.testing.assert_close(network.evaluate_pairs(nodes, edges, ends), expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("channels", [[6, 1], [6, 4, 1]])
def test_pairs_without_edge_features(channels: list[int]) -> None:
    network = Perceptron(channels).eval()
    nodes, ends = torch.randn(5, 3), torch.randint(0, 5, (2, 9))
    expected = network(torch.cat([nodes[ends[0]], nodes[ends[1]]], dim=1))
    torch.testing.assert_close(network.evaluate_pairs(nodes, nodes.new_empty(9, 0), ends), expected)


def test_gradients_reach_the_inputs_of_the_short_way() -> None:
    network = pair({})[0].eval()
    nodes, edges = torch.randn(7, 3, requires_grad=True), torch.randn(200, 2)
    ends = torch.randint(0, 7, (2, 200))
    (expected,) = torch.autograd.grad(network(torch.cat([nodes[ends[0]], nodes[ends[1]], edges], dim=1)).sum(), nodes)
    (found,) = torch.autograd.grad(network.evaluate_pairs(nodes, edges, ends).sum(), nodes)
    torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)


def test_the_number_of_threads_changes_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    network = Perceptron([6, 32, 16, 1]).eval()
    nodes, ends = torch.randn(50, 3), torch.randint(0, 50, (2, 5 * ROWS_AT_ONCE))
    results = []
    for threads in (1, 2, 3):
        monkeypatch.setattr(perceptron, "thread_count", lambda threads=threads: threads)
        with torch_threads(1), torch.inference_mode():
            results.append(network.evaluate_pairs(nodes, nodes.new_empty(ends.size(1), 0), ends))
    assert torch.equal(results[0], results[1])
    assert torch.equal(results[0], results[2])


@torch.inference_mode()
def test_results_outlast_the_next_call() -> None:
    network = pair({})[0].eval()
    rows, others = torch.randn(40, 8), torch.randn(40, 8)
    first = network.evaluate(rows)
    kept = first.clone()
    network.evaluate(others)
    assert torch.equal(first, kept)


@given(st.integers(0, 20_000))
def test_blocks_are_about_equal_and_together_contain_every_row_once(rows: int) -> None:
    blocks = equal_blocks(rows)
    assert [row for block, known in blocks for row in range(block.start + known, block.stop)] == list(range(rows))
    assert all(block.start >= 0 for block, _ in blocks)
    sizes = [block.stop - block.start for block, _ in blocks]
    assert max(sizes) <= ROWS_AT_ONCE
    assert max(sizes) - min(sizes) <= ROW_STEP
    if rows > 2 * ROW_STEP:
        assert {size % ROW_STEP for size in sizes} == {0}
    assert len(blocks) % 2 == 0 or rows <= TOO_FEW_TO_SHARE


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (0, [(slice(0, 0), 0)]),
        (128, [(slice(0, 128), 0)]),
        (129, [(slice(0, 64), 0), (slice(64, 129), 0)]),
        (512, [(slice(0, 256), 0), (slice(256, 512), 0)]),
        (1000, [(slice(0, 512), 0), (slice(488, 1000), 24)]),
        (1300, [(slice(0, 256), 0), (slice(256, 768), 0), (slice(768, 1024), 0), (slice(788, 1300), 236)]),
    ],
)
def test_the_last_block_may_begin_with_rows_of_the_one_before(rows: int, expected: list[tuple[slice, int]]) -> None:
    assert equal_blocks(rows) == expected
