from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf
from torch_geometric.data import Data

from sgbd.calibration import ScoreCalibration
from sgbd.checkpoint import instantiate
from sgbd.data import SuperpixelGraphDataset
from sgbd.evaluation import Evaluator
from sgbd.graph import GraphBuilder
from sgbd.partition import ConnectedComponents, GreedyMulticut
from sgbd.preparation import prepare
from sgbd.segmentation import ObjectRule
from sgbd.superpixels import Slic
from sgbd.tuning import Tuning
from tests.scenes import Scenes

COMPONENTS = {"_target_": "sgbd.partition.ConnectedComponents", "threshold": 0.5}
RULE = {"_target_": "sgbd.segmentation.ObjectRule", "min_objectness": 0.5, "min_area": 0}
SMALL = {
    "threshold": [0.3, 0.5, 0.9],
    "border_weight": ["none"],
    "objectness_weight": [0.0],
    "min_objectness": [0.3, 0.7],
    "min_area": [0, 40],
}


class TooMerging(torch.nn.Module):
    """An edge model that ranks all edges correctly, but gives cuts a high merge probability."""

    def forward(self, data: Data) -> torch.Tensor:
        return torch.logit(torch.where(data.edge_label == 1, 0.85, 0.65))


class TooStrict(torch.nn.Module):
    """An objectness head that ranks all superpixels correctly, but gives objects a low probability."""

    def forward(self, data: Data) -> torch.Tensor:
        return torch.logit(torch.where(data.node_instance >= 2, 0.4, 0.1))


@pytest.fixture(scope="module")
def graphs(tmp_path_factory: pytest.TempPathFactory) -> SuperpixelGraphDataset:
    folder = prepare(Scenes("test"), Slic(40, min_size=4), GraphBuilder(), tmp_path_factory.mktemp("graphs"), workers=0)
    return SuperpixelGraphDataset(folder, "test")


def test_thresholds_that_separate_are_found(graphs: SuperpixelGraphDataset) -> None:
    result = Tuning(**SMALL)(graphs, TooMerging(), TooStrict(), COMPONENTS, RULE)
    assert 0.65 < result.partition["threshold"] < 0.85, "between the values tried first"
    assert 0.1 < result.objects["min_objectness"] <= 0.4
    assert result.partition["_target_"] == COMPONENTS["_target_"]
    assert "border_weight" not in result.partition, "which connected components don't have"
    # The numbers in the table equal those of an evaluation with the found settings.
    rule = ObjectRule(result.objects["min_objectness"], result.objects["min_area"])
    scores = Evaluator(ConnectedComponents(result.partition["threshold"]), rule)(
        graphs, TooMerging(), TooStrict()
    ).scores
    best = result.table.iloc[0]
    for name in ("overlap_f", "f75", "boundary_f"):
        assert scores[f"unaided/{name}"] == scores[f"oracle/{name}"] == pytest.approx(best[name])
    assert result.summary["after"] == pytest.approx(best["mean"])
    assert result.summary["before"] < result.summary["after"]
    assert (result.summary["protocol"], result.summary["frames"]) == ("unaided", 3)


class NoObjects(ObjectRule):
    """A user-defined rule that accepts no object."""

    def accepts(self, objectness: np.ndarray, area: np.ndarray) -> np.ndarray:
        return np.zeros(len(area), bool)


def test_a_rule_of_ones_own_decides(graphs: SuperpixelGraphDataset) -> None:
    own = {**RULE, "_target_": "tests.test_tuning.NoObjects"}
    result = Tuning(**SMALL, rounds=0)(graphs, TooMerging(), TooStrict(), COMPONENTS, own, trust=("tests",))
    assert result.objects["_target_"] == own["_target_"]
    assert result.summary["before"] == result.summary["after"] == 0


def test_objectness_in_the_partition_is_found_where_it_helps(graphs: SuperpixelGraphDataset) -> None:
    given = {**SMALL, "threshold": [0.5], "objectness_weight": [0.0, 1.0]}
    result = Tuning(**given, rounds=0)(graphs, TooMerging(), TooStrict(), COMPONENTS, RULE)
    assert (result.partition["threshold"], result.partition["objectness_weight"]) == (0.5, 1.0)
    assert result.summary["before"] == 0
    assert result.summary["after"] > 0.99


