from __future__ import annotations

import math

import numpy as np
import pytest

from sgbd.metrics import CategoryScores, ContingencyTable, PairScores, category_scores, category_table, seen_and_unseen
from sgbd.metrics import harmonic_mean as hm

# Three objects: two mugs (2, 3) and a can (4). Segment 0 covers the can and the background.
PREDICTION = np.array([[0, 0, 0, 0, 2, 2, 2, 2, 3, 3]])
TRUTH = np.array([[0, 0, 4, 4, 2, 2, 2, 1, 3, 3]])
CATEGORY = {2: "mug", 3: "mug", 4: "can"}


def scores_of(f: float) -> PairScores:
    return PairScores(f, f, f, f, f, f)


def test_means_within_a_category():
    frame = category_scores(ContingencyTable.from_label_maps(PREDICTION, TRUTH), CATEGORY, PREDICTION, TRUTH)
    assert set(frame.scores) == {"mug", "can"}
    mug = frame.scores["mug"]
    assert mug.overlap_precision == pytest.approx((3 / 4 + 1) / 2)
    assert mug.overlap_recall == 1
    assert mug.overlap_f_measure == pytest.approx((6 / 7 + 1) / 2)
    can = frame.scores["can"]
    assert (can.overlap_precision, can.overlap_recall) == (0.5, 1)
    assert (frame.predicted, frame.detected, frame.objects) == (3, 2, 3)
    assert frame.mean.overlap_f_measure == pytest.approx((mug.overlap_f_measure + can.overlap_f_measure) / 2)


def test_objects_without_a_match_are_skipped_or_count_as_zero():
    prediction = np.zeros_like(TRUTH)
    table = ContingencyTable.from_label_maps(prediction, TRUTH)
    skipped = category_scores(table, CATEGORY, prediction, TRUTH)
    assert set(skipped.scores) == {"mug"}  # the single segment is matched with the largest object
    assert skipped.scores["mug"].overlap_recall == 1
    zero = category_scores(table, CATEGORY, prediction, TRUTH, unmatched="zero")
    assert zero.scores["can"] == scores_of(0.0)
    assert zero.scores["mug"].overlap_recall == 0.5
    assert math.isnan(category_scores(table, CATEGORY, unmatched="zero").scores["can"].boundary_recall)


def test_objects_without_a_category_have_no_score():
    frame = category_scores(ContingencyTable.from_label_maps(PREDICTION, TRUTH), {4: "can"})
    assert set(frame.scores) == {"can"}
    assert math.isnan(frame.scores["can"].boundary_f_measure)


def test_without_categories_contours_are_not_looked_at():
    table = ContingencyTable.from_label_maps(PREDICTION, TRUTH)
    with_contours, without = category_scores(table, {}, PREDICTION, TRUTH), category_scores(table, {})
    assert with_contours == without
    assert (without.predicted, without.detected, without.objects) == (3, 2, 3)


def test_no_objects():
    table = ContingencyTable.from_label_maps(np.array([[0, 2]]), np.array([[0, 1]]))
    frame = category_scores(table, {})
    assert frame.scores == {}
    assert frame.mean == scores_of(1.0)


def test_seen_unseen_and_harmonic_mean():
    frames = [
        CategoryScores({"mug": scores_of(0.5), "can": scores_of(0.75)}, 2, 0, 2),
        CategoryScores({"mug": scores_of(1.0), "jar": scores_of(0.5)}, 2, 0, 2),
        CategoryScores({"jar": scores_of(0.25)}, 1, 0, 1),
    ]
    by_category = category_table(frames)
    assert by_category["overlap_f_measure"].to_dict() == {"mug": 0.75, "can": 0.75, "jar": 0.375}
    assert by_category["frames"].to_dict() == {"mug": 2, "can": 1, "jar": 2}
    table = seen_and_unseen(frames, seen={"mug", "can", "bag"})
    assert table["boundary_recall"].to_dict() == {"seen": 0.75, "unseen": 0.375, "harmonic_mean": 0.5}
    assert table["categories"].to_dict() == {"seen": 2, "unseen": 1, "harmonic_mean": 3}


def test_no_unseen_category():
    table = seen_and_unseen([CategoryScores({"mug": scores_of(0.5)}, 1, 0, 1)], seen={"mug"})
    assert table.at["seen", "overlap_recall"] == 0.5
    assert table.loc[["unseen", "harmonic_mean"], "overlap_recall"].isna().all()
    assert seen_and_unseen([], seen=set())["categories"].tolist() == [0, 0, 0]


def test_harmonic_mean():
    assert hm(0.5, 1.0) == pytest.approx(2 / 3)
    assert hm(0.0, 0.0) == 0
    assert math.isnan(hm(0.5, math.nan))


def test_bad_arguments():
    table = ContingencyTable.from_label_maps(PREDICTION, TRUTH)
    with pytest.raises(ValueError, match="'skip' or 'zero'"):
        category_scores(table, CATEGORY, unmatched="drop")
    with pytest.raises(ValueError, match="both label maps"):
        category_scores(table, CATEGORY, prediction=PREDICTION)
