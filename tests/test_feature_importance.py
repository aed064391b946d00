from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from torch_geometric.data import Data

from sgbd.adjacency import LabelMap
from sgbd.feature_importance import PairTable, forest_importance, importance_figure, pair_table, summarize
from sgbd.frame import Frame
from sgbd.graph import GraphBuilder
from sgbd.jobs.configuration import ConfigurationError
from tests.graph_samples import grid_graph, path_graph
from tests.test_commands import Command, command, frames  # noqa: F401

pytest.importorskip("sklearn", reason="the extra sgbd[analysis] is not installed")


class WithOwnColumns(GraphBuilder):
    """Appends a constant to the node features, and the label to the edge features."""

    node_columns = ("constant",)
    edge_columns = ("label",)

    def __call__(
        self, frame: Frame, label_map: LabelMap, category_names: Sequence[str] = (), *, store_maps: bool = True
    ) -> Data:
        data = super().__call__(frame, label_map, category_names, store_maps=store_maps)
        data.x = torch.cat([data.x, torch.ones(data.x.size(0), 1)], dim=1)
        data.edge_attr = torch.cat([data.edge_attr, data.edge_label.repeat(2)[:, None]], dim=1)
        return data


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def table_of(values: np.ndarray, merge: np.ndarray) -> PairTable:
    """Two node features (a, b) and an edge feature (c)."""
    return PairTable(values.astype(np.float32), merge, {"a": [0, 2], "b": [1, 3], "c": [4]})


def test_a_row_holds_both_ends_and_the_edge_of_its_direction() -> None:
    graphs = [path_graph([1, 0, 1, 0, 1, 1, 0, 0], seed=seed) for seed in range(4)]
    table = pair_table(graphs, 16, 0.5, generator(), ["a", "b", "c"], ["d", "e"])
    assert table.x.shape == (16, 3 + 3 + 2)
    assert table.merge.sum() == 8
    assert table.columns == {"a": [0, 3], "b": [1, 4], "c": [2, 5], "d": [6], "e": [7]}
    known = {}
    for graph in graphs:
        for place, (i, j) in enumerate(graph.edge_index.t().tolist()):
            row = torch.cat([graph.x[i], graph.x[j], graph.edge_attr[place]])
            known[tuple(row.tolist())] = graph.edge_label[place % graph.edge_label.numel()].item()
    for row, merge in zip(table.x, table.merge, strict=True):
        assert known[tuple(row.tolist())] == float(merge)


def test_unknown_pairs_are_not_drawn() -> None:
    table = pair_table([path_graph([1, -1, 0, -1, 1, 0, -1, 1])], 4, 0.5, generator(), ["a", "b", "c"], [])
    assert table.x.shape == (4, 6)
    assert table.merge.sum() == 2


def test_pairs_of_one_kind_teach_nothing() -> None:
    with pytest.raises(ConfigurationError, match="got 4 merges and 0 cuts"):
        pair_table([path_graph([1, 1, 1, 1])], 4, 0.5, generator(), ["a", "b", "c"], [])


def test_what_decides_is_found_and_what_does_not_is_near_nothing() -> None:
    rng = np.random.default_rng(0)

    def draw() -> PairTable:
        values = rng.normal(size=(300, 5))
        return table_of(values, values[:, 0] * values[:, 2] > 0)  # feature a alone, through both ends

    importance, accuracy = forest_importance(draw(), draw(), trees=50, seed=0, shuffles=3)
    assert accuracy > 0.8
    assert importance["impurity"].sum() == pytest.approx(1)
    assert importance["permutation"].idxmax() == importance["impurity"].idxmax() == "a"
    assert importance.loc["a", "permutation"] > 0.25
    assert importance.loc[["b", "c"], "permutation"].abs().max() < 0.1


def test_the_seed_fixes_everything() -> None:
    graphs = [grid_graph(6, 6, seed=seed) for seed in range(6)]

    def run() -> pd.DataFrame:
        draw = generator()
        train, held_out = (pair_table(graphs, 24, 0.5, draw, ["a", "b", "c"], ["d", "e"]) for _ in range(2))
        return forest_importance(train, held_out, trees=5, seed=3)[0]

    pd.testing.assert_frame_equal(run(), run())


def test_runs_are_averaged_and_drawn() -> None:
    runs = [pd.DataFrame({"impurity": [0.2, 0.8], "permutation": [0.0, low]}, index=["a", "b"]) for low in (0.1, 0.3)]
    summary = summarize(runs)
    assert summary.index.tolist() == ["b", "a"]
    assert summary.loc["b"].tolist() == pytest.approx([0.8, 0.2, 0.0, 0.02**0.5])
    figure = importance_figure(summary)
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["b", "a"]
    assert [bar.get_width() for bar in figure.axes[1].patches] == pytest.approx([0.2, 0.0])


def test_the_command_with_a_single_forest_and_with_frames_without_truth(
    command: Command,  # noqa: F811
    frames: Path,  # noqa: F811
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    here = (
        "dataset=folder", f"dataset.root={frames}", "superpixels.n_segments=12", "features=paper", "workers=0",
        "pairs=16", "runs=1", "trees=5", "hydra.run.dir=out",
    )  # fmt: skip
    assert command("feature_importance", *here) == 0
    text = (tmp_path / "out" / "feature_importance.md").read_text()
    assert text.startswith("A forest of 5 trees on 16 pairs of other superpixels of the training frames;")
    assert "deviation" not in text
    assert "nan" not in text
    assert text.splitlines()[2].split() == ["|", "feature", "|", "impurity", "|", "permutation", "|"]
    (frames / "test" / "scene6_labels.png").unlink()
    assert command("feature_importance", *here, "on_error=fail") == 1
    assert "1 of 2 frames of test have no ground truth: scene6" in capsys.readouterr().err


def test_columns_of_a_users_graph_builder_have_their_own_names(
    command: Command,  # noqa: F811
    frames: Path,  # noqa: F811
    tmp_path: Path,
) -> None:
    here = ("dataset=folder", f"dataset.root={frames}", "superpixels.n_segments=12", "workers=0", "hydra.run.dir=out")
    own = (f"graph._target_={__name__}.WithOwnColumns", "features.node=[shape]", "features.edge=[]")
    assert command("feature_importance", *here, *own, "pairs=16", "runs=1", "trees=100") == 0
    table = pd.read_csv(tmp_path / "out" / "feature_importance.csv", index_col=0)
    assert sorted(table.index) == ["constant", "label", "log_area", "missing_depth", "roughness"]
    assert table["impurity"].sum() == pytest.approx(1)
    assert table["impurity"].idxmax() == "label"
    assert table.loc["constant", "impurity"] == 0
