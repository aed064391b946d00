"""Failures on hand-made label maps, one kind at a time."""

import numpy as np
import pytest

from sgbd.failures import (
    KINDS,
    MISSED,
    OVER_MERGED,
    OVER_SPLIT,
    SUPERPIXEL_LEAK,
    TABLE_AS_OBJECT,
    WITH_TABLE,
    Failures,
    classify_failures,
    failure_counts,
    failure_table,
)
from sgbd.metrics import ContingencyTable

TRUTH = np.array([[0, 0, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 1, 1, 1, 1]])


def classify(prediction: list[int], oracle: list[int] | None = None, truth: np.ndarray = TRUTH) -> Failures:
    table = ContingencyTable.from_label_maps(np.array([prediction]), truth)
    best = None if oracle is None else ContingencyTable.from_label_maps(np.array([oracle]), truth)
    return classify_failures(table, table.segments[table.segments > 0], best, "frame")


def test_what_is_found_is_no_failure() -> None:
    found = classify([0, 0, 0, 0, 5, 5, 5, 5, 7, 7, 7, 7, 0, 0, 0, 0])
    assert found == Failures("frame", 2, {}, (), 2)
    assert found.total == 0


@pytest.mark.parametrize(
    ("prediction", "kinds", "false"),
    [
        # Nothing covers object 3.
        ([0, 0, 0, 0, 5, 5, 5, 5, 0, 0, 0, 0, 0, 0, 0, 0], {3: MISSED}, ()),
        # A quarter of object 3 is covered: the missing part dominates.
        ([0, 0, 0, 0, 5, 5, 5, 5, 7, 0, 0, 0, 0, 0, 0, 0], {3: MISSED}, ()),
        # Object 2 in two halves.
        ([0, 0, 0, 0, 5, 5, 6, 6, 7, 7, 7, 7, 0, 0, 0, 0], {2: OVER_SPLIT}, ()),
        # One segment for both objects: neither is found, because F = 2 * 4 / (4 + 8).
        ([0, 0, 0, 0, 5, 5, 5, 5, 5, 5, 5, 5, 0, 0, 0, 0], {2: OVER_MERGED, 3: OVER_MERGED}, ()),
        # Object 3 with an equally large part of the table: half of the segment lies on the object.
        ([0, 0, 0, 0, 5, 5, 5, 5, 7, 7, 7, 7, 7, 7, 7, 7], {3: WITH_TABLE}, ()),
        # Only table, and only wall.
        ([9, 9, 0, 0, 5, 5, 5, 5, 7, 7, 7, 7, 8, 8, 8, 8], {}, (8, 9)),
    ],
    ids=["uncovered", "mostly uncovered", "split", "merged", "with table", "table"],
)
def test_kinds(prediction: list[int], kinds: dict[int, str], false: tuple[int, ...]) -> None:
    found = classify(prediction)
    assert found.kind_of_object == kinds
    assert found.false_objects == false
    assert found.total == len(kinds) + len(false)


def test_of_equal_causes_the_first_counts() -> None:
    # Object 2: two pixels are missing, two have a separate segment.
    assert classify([0, 0, 0, 0, 5, 5, 0, 0, 7, 7, 7, 7, 0, 0, 0, 0]).kind_of_object == {2: MISSED}
    truth = np.array([[2, 2, 2, 2, 1, 1, 1, 1]])
    assert classify([5, 5, 6, 0, 0, 0, 0, 0], truth=truth).kind_of_object == {2: MISSED}
    assert classify([5, 5, 6, 6, 0, 0, 0, 0], truth=truth).kind_of_object == {2: OVER_SPLIT}


def test_what_no_partition_of_the_superpixels_finds_is_their_failure() -> None:
    merged = [0, 0, 0, 0, 5, 5, 5, 5, 5, 5, 5, 5, 0, 0, 0, 0]
    # The best partition has object 2, but not object 3: its superpixels went to the table.
    oracle = [0, 0, 1, 1, 2, 2, 2, 2, 1, 1, 1, 3, 1, 1, 1, 1]
    assert classify(merged, oracle).kind_of_object == {2: OVER_MERGED, 3: SUPERPIXEL_LEAK}
    # A found object is not a leak, whatever the oracle says.
    right = [0, 0, 0, 0, 5, 5, 5, 5, 7, 7, 7, 7, 0, 0, 0, 0]
    assert classify(right, oracle).kind_of_object == {}


def test_ignored_pixels_count_nowhere() -> None:
    truth = np.array([[2, 2, 2, 2, -1, -1, -1, -1, -1, -1]])
    assert classify([5, 5, 5, 5, 5, 5, 5, 5, 5, 6], truth=truth) == Failures("frame", 1, {}, (), 1)


def test_no_objects_on_either_side() -> None:
    empty = np.array([[0, 1]])
    assert classify([0, 0], truth=empty) == Failures("frame", 0, {}, (), 0)
    assert classify([4, 4], truth=empty) == Failures("frame", 0, {}, (4,), 1)


def test_counts_add_up() -> None:
    frames = [
        Failures("a", 3, {2: MISSED}, (), 2),
        Failures("b", 4, {2: OVER_SPLIT, 3: OVER_SPLIT, 5: SUPERPIXEL_LEAK}, (7,), 6),
    ]
    assert failure_counts(frames) == {
        "objects": 7,
        "found": 3,
        SUPERPIXEL_LEAK: 1,
        MISSED: 1,
        OVER_SPLIT: 2,
        OVER_MERGED: 0,
        WITH_TABLE: 0,
        "predicted": 8,
        TABLE_AS_OBJECT: 1,
    }
    table = failure_table(frames)
    assert table.index.tolist() == ["b", "a"]
    assert (table["found"] + table[list(KINDS)].sum(axis=1)).tolist() == table["objects"].tolist()