def test_scores_are_calibrated_with_the_settings_found(graphs: SuperpixelGraphDataset) -> None:
    # With only the threshold 0.9, all superpixels stay separate, and only some objects are a single superpixel.
    given = {**SMALL, "threshold": [0.9], "min_objectness": [0.3]}
    start = {**COMPONENTS, "threshold": 0.9}
    result = Tuning(**given, rounds=0)(graphs, TooMerging(), TooStrict(), start, RULE)
    calibration = instantiate(result.calibration, ScoreCalibration)
    rule = ObjectRule(result.objects["min_objectness"], result.objects["min_area"])
    scores = Evaluator(ConnectedComponents(0.9), rule, calibration=calibration)(
        graphs, TooMerging(), TooStrict()
    ).scores
    assert 0 < scores["calibration/right_share"] < 1
    assert scores["calibration/mean_score"] == pytest.approx(scores["calibration/right_share"], abs=1e-4)
    plain = Evaluator(ConnectedComponents(0.9), rule)(graphs, TooMerging(), TooStrict()).scores
    assert scores["calibration/brier"] < plain["calibration/brier"]
    assert Tuning(**given, calibrate=False)(graphs, TooMerging(), TooStrict(), start, RULE).calibration is None


def test_nothing_to_calibrate_on_is_told(graphs: SuperpixelGraphDataset, caplog: pytest.LogCaptureFixture) -> None:
    result = Tuning(**SMALL)(graphs, TooMerging(), TooStrict(), COMPONENTS, RULE)
    assert result.calibration is None
    assert "the scores stay uncalibrated: 9 of 9 validation segments are right" in caplog.text


def test_without_a_head_the_merging_alone_is_tuned(graphs: SuperpixelGraphDataset) -> None:
    result = Tuning(**SMALL)(graphs, TooMerging(), None, COMPONENTS, RULE)
    assert 0.65 < result.partition["threshold"] < 0.85
    assert result.objects == RULE
    assert result.summary["protocol"] == "all"
    assert not {"min_area", "min_objectness", "objectness_weight"} & set(result.table)


def test_a_start_that_cannot_be_beaten_is_kept(graphs: SuperpixelGraphDataset) -> None:
    start = {**COMPONENTS, "threshold": 0.777}
    rule = {**RULE, "min_objectness": 0.222}
    result = Tuning(**SMALL, rounds=0)(graphs, TooMerging(), TooStrict(), start, rule)
    assert (result.partition, result.objects["min_objectness"]) == ({**start, "objectness_weight": 0.0}, 0.222)
    assert result.summary["before"] == result.summary["after"]


def test_the_search_is_the_same_every_time_and_names_every_setting_once(graphs: SuperpixelGraphDataset) -> None:
    multicut = {"_target_": "sgbd.partition.GreedyMulticut", "epsilon": 1e-4}
    tuning = Tuning(**{**SMALL, "border_weight": ["length", "none"]}, rounds=1, finalists=3)
    first, second = (tuning(graphs, TooMerging(), TooStrict(), multicut, RULE) for _ in range(2))
    assert first.table.equals(second.table)
    assert first.partition == second.partition
    assert first.partition["epsilon"] == 1e-4
    names = ["threshold", "border_weight", "objectness_weight", "min_objectness", "min_area"]
    assert not first.table.duplicated(names).any()
    assert 3 <= first.table["boundary_f"].notna().sum() <= 4, "the finalists and the start"
    means = first.table["mean"].dropna()
    assert (np.diff(means) <= 0).all()
    assert GreedyMulticut(**{k: v for k, v in first.partition.items() if k != "_target_"})


def test_whole_numbers_among_the_values_are_refined_too(graphs: SuperpixelGraphDataset) -> None:
    values = {**SMALL, "threshold": [0.5], "objectness_weight": [0, 1]}
    table = Tuning(**values, rounds=1)(graphs, Even(), TooStrict(), COMPONENTS, RULE).table
    assert sorted(set(table["objectness_weight"])) == [0, 0.5, 1]
    assert all(area == int(area) for area in table["min_area"])


def test_what_cannot_be_tuned_is_refused(graphs: SuperpixelGraphDataset) -> None:
    with pytest.raises(ValueError, match=r"no validation graphs.*tuning=none"):
        Tuning()([], TooMerging(), None, COMPONENTS, RULE)
    data = graphs[0]
    del data["overlap_count"]
    with pytest.raises(ValueError, match="'scene8' has no ground truth"):
        Tuning()([data], Even(), None, COMPONENTS, RULE)
    with pytest.raises(ValueError, match=r"tuning\.threshold must be a list"):
        Tuning(threshold=[])
    with pytest.raises(ValueError, match=r"tuning\.finalists at least 1"):
        Tuning(finalists=0)


class Even(torch.nn.Module):
    """An uninformative edge model."""

    def forward(self, data: Data) -> torch.Tensor:
        return torch.zeros(data.edge_label_index.size(1))


def test_the_shipped_values_are_the_defaults() -> None:
    config = OmegaConf.load(Path(__file__).parents[1] / "conf" / "tuning" / "validation.yaml")
    values = {key: value for key, value in OmegaConf.to_container(config).items() if key != "_target_"}
    assert values == {key: list(v) if isinstance(v, tuple) else v for key, v in vars(Tuning()).items()}
