"""The exact rules of the sampler, on a grid of graphs and settings."""

from __future__ import annotations

from collections import Counter

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch_geometric.data import Data
from torch_geometric.loader import DataLoader

from sgbd.sampling import AllEdges, BalancedEdgeSampler
from tests.graph_samples import graph_of_pairs, path_graph


def batch_of(graphs: list[list[float]]) -> Data:
    return next(iter(DataLoader([path_graph(labels) for labels in graphs], batch_size=len(graphs))))


def drawn(batch: Data, sampled: Data) -> list[list[tuple[int, float, bool]]]:
    """Return the drawn pairs of each graph: first node in the graph, label, whether the ends were swapped."""
    result: list[list[tuple[int, float, bool]]] = [[] for _ in range(batch.ptr.numel() - 1)]
    for (i, j), label in zip(sampled.edge_label_index.t().tolist(), sampled.edge_label.tolist(), strict=True):
        assert abs(i - j) == 1
        graph = int(torch.searchsorted(batch.ptr, min(i, j), right=True)) - 1
        result[graph].append((min(i, j) - int(batch.ptr[graph]), label, i > j))
    return result


labels = st.lists(st.lists(st.sampled_from([1.0, 0.0, -1.0]), max_size=30), min_size=1, max_size=5)


@settings(max_examples=150, deadline=None)
@given(
    graphs=labels,
    pairs=st.integers(1, 20),
    share=st.sampled_from([None, 0.0, 0.1, 0.25, 0.5, 0.9, 1.0]),
    seed=st.integers(0, 9),
)
def test_rules(graphs: list[list[float]], pairs: int, share: float | None, seed: int) -> None:
    batch = batch_of(graphs)
    sampled = BalancedEdgeSampler(pairs, share)(batch, torch.Generator().manual_seed(seed))
    for truth, got in zip(graphs, drawn(batch, sampled), strict=True):
        size = {value: truth.count(value) for value in (0.0, 1.0)}
        if not any(size.values()):
            assert got == []
            continue
        assert len(got) == pairs
        assert all(truth[pair] == label != -1 for pair, label, _ in got)
        assert sum(swapped for *_, swapped in got) == pairs // 2
        times = Counter(pair for pair, *_ in got)
        if share is None:
            assert sum(size.values()) < pairs or max(times.values()) == 1
            continue
        positive = int(share * pairs + 0.5)
        if not size[0.0]:
            positive = pairs
        if not size[1.0]:
            positive = 0
        wanted = {1.0: positive, 0.0: pairs - positive}
        for value in (0.0, 1.0):
            assert sum(label == value for _, label, _ in got) == wanted[value]
            of_class = [count for pair, count in times.items() if truth[pair] == value]
            assert size[value] < wanted[value] or max(of_class, default=1) == 1


def test_the_papers_share_of_128() -> None:
    batch = batch_of([[1.0] * 400 + [0.0] * 100] * 4)
    sampled = BalancedEdgeSampler(128, 0.25)(batch, torch.Generator().manual_seed(0))
    for got in drawn(batch, sampled):
        assert Counter(label for _, label, _ in got) == {1.0: 32, 0.0: 96}
        assert len({pair for pair, *_ in got}) == 128


@pytest.mark.parametrize(("share", "value"), [(0.5, 1.0), (0.5, 0.0), (None, 0.0)])
def test_every_pair_is_as_likely_as_the_others(share: float | None, value: float) -> None:
    """Drawing is uniform without replacement (4 of 8 pairs) and with replacement (4 of 2 pairs)."""
    batch = batch_of([[value] * 8, [value, value]])
    sampler, generator = BalancedEdgeSampler(4, share), torch.Generator().manual_seed(0)
    counts = [Counter(), Counter()]
    swaps: Counter[int] = Counter()
    for _ in range(2000):
        for count, got in zip(counts, drawn(batch, sampler(batch, generator)), strict=True):
            count.update(pair for pair, *_ in got)
            swaps.update(pair for pair, _, swapped in got if swapped)
    # Standard deviations: 22 of 1000, and 45 of 4000.
    assert all(abs(counts[0][pair] - 1000) < 120 for pair in range(8))
    assert all(abs(counts[1][pair] - 4000) < 230 for pair in range(2))
    assert all(abs(swaps[pair] - 500) < 120 for pair in range(2, 8))


