from pathlib import Path

import numpy as np
import pytest
import torch
from torch_geometric.data import Data

from sgbd.calibration import SEGMENT_FEATURES, ScoreCalibration
from sgbd.data import SuperpixelGraphDataset
from sgbd.evaluation import EvaluationError, Evaluator, score_table
from sgbd.graph import GraphBuilder
from sgbd.partition import ConnectedComponents
from sgbd.preparation import prepare
from sgbd.superpixels import Slic
from tests.scenes import Scenes


class Truth(torch.nn.Module):
    """An oracle edge model that uses the ground truth."""

    def forward(self, data: Data) -> torch.Tensor:
        return (data.edge_label * 2 - 1) * 10


class TrueObjects(torch.nn.Module):
    """An oracle objectness head that uses the ground truth."""

    def forward(self, data: Data) -> torch.Tensor:
        return torch.where(data.node_instance >= 2, 10.0, -10.0)


class NothingIsAnObject(torch.nn.Module):
    """An objectness head that is always wrong about objects."""

    def forward(self, data: Data) -> torch.Tensor:
        return torch.full((data.x.size(0),), -10.0)


class Merge(torch.nn.Module):
    """An edge model that merges everything."""

    def forward(self, data: Data) -> torch.Tensor:
        return torch.full_like(data.edge_label, 10.0)


@pytest.fixture(scope="module")
def graphs(tmp_path_factory: pytest.TempPathFactory) -> SuperpixelGraphDataset:
    folder = prepare(Scenes("test"), Slic(40, min_size=4), GraphBuilder(), tmp_path_factory.mktemp("graphs"), workers=0)
    return SuperpixelGraphDataset(folder, "test")


def test_perfect_edges_reach_the_oracle(graphs: SuperpixelGraphDataset) -> None:
    evaluation = Evaluator(ConnectedComponents())(graphs, Truth(), TrueObjects())
    scores = evaluation.scores
    for name in ("overlap_precision", "overlap_recall", "overlap_f", "f75", "boundary_f"):
        assert scores[f"all/{name}"] == pytest.approx(scores[f"oracle/{name}"])
        assert scores[f"unaided/{name}"] == pytest.approx(scores[f"oracle/{name}"])
    assert scores["all/overlap_f"] > 0.95
    assert scores["edges/cut_f"] == 1
    assert scores["edges/accuracy"] == 1
    assert {"seen/overlap_f", "unseen/overlap_f", "oracle_hm/boundary_f"} <= set(scores)
    hm = 2 * scores["seen/overlap_f"] * scores["unseen/overlap_f"]
    assert scores["hm/overlap_f"] == pytest.approx(hm / (scores["seen/overlap_f"] + scores["unseen/overlap_f"]))
    assert evaluation.frames.index.tolist() == ["scene8", "scene9", "scene10"]
    assert sorted(evaluation.categories.index) == ["bowl", "can", "mug"]


def test_objects_that_the_head_misses_cost_recall_in_the_unaided_score_only(graphs: SuperpixelGraphDataset) -> None:
    scores = Evaluator(ConnectedComponents())(graphs, Truth(), NothingIsAnObject()).scores
    assert scores["unaided/overlap_f"] == 0
    assert scores["unaided/f75"] == 0
    assert scores["all/overlap_f"] == pytest.approx(scores["oracle/overlap_f"])


def test_scores_of_objects_are_judged(graphs: SuperpixelGraphDataset) -> None:
    evaluation = Evaluator(ConnectedComponents())(graphs, Truth(), TrueObjects())
    scores, objects = evaluation.scores, evaluation.objects
    assert objects["frame"].value_counts().to_dict() == {"scene8": 3, "scene9": 3, "scene10": 3}
    assert objects["right"].all()
    assert scores["calibration/right_share"] == 1
    assert scores["calibration/expected_error"] == pytest.approx(1 - objects["score"].mean())
    assert scores["calibration/brier"] == pytest.approx(((1 - objects["score"]) ** 2).mean())
    half = ScoreCalibration(SEGMENT_FEATURES, [0.0] * 8, [1.0] * 8, [0.0] * 8, 0.0)
    calibrated = Evaluator(ConnectedComponents(), calibration=half)(graphs, Truth(), TrueObjects())
    assert calibrated.objects["score"].tolist() == [0.5] * 9
    assert calibrated.scores["calibration/expected_error"] == 0.5
    assert calibrated.scores["unaided/overlap_f"] == scores["unaided/overlap_f"]
    assert len(Evaluator(ConnectedComponents())(graphs, Truth()).objects) == 0


