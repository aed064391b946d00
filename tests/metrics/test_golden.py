"""The metrics equal those of the published evaluation on recorded label maps."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sgbd.metrics import (
    ContingencyTable,
    boundary_scores,
    category_scores,
    match_objects,
    overlap_scores,
)

CASES = [
    *("shapes_small", "shapes_vga", "perfect", "nothing_predicted", "no_objects", "both_empty", "one_blob", "disjoint"),
    *("real_learn3", "real_learn20", "real_learn28", "real_learn40"),
]
CATEGORY_CASES = [case for case in CASES if case not in ("no_objects", "both_empty")]  # recorded only for these
NEAR = {"rel": 0, "abs": 1e-9}


def load(shared_data: Path, case: str) -> tuple[np.ndarray, np.ndarray, dict]:
    folder = shared_data / "metrics_golden"
    expected = json.loads((folder / "expected.json").read_text())
    prediction, truth = (np.asarray(Image.open(folder / f"{case}_{kind}.png")) for kind in ("pred", "gt"))
    return prediction, truth, expected[case]


def as_superpixels(prediction: np.ndarray, truth: np.ndarray, size: int = 7) -> tuple[np.ndarray, ...]:
    """Return the overlaps of tiles cut along the borders of the prediction, and the segment of each tile."""
    y, x = np.indices(truth.shape) // size
    tile = y * (truth.shape[1] // size + 1) + x
    _, superpixel = np.unique((tile * 256 + prediction).ravel(), return_inverse=True)
    segment = np.zeros(superpixel.max() + 1, dtype=np.int64)
    segment[superpixel] = prediction.ravel()
    overlap, count = np.unique(superpixel * 256 + truth.ravel(), return_counts=True)
    return overlap // 256, overlap % 256, count, segment


def test_every_recorded_case_is_tested(shared_data: Path):
    expected = json.loads((shared_data / "metrics_golden" / "expected.json").read_text())
    assert set(expected) == set(CASES)
    assert {case for case in expected if "categories" in expected[case]} == set(CATEGORY_CASES)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("source", ["label maps", "superpixels"])
def test_objects(shared_data: Path, case: str, source: str):
    prediction, truth, expected = load(shared_data, case)
    if source == "label maps":
        table = ContingencyTable.from_label_maps(prediction, truth)
    else:
        table = ContingencyTable.from_superpixels(*as_superpixels(prediction, truth))
    matching = match_objects(table)
    overlap = overlap_scores(table, matching)
    boundary = boundary_scores(prediction, truth, matching)
    assert {
        "Objects F-measure": overlap.f_measure,
        "Objects Precision": overlap.precision,
        "Objects Recall": overlap.recall,
        "Boundary F-measure": boundary.f_measure,
        "Boundary Precision": boundary.precision,
        "Boundary Recall": boundary.recall,
        "obj_detected": overlap.predicted,
        "obj_detected_075": overlap.detected,
        "obj_gt": overlap.objects,
        "obj_detected_075_percentage": overlap.detected_share,
    } == pytest.approx(expected["objects"], **NEAR)


@pytest.mark.parametrize("case", CATEGORY_CASES)
def test_categories(shared_data: Path, case: str):
    prediction, truth, recorded = load(shared_data, case)
    expected = recorded["categories"]
    category = {k: str(1 + (7 * k) % 25) for k in range(2, 26)}
    scores = category_scores(ContingencyTable.from_label_maps(prediction, truth), category, prediction, truth)
    names = {
        "F-measure": "overlap_f_measure",
        "Precision": "overlap_precision",
        "Recall": "overlap_recall",
        "Boundary F-measure": "boundary_f_measure",
        "Boundary Precision": "boundary_precision",
        "Boundary Recall": "boundary_recall",
    }
    for published, ours in names.items():
        of_category = {name: getattr(score, ours) for name, score in scores.scores.items()}
        assert of_category == pytest.approx(expected[f"Cats {published}"], **NEAR), published
        of_frame = published if published.startswith("Boundary") else f"Objects {published}"
        assert getattr(scores.mean, ours) == pytest.approx(expected[of_frame], **NEAR), published
    assert (scores.predicted, scores.detected, scores.objects) == (
        expected["obj_detected"],
        expected["obj_detected_075"],
        expected["obj_gt"],
    )