def test_the_generator_alone_decides() -> None:
    batch = batch_of([[1.0, 0.0] * 50] * 3)
    sampler = BalancedEdgeSampler(16)
    torch.manual_seed(0)
    first = sampler(batch, torch.Generator().manual_seed(5))
    torch.manual_seed(1)
    again = sampler(batch, torch.Generator().manual_seed(5))
    other = sampler(batch, torch.Generator().manual_seed(6))
    assert torch.equal(first.edge_label_index, again.edge_label_index)
    assert not torch.equal(first.edge_label_index, other.edge_label_index)


def test_the_graph_stays_whole_and_the_batch_unchanged() -> None:
    batch = batch_of([[1.0, 0.0, -1.0]] * 2)
    before = batch.clone()
    sampled = BalancedEdgeSampler(4)(batch, torch.Generator())
    for field in before.keys():  # noqa: SIM118 (Data is no mapping)
        assert batch[field] is not None
        if torch.is_tensor(before[field]):
            assert torch.equal(batch[field], before[field])
    assert torch.equal(sampled.edge_index, before.edge_index)
    assert torch.equal(sampled.edge_attr, before.edge_attr)
    assert sampled.edge_label.dtype == torch.float32


def test_a_single_graph_needs_no_batch_vector() -> None:
    data = path_graph([1.0, 0.0, 1.0])
    sampled = BalancedEdgeSampler(10, 0.5)(data, torch.Generator())
    assert sampled.edge_label.tolist().count(1.0) == 5


def test_all_edges_takes_each_labelled_pair_once() -> None:
    batch = batch_of([[1.0, -1.0, 0.0, 1.0, 0.0], [-1.0], [0.0]])
    got = drawn(batch, AllEdges()(batch, torch.Generator().manual_seed(0)))
    assert [sorted((pair, label) for pair, label, _ in graph) for graph in got] == [
        [(0, 1.0), (2, 0.0), (3, 1.0), (4, 0.0)],
        [],
        [(0, 0.0)],
    ]
    assert [sum(swapped for *_, swapped in graph) for graph in got] == [2, 0, 0]


@pytest.mark.parametrize("exponent", [0.5, 1.0])
def test_weights_are_the_powers_of_the_drawn_pairs_borders(exponent: float) -> None:
    graphs = [path_graph([1.0, -1.0, 0.0]), path_graph([0.0, 1.0])]
    graphs[0].border_length, graphs[1].border_length = torch.tensor([9.0, 100.0, 0.0]), torch.tensor([4.0, 25.0])
    batch = next(iter(DataLoader(graphs, batch_size=2)))
    sampled = AllEdges(exponent)(batch, torch.Generator().manual_seed(0))
    # Nodes of the second graph start at 4; the pair (2, 3) does not touch and counts like one pixel.
    borders = {(0, 1): 9.0, (2, 3): 1.0, (4, 5): 4.0, (5, 6): 25.0}
    ends = [(min(pair), max(pair)) for pair in sampled.edge_label_index.t().tolist()]
    assert sorted(ends) == sorted(borders)
    want = torch.tensor([borders[pair] ** exponent for pair in ends])
    torch.testing.assert_close(sampled.edge_label_weight, want)
    assert "edge_label_weight" not in AllEdges()(batch, torch.Generator())


@pytest.mark.parametrize("exponent", [-1.0, float("nan"), float("inf")])
def test_impossible_exponents_are_refused(exponent: float) -> None:
    with pytest.raises(ValueError, match=f"border_exponent must be a finite number of at least 0; got {exponent}"):
        AllEdges(exponent)


@pytest.mark.parametrize("sampler", [BalancedEdgeSampler(), AllEdges()])
def test_graphs_without_labels_are_refused(sampler: BalancedEdgeSampler | AllEdges) -> None:
    data = graph_of_pairs(torch.tensor([[0], [1]]), [1.0], nodes=2)
    del data.edge_label
    with pytest.raises(ValueError, match="no edge_label"):
        sampler(data, torch.Generator())


@pytest.mark.parametrize("pairs", [0, -3, 2.5, True, "128"])
def test_impossible_numbers_of_pairs_are_refused(pairs: object) -> None:
    with pytest.raises(ValueError, match="pairs_per_graph"):
        BalancedEdgeSampler(pairs)  # type: ignore[arg-type]


@pytest.mark.parametrize("share", [-0.1, 1.5, float("nan"), "0.25"])
def test_impossible_shares_are_refused(share: object) -> None:
    with pytest.raises(ValueError, match="positive_share"):
        BalancedEdgeSampler(16, share)  # type: ignore[arg-type]
