"""Classification of segmentation failures, each assigned to exactly one kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from sgbd.metrics.contingency import ContingencyTable
from sgbd.metrics.label_index import label_index
from sgbd.metrics.overlap import DETECTION_THRESHOLD, Matching, match_objects

SUPERPIXEL_LEAK = "superpixel leak"
MISSED = "missed"
OVER_SPLIT = "over-split"
OVER_MERGED = "over-merged"
WITH_TABLE = "merged with table"
TABLE_AS_OBJECT = "table taken for object"

KINDS = (SUPERPIXEL_LEAK, MISSED, OVER_SPLIT, OVER_MERGED, WITH_TABLE)
"""Kinds of failures on true objects, in order of precedence for ties."""


@dataclass(frozen=True)
class Failures:
    """The failures of one frame.

    Attributes:
        name: Name of the frame.
        objects: Number of true objects.
        kind_of_object: The kind of failure (one of `KINDS`) of each true object that was not found, by its id.
        false_objects: Labels of predicted objects that lie mostly on no true object ("table taken for object").
        predicted: Number of predicted objects.
    """

    name: str
    objects: int
    kind_of_object: Mapping[int, str]
    false_objects: tuple[int, ...]
    predicted: int

    def count(self, kind: str) -> int:
        """Return the number of failures of a kind."""
        if kind == TABLE_AS_OBJECT:
            return len(self.false_objects)
        return sum(found == kind for found in self.kind_of_object.values())

    @property
    def total(self) -> int:
        """Number of failures of all kinds."""
        return len(self.kind_of_object) + len(self.false_objects)


def classify_failures(
    table: ContingencyTable, objects: ArrayLike, oracle: ContingencyTable | None = None, name: str = ""
) -> Failures:
    """Classify the failures on the objects of a frame.

    A true object is found if its match has an F-measure above 0.75, as in F@.75 (`sgbd.metrics.overlap`). An object
    that was not found is a *superpixel leak* if the best partition of the superpixels does not find it either.
    Otherwise its failure is the largest of these errors, in pixels, of the predicted object that covers most of it:

    - *missed*: pixels of the object on no predicted object (all of them, if nothing covers it);
    - *over-split*: pixels of the object on other predicted objects;
    - *over-merged*: pixels of that predicted object on other true objects;
    - *merged with table*: pixels of that predicted object on the supporting surface or the background.

    A predicted object that lies mostly on no true object is a *table taken for object*.

    Args:
        table: The contingency table of the frame.
        objects: Labels of the predicted objects.
        oracle: The contingency table of the best partition of the superpixels (`sgbd.metrics.oracle`); None if there
            are no superpixels, and thus no leaks.
        name: Name of the frame.

    Returns:
        The failures.
    """
    matching = match_objects(table, objects)
    predicted, true = matching.predicted_objects, matching.true_objects
    rows = label_index(predicted, table.segments)
    columns = label_index(true, table.instances)
    shared = table.counts[np.ix_(rows, columns)]  # [P, Q]
    area = table.segment_area[rows]
    on_objects = shared.sum(axis=1)
    found = _found(matching)
    reachable = _found(match_objects(oracle)) if oracle is not None else None
    kinds: dict[int, str] = {}
    for q, instance in enumerate(true.tolist()):
        if instance in found:
            continue
        if reachable is not None and instance not in reachable:
            kinds[instance] = SUPERPIXEL_LEAK
            continue
        covered = int(shared[:, q].sum())
        if covered == 0:
            kinds[instance] = MISSED
            continue
        p = int(shared[:, q].argmax())
        loss = {
            MISSED: int(table.counts[:, columns[q]].sum()) - covered,
            OVER_SPLIT: covered - int(shared[p, q]),
            OVER_MERGED: int(on_objects[p] - shared[p, q]),
            WITH_TABLE: int(area[p] - on_objects[p]),
        }
        kinds[instance] = max(loss, key=lambda kind: loss[kind])
    false = predicted[2 * on_objects < area]
    return Failures(name, len(true), kinds, tuple(false.tolist()), len(predicted))


def _found(matching: Matching) -> set[int]:
    return set(matching.instance[matching.f_measure > DETECTION_THRESHOLD].tolist())


def failure_counts(failures: Sequence[Failures]) -> dict[str, int]:
    """Count the failures of many frames by kind.

    Args:
        failures: The failures of each frame.

    Returns:
        `objects`, `found`, one entry for each of `KINDS`, `predicted`, and `table taken for object`.
    """
    objects = sum(frame.objects for frame in failures)
    counts = {kind: sum(frame.count(kind) for frame in failures) for kind in KINDS}
    return {
        "objects": objects,
        "found": objects - sum(counts.values()),
        **counts,
        "predicted": sum(frame.predicted for frame in failures),
        TABLE_AS_OBJECT: sum(frame.count(TABLE_AS_OBJECT) for frame in failures),
    }


def failure_table(failures: Sequence[Failures]) -> pd.DataFrame:
    """Arrange the failures of many frames in one row per frame, indexed by name, with the columns of `failure_counts`.

    Args:
        failures: The failures of each frame.

    Returns:
        The table, the frame with the most failures first.
    """
    ranked = sorted(failures, key=lambda frame: -frame.total)
    rows = [failure_counts([frame]) for frame in ranked]
    return pd.DataFrame(rows, index=pd.Index([frame.name for frame in ranked], name="frame"))
