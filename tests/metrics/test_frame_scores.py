from __future__ import annotations

import numpy as np
import pytest

from sgbd.metrics import (
    ContingencyTable,
    EdgeScores,
    boundary_scores,
    clustering_scores,
    frame_table,
    match_objects,
    objects_by_majority,
    overlap_scores,
    score_frame,
    summarize,
)

TRUTH = np.array([[0, 0, 2, 2], [1, 1, 2, 2]])
PREDICTION = np.array([[0, 0, 2, 2], [1, 1, 1, 2]])


def test_one_row_holds_every_score():
    table = ContingencyTable.from_label_maps(PREDICTION, TRUTH)
    oracle = ContingencyTable.from_label_maps(TRUTH, TRUTH)
    edges = EdgeScores(0.1, 0.2, 0.3, 0.4)
    frame = score_frame(
        table, prediction=PREDICTION, truth=TRUTH, oracle=oracle, oracle_prediction=TRUTH, edges=edges, name="a"
    )
    matching = match_objects(table)
    assert frame.overlap == overlap_scores(table, matching)
    assert frame.boundary == boundary_scores(PREDICTION, TRUTH, matching)
    assert frame.clustering == clustering_scores(table)
    row = frame.as_dict()
    assert row["name"] == "a"
    assert row["overlap_recall"] == 0.75
    assert row["oracle_overlap_f_measure"] == row["oracle_boundary_f_measure"] == 1
    assert (row["cut_recall"], row["merge_accuracy"]) == (0.2, 0.4)
    assert row["variation_of_information"] == frame.clustering.variation_of_information


def test_objects_are_chosen_by_the_caller():
    prediction = np.array([[0, 0, 1, 1], [0, 0, 1, 1]])
    table = ContingencyTable.from_label_maps(prediction, TRUTH)
    assert score_frame(table).overlap.predicted == 0
    assert score_frame(table, objects_by_majority(table)).overlap.f_measure == 1


def test_summary_is_the_mean_over_frames():
    perfect = score_frame(ContingencyTable.from_label_maps(TRUTH, TRUTH), edges=EdgeScores(1, 1, 1, 0.5), name="a")
    missed = score_frame(ContingencyTable.from_label_maps(np.zeros_like(TRUTH), TRUTH), name="b")
    assert frame_table([perfect, missed]).index.tolist() == ["a", "b"]
    summary = summarize([perfect, missed])
    assert summary["overlap_f_measure"] == 0.5  # the F of mean precision 1 and mean recall 0.5 would be 2/3
    assert summary["overlap_precision"] == 1
    assert summary["merge_accuracy"] == 0.5  # of the one frame that has it
    assert summary["frames"] == 2


def test_no_frames():
    assert summarize([]) == {"frames": 0}


def test_boundaries_need_the_truth():
    table = ContingencyTable.from_label_maps(PREDICTION, TRUTH)
    with pytest.raises(ValueError, match="give truth with prediction"):
        score_frame(table, prediction=PREDICTION)
    with pytest.raises(ValueError, match="truth and oracle"):
        score_frame(table, truth=TRUTH, oracle_prediction=TRUTH)
