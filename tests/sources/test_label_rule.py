from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from sgbd.frame import FrameError
from sgbd.sources.label_rule import MOSD, PLAIN, LabelRule, detect_label_rule


def labels(*values: int) -> npt.NDArray[np.int32]:
    return np.array([values], dtype=np.int32)


def test_the_plain_rule_changes_nothing() -> None:
    assert PLAIN(labels(0, 1, 2, 3, 700)).tolist() == [[0, 1, 2, 3, 700]]


def test_mosd_labels_are_merged_by_tens() -> None:
    assert MOSD(labels(0, 1, 9, 20, 29, 30, 61)).tolist() == [[-1, 1, 1, 2, 2, 3, 6]]


@given(
    arrays.arrays(np.int32, (5, 7), elements=st.one_of(st.integers(0, 9), st.integers(20, 255), st.integers(20, 65535)))
)
def test_mosd_agrees_with_arithmetic(image: npt.NDArray[np.int32]) -> None:
    expected = [[-1 if v == 0 else 1 if v <= 9 else v // 10 for v in row] for row in image.tolist()]
    assert MOSD(image).tolist() == expected


def test_objects_numbered_from_one_are_shifted() -> None:
    rule = LabelRule(support=[], objects=["1-"], offset=1)
    assert rule(labels(0, 1, 5)).tolist() == [[0, 2, 6]]


def test_single_labels_and_closed_ranges() -> None:
    rule = LabelRule(background=[0, 7], support=[1, "2-3"], ignore=[255], objects=["4-6", 9])
    assert rule(labels(0, 7, 1, 2, 3, 255, 4, 6, 9)).tolist() == [[0, 0, 1, 1, 1, -1, 4, 6, 9]]


def test_a_label_without_a_meaning_is_an_error_that_tells_the_rule() -> None:
    with pytest.raises(FrameError, match=r"without a meaning: 13, 17\..*support=\['1-9'\].*divisor=10"):
        MOSD(labels(0, 13, 17, 20))


def test_negative_labels_are_refused() -> None:
    with pytest.raises(FrameError, match="negative; got -3"):
        PLAIN(labels(0, -3))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"support": "1-9"}, "support must be a list"),
        ({"support": ["one"]}, "support: expected a label"),
        ({"support": ["9-1"]}, "support: expected a label"),
        ({"support": [-1]}, "support: expected a label"),
        ({"support": [1, 2]}, "label 2 has two meanings"),
        ({"objects": ["2-", 30]}, "label 30 has two meanings"),
        ({"objects": ["1-"], "support": []}, "object label 1 would get the id 1.*offset"),
        ({"objects": ["10-"], "divisor": 10}, "object label 10 would get the id 1"),
        ({"divisor": 0}, "divisor must be at least 1"),
    ],
)
def test_contradictory_rules_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        LabelRule(**options)  # type: ignore[arg-type]


def test_rules_with_the_same_meaning_are_equal() -> None:
    assert LabelRule(support=["1"]) == LabelRule(support=[1]) == PLAIN
    assert len({LabelRule(), PLAIN, MOSD}) == 2


DEPTH = np.array([[0, 0, 1, 1]], dtype=np.float32)


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        ([(labels(0, 0, 1, 20), DEPTH)], MOSD),
        ([(labels(0, 0, 1, 1), DEPTH), (labels(0, 0, 30, 20), DEPTH)], MOSD),
        ([(labels(0, 0, 1, 2), DEPTH)], PLAIN),
        ([(labels(0, 0, 12, 20), DEPTH)], PLAIN),
        ([(labels(0, 0, 1, 20), DEPTH), (labels(0, 0, 1, 12), DEPTH)], PLAIN),
        ([(labels(1, 20, 0, 0), DEPTH)], PLAIN),
        ([(labels(0, 0, 1, 20), DEPTH[:, :3])], PLAIN),
        ([], PLAIN),
    ],
    ids=[
        "mosd",
        "one frame of table only",
        "few objects",
        "between",
        "between later",
        "zeros with depth",
        "size",
        "none",
    ],
)
def test_mosd_is_told_from_plain(frames: list, expected: LabelRule) -> None:
    assert detect_label_rule(frames) == expected
