from dataclasses import replace
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from sgbd.data import SuperpixelGraphDataset
from sgbd.evaluation import EvaluationError, Evaluator
from sgbd.failures import MISSED, TABLE_AS_OBJECT, failure_counts
from sgbd.frame import Frame
from sgbd.graph import GraphBuilder
from sgbd.label_images import LabelImages, LabelImagesError
from sgbd.label_map_evaluation import evaluate_label_maps, score_label_map
from sgbd.partition import ConnectedComponents
from sgbd.preparation import prepare
from sgbd.superpixels import Slic
from tests.scenes import Scenes, scene
from tests.test_evaluation import Truth


class TrueLabels:
    """An oracle method that uses the ground truth."""

    def __init__(self, decides_objects: bool) -> None:
        self.decides_objects = decides_objects

    def __call__(self, frame: Frame) -> np.ndarray:
        assert frame.instances is not None
        return np.where(frame.instances >= 2, frame.instances, 0) if self.decides_objects else frame.instances + 1


class Superpixels:
    """A method that merges nothing."""

    decides_objects = False

    def __call__(self, frame: Frame) -> np.ndarray:
        return Slic(40, min_size=4)(frame) + 1


def test_the_truth_scores_one_in_every_protocol() -> None:
    scores = evaluate_label_maps(Scenes("test"), TrueLabels(True)).evaluation.scores
    for protocol in ("all", "unaided", "seen", "unseen", "hm"):
        assert scores[f"{protocol}/overlap_f"] == 1
        assert scores[f"{protocol}/boundary_f"] == 1
    assert not any(name.startswith("oracle") for name in scores)


def test_methods_that_do_not_decide_have_no_unaided_score_and_no_false_objects() -> None:
    found = evaluate_label_maps(Scenes("test"), TrueLabels(False), boundaries=False)
    scores = found.evaluation.scores
    assert scores["all/f75"] == scores["hm/overlap_f"] == 1
    assert not any(name.startswith("unaided") or "boundary" in name for name in scores)
    assert failure_counts(found.failures)["found"] == 9


def test_it_is_the_metric_of_trained_models(tmp_path: Path) -> None:
    """A label map of superpixels gets the same scores as a graph without merged edges."""

    class Cut(Truth):
        def forward(self, data):
            return super().forward(data) * 0 - 10.0

    folder = prepare(Scenes("test"), Slic(40, min_size=4), GraphBuilder(), tmp_path, workers=0)
    of_graphs = Evaluator(ConnectedComponents())(SuperpixelGraphDataset(folder, "test"), Cut())
    of_maps = evaluate_label_maps(Scenes("test"), Superpixels()).evaluation
    assert of_maps.scores == pytest.approx({name: of_graphs.scores[name] for name in of_maps.scores}, abs=1e-12)
    assert {"all/boundary_f", "seen/overlap_f", "hm/boundary_f", "regions/rand_error"} <= set(of_maps.scores)
    assert of_maps.frames["overlap_f_measure"].tolist() == of_graphs.frames["overlap_f_measure"].tolist()


def test_frames_go_by_their_names_in_the_dataset(tmp_path: Path) -> None:
    class Unnamed(Scenes):
        """A user's dataset that does not write names into its frames."""

        def read(self, index: int) -> Frame:
            return replace(super().read(index), name="")

    for frame in Scenes("test"):
        assert frame.instances is not None
        iio.imwrite(tmp_path / f"{frame.name}.png", np.where(frame.instances >= 2, frame.instances, 0).astype(np.uint8))
    found = evaluate_label_maps(Unnamed("test"), LabelImages(tmp_path))
    assert found.evaluation.frames.index.tolist() == ["scene8", "scene9", "scene10"]
    assert found.evaluation.frames["unaided_overlap_f_measure"].tolist() == [1, 1, 1]
    assert [frame.name for frame in found.failures] == ["scene8", "scene9", "scene10"]


def test_what_a_method_takes_for_no_object_is_none_even_with_help_from_the_truth() -> None:
    frame = scene(8)
    found = score_label_map(np.zeros_like(frame.instances), frame, decides_objects=True)
    assert found.scores.all.overlap.f_measure == 0
    assert found.scores.all.overlap.predicted == 0
    assert set(found.failures.kind_of_object.values()) == {MISSED}


def test_ignored_pixels_count_nowhere() -> None:
    frame = scene(8)
    assert frame.instances is not None
    prediction = np.where(frame.instances >= 2, frame.instances, 0)
    ignored = frame.instances.copy()
    ignored[:20] = -1
    prediction[:20] = 77
    found = score_label_map(prediction, replace(frame, instances=ignored), decides_objects=True)
    assert found.scores.unaided is not None
    assert found.scores.unaided.overlap.f_measure == 1
    assert found.scores.unaided.boundary is not None
    assert found.scores.unaided.boundary.f_measure == 1
    assert found.failures.count(TABLE_AS_OBJECT) == 0


def test_frames_that_cannot_be_scored_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    source = Scenes("test")
    for number in (8, 9):
        iio.imwrite(tmp_path / f"scene{number}.png", TrueLabels(True)(scene(number)).astype(np.uint8))
    iio.imwrite(tmp_path / "scene9.png", np.zeros((3, 3), np.uint8))
    found = evaluate_label_maps(source, LabelImages(tmp_path))
    assert list(found.left_out) == ["scene9", "scene10"]
    assert "3x3 pixels" in found.left_out["scene9"]
    assert "no label image" in found.left_out["scene10"]
    assert "left out: 2 of 3 frames" in caplog.text
    assert found.evaluation.frames.index.tolist() == ["scene8"]
    with pytest.raises(EvaluationError, match="frame scene9: .*3x3 pixels"):
        evaluate_label_maps(source, LabelImages(tmp_path), on_error="fail")
    (tmp_path / "scene8.png").unlink()
    with pytest.raises(EvaluationError, match="none of the 3 frames can be scored"):
        evaluate_label_maps(source, LabelImages(tmp_path))
    (tmp_path / "scene9.png").unlink()
    with pytest.raises(LabelImagesError):
        evaluate_label_maps(source, LabelImages(tmp_path))


def test_workers_change_nothing(tmp_path: Path) -> None:
    alone = evaluate_label_maps(Scenes("train"), Superpixels(), boundaries=False)
    together = evaluate_label_maps(Scenes("train"), Superpixels(), boundaries=False, workers=2)
    assert alone.evaluation.scores == together.evaluation.scores
    assert alone.failures == together.failures
