import json

import numpy as np
import pytest

from sgbd.calibration import (
    SEGMENT_FEATURES,
    ScoreCalibration,
    expected_calibration_error,
    right_segments,
    segment_features,
)
from sgbd.checkpoint import instantiate
from sgbd.metrics import ContingencyTable
from sgbd.recipe import describe


def logit(p: float) -> float:
    return float(np.log(p / (1 - p)))


def test_the_numbers_of_a_chain_of_segments() -> None:
    # Superpixels 0 and 1 are one segment, 2 and 3 each their own.
    features = segment_features(
        np.array([0, 0, 1, 2]), np.array([100, 300, 50, 550]), np.array([[0, 1, 1, 2], [1, 2, 3, 3]]),
        np.array([0.9, 0.2, 0.4, 0.0]), np.array([10.0, 20.0, 60.0, 0.0]), np.array([0.8, 0.6, 0.5, 0.1]),
    )  # fmt: skip
    row = dict(zip(SEGMENT_FEATURES, features[0].tolist(), strict=True))
    assert row == pytest.approx(
        {
            "log_area": np.log(0.4),
            "log_superpixels": np.log(2),
            "inner_merge": logit(0.9),
            "inner_merge_least": logit(0.9),
            "outer_cut": logit((20 * 0.8 + 60 * 0.6) / 80),
            "outer_merge_most": logit(0.4),
            "objectness": logit((100 * 0.8 + 300 * 0.6) / 400),
            "objectness_least": logit(0.6),
        }
    )
    # A segment of one superpixel has no inner edge against it; a pair that does not touch counts like one pixel.
    row = dict(zip(SEGMENT_FEATURES, features[2].tolist(), strict=True))
    assert row["inner_merge"] == row["inner_merge_least"] == logit(0.999)
    assert row["outer_cut"] == pytest.approx(logit((60 * 0.6 + 1 * 1.0) / 61))


def test_the_fit_recovers_the_probabilities_that_made_the_data() -> None:
    rng = np.random.default_rng(0)
    features = rng.normal(size=(20_000, len(SEGMENT_FEATURES))) * 3 + 1
    truth = 1 / (1 + np.exp(-(features[:, 0] - 0.5 * features[:, 3] + 0.2)))
    right = rng.random(20_000) < truth
    calibration = ScoreCalibration.fit(features, right)
    scores = calibration(features)
    assert np.abs(scores - truth).mean() < 0.01
    assert scores.mean() == pytest.approx(right.mean(), abs=1e-5)
    assert expected_calibration_error(scores, right) < 0.015
    # The round trip through plain numbers changes nothing.
    config = json.loads(json.dumps(describe(calibration)))
    assert (instantiate(config, ScoreCalibration)(features) == scores).all()


def test_a_column_that_never_changes_does_no_harm() -> None:
    features = np.zeros((10, len(SEGMENT_FEATURES)))
    right = np.arange(10) < 7
    assert ScoreCalibration.fit(features, right)(features) == pytest.approx(np.full(10, 0.7))


def test_what_cannot_be_fitted_or_read_is_refused() -> None:
    features = np.zeros((3, len(SEGMENT_FEATURES)))
    with pytest.raises(ValueError, match="3 of 3 validation segments are right"):
        ScoreCalibration.fit(features, np.ones(3, bool))
    with pytest.raises(ValueError, match="0 of 0 validation segments"):
        ScoreCalibration.fit(features[:0], np.ones(0, bool))
    numbers = [1.0] * len(SEGMENT_FEATURES)
    with pytest.raises(ValueError, match=r"fitted on color.*Calibrate again"):
        ScoreCalibration(["color"], [0.0], [1.0], [1.0], 0.0)
    with pytest.raises(ValueError, match="calibration.scale must be 8 finite numbers"):
        ScoreCalibration(SEGMENT_FEATURES, numbers, numbers[1:], numbers, 0.0)
    with pytest.raises(ValueError, match="calibration.center must be 8 finite numbers"):
        ScoreCalibration(SEGMENT_FEATURES, [*numbers[1:], float("nan")], numbers, numbers, 0.0)


def test_right_segments_overlap_an_object_by_more_than_three_quarters() -> None:
    truth = np.array([[2] * 8 + [3] * 4 + [1] * 4, [-1] * 16])
    # Segment 0 covers 7 of the 8 pixels of object 2; segment 1 covers one pixel of object 2 and three of object 3;
    # segment 2 covers the table and one pixel of object 3; segment 3 covers only pixels of unknown ground truth.
    prediction = np.array([[0] * 7 + [1] * 4 + [2] * 5, [0] * 8 + [3] * 8])
    table = ContingencyTable.from_label_maps(prediction, truth)
    assert right_segments(table, 4).tolist() == [True, False, False, False]
    assert right_segments(table, 4, iou=0.59).tolist() == [True, True, False, False]
    assert right_segments(table, 4, iou=0.875).tolist() == [False] * 4, "above, not at"


def test_the_expected_calibration_error_by_hand() -> None:
    scores = np.array([0.95, 0.95, 0.15, 1.0, 0.0])
    right = np.array([True, False, False, True, False])
    # Bin 0.9..1: mean score 2.9 / 3, two of three right. Bin 0.1..0.2: 0.15 and none. Bin 0..0.1: exact.
    assert expected_calibration_error(scores, right) == pytest.approx((2.9 - 2 + 0.15) / 5)
    assert np.isnan(expected_calibration_error(scores[:0], right[:0]))
