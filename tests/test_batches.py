"""Batches have the same content as PyG's, in an order that depends only on seed and epoch."""

from __future__ import annotations

from itertools import chain

import pytest
import torch
from torch_geometric.data import Batch, Data

from sgbd.batches import FIELDS, EpochBatches, SupervisedGraphs, batches_in_order, collate
from tests.graph_samples import graph_of_pairs, grid_graph, path_graph


def numbered(count: int) -> list[Data]:
    graphs = [path_graph([1.0], seed=seed) for seed in range(count)]
    for number, graph in enumerate(graphs):
        graph.x[:] = number
    return graphs


def numbers(batches: EpochBatches, epoch: int) -> list[list[int]]:
    return [batch.x[batch.ptr[:-1], 0].int().tolist() for batch in batches.epoch(epoch)]


def test_same_numbers_as_pyg() -> None:
    empty = graph_of_pairs(torch.empty(2, 0, dtype=torch.int64), [], nodes=2)
    graphs = [grid_graph(3, 4, seed=1), empty, grid_graph(2, 5, seed=2)]
    ours = collate([SupervisedGraphs(graphs)[index] for index in range(3)])
    theirs = Batch.from_data_list(graphs)
    for field in (*FIELDS, "batch", "ptr"):
        assert torch.equal(ours[field], theirs[field]), field
    assert set(ours.keys()) == {*FIELDS, "batch", "ptr"}


def test_a_field_that_is_missing_stays_missing() -> None:
    graph = path_graph([1.0])
    del graph.node_instance
    assert "node_instance" not in collate([SupervisedGraphs([graph])[0]] * 2)


def test_every_usable_graph_once_an_epoch_in_a_new_order() -> None:
    batches = EpochBatches(numbered(11), torch.tensor([0, 1, 2, 3, 5, 7, 8, 9, 10]), batch_size=4, seed=0)
    assert len(batches) == 3
    first, second = numbers(batches, 1), numbers(batches, 2)
    assert [len(batch) for batch in first] == [4, 4, 1]
    assert sorted(chain(*first)) == sorted(chain(*second)) == [0, 1, 2, 3, 5, 7, 8, 9, 10]
    assert first != second
    assert numbers(batches, 1) == first


def test_seeds_one_apart_do_not_share_their_orders() -> None:
    orders = [
        numbers(EpochBatches(numbered(20), torch.arange(20), 4, seed), epoch) for seed in range(3) for epoch in range(3)
    ]
    assert len({str(order) for order in orders}) == 9


@pytest.mark.parametrize("count", [8, 7])
def test_processes_share_the_graphs(count: int) -> None:
    shares = [
        numbers(EpochBatches(numbered(count), torch.arange(count), 2, 0, rank=rank, world_size=2), 1) for rank in (0, 1)
    ]
    flat = [list(chain(*share)) for share in shares]
    assert len(flat[0]) == len(flat[1]) == 4
    assert set(flat[0]) | set(flat[1]) == set(range(count))
    assert len(set(flat[0]) & set(flat[1])) == 8 - count


def test_reading_ahead_changes_nothing() -> None:
    graphs = [grid_graph(3, 3, seed=seed) for seed in range(6)]
    alone, ahead = (EpochBatches(graphs, torch.arange(6), 2, 0, num_workers=workers) for workers in (0, 2))
    for epoch in (1, 2):
        for ours, theirs in zip(alone.epoch(epoch), ahead.epoch(epoch), strict=True):
            assert all(torch.equal(ours[field], theirs[field]) for field in ours.keys())  # noqa: SIM118


def test_no_random_numbers_are_taken_from_the_global_generator() -> None:
    torch.manual_seed(0)
    before = torch.get_rng_state()
    batches = EpochBatches(numbered(5), torch.arange(5), 2, 0)
    list(batches.epoch(1))
    list(batches_in_order(numbered(5), 2))
    assert torch.equal(torch.get_rng_state(), before)
