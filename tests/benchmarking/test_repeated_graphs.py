from __future__ import annotations

from pathlib import Path

import torch

from sgbd.benchmarking.repeated_graphs import repeat_graphs
from sgbd.data import SuperpixelGraphDataset
from sgbd.graph import GraphBuilder
from sgbd.preparation import prepare
from sgbd.superpixels import Slic
from tests.scenes import Scenes


def test_every_graph_comes_by_turns_under_a_name_of_its_own(tmp_path: Path) -> None:
    cache = prepare(Scenes("test"), Slic(12, min_size=4), GraphBuilder(), tmp_path / "few", progress=False)
    few = SuperpixelGraphDataset(cache, "test")
    many = SuperpixelGraphDataset(repeat_graphs(cache, "test", 8, tmp_path / "many"), "test", in_memory=True)
    assert len(many) == many.statistics()["graphs"] == len(set(many.names)) == 8
    for number, graph in enumerate(many):
        assert torch.equal(graph.x, few[number % 3].x)
        assert graph.x.data_ptr() != many[(number + 3) % 8].x.data_ptr()
    assert len(many.labeled()) == 8