def test_merging_everything_finds_no_object(graphs: SuperpixelGraphDataset) -> None:
    scores = Evaluator(ConnectedComponents(), boundaries=False)(graphs, Merge()).scores
    assert scores["all/f75"] == 0
    assert scores["edges/cut_recall"] == 0
    assert not any(name.startswith("unaided/") or "boundary" in name for name in scores)


def test_models_are_left_in_the_mode_they_were_in(graphs: SuperpixelGraphDataset) -> None:
    model, head = Truth().train(), TrueObjects().eval()
    Evaluator(ConnectedComponents(), boundaries=False)(graphs[:1], model, head)
    assert model.training
    assert not head.training


class Elsewhere(torch.nn.Module):
    """A model on PyTorch's "meta" device, to which the graphs must be moved."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(1, device="meta"))

    def forward(self, data: Data) -> torch.Tensor:
        assert {value.device.type for _, value in data if isinstance(value, torch.Tensor)} == {"meta"}
        return torch.full((data.edge_label_index.size(1),), 10.0)


def test_graphs_go_to_the_models_device_and_are_scored_on_the_cpu(graphs: SuperpixelGraphDataset) -> None:
    evaluate = Evaluator(ConnectedComponents(), boundaries=False)
    assert evaluate(graphs, Elsewhere()).scores == evaluate(graphs, Merge()).scores


def test_no_graphs_and_graphs_without_truth_are_refused(graphs: SuperpixelGraphDataset) -> None:
    evaluate = Evaluator(ConnectedComponents())
    with pytest.raises(EvaluationError, match="the split is empty"):
        evaluate(graphs[:0], Truth())
    data = graphs[0]
    del data["overlap_count"]
    with pytest.raises(EvaluationError, match="'scene8' has no ground truth"):
        evaluate.score(data, None)  # type: ignore[arg-type]


def test_the_table_is_in_per_cent_with_gaps() -> None:
    table = score_table({"all/overlap_f": 0.5, "oracle/boundary_f": 0.25, "edges/cut_f": 1.0})
    assert table.index.tolist() == ["all", "oracle"]
    assert table.columns.tolist() == ["overlap_f", "boundary_f"]
    assert table.loc["all", "overlap_f"] == 50
    assert np.isnan(table.loc["all", "boundary_f"])


def test_boundaries_change_no_other_score(graphs: SuperpixelGraphDataset, tmp_path: Path) -> None:
    with_boundaries = Evaluator(ConnectedComponents())(graphs, Truth()).scores
    without = Evaluator(ConnectedComponents(), boundaries=False)(graphs, Truth()).scores
    assert without == {name: value for name, value in with_boundaries.items() if "boundary" not in name}


def test_frames_and_categories_tell_seen_from_unseen(graphs: SuperpixelGraphDataset) -> None:
    evaluation = Evaluator(ConnectedComponents(), boundaries=False)(graphs, Truth())
    assert evaluation.categories["seen"].to_dict() == {"can": True, "mug": True, "bowl": False}
    # Every frame shows each category once, so the score of the only unseen category is its mean over frames.
    unseen = evaluation.frames["unseen_overlap_f_measure"]
    assert unseen.mean() == pytest.approx(evaluation.scores["unseen/overlap_f"])
    seen = evaluation.frames["seen_overlap_f_measure"]
    assert seen.mean() == pytest.approx(evaluation.categories["overlap_f_measure"][["can", "mug"]].mean())
    assert list(evaluation.frames.index) == ["scene8", "scene9", "scene10"]
