"""Which instances and which segments count as objects.

In the ground truth the label tells: 0 is background, 1 the supporting surface, and every higher label an object. A
partition of superpixels has no such labels, so every protocol must state which segments it counts as predicted objects:

- `objects_by_label`: the prediction uses the ground truth's labels. The published protocol for overlap and boundaries.
- `objects_by_majority`: a segment counts if most of its pixels lie on ground-truth objects. For methods that group
  pixels but don't decide what is an object. It uses the ground truth, so its scores are not comparable with those of a
  method that decides for itself, and a table must say which protocol was used.
- `objects_by_contact`: every segment that shares a pixel with a ground-truth object. The published protocol per
  category.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgbd.frame import SUPPORT
from sgbd.metrics.contingency import ContingencyTable

FIRST_OBJECT: int = SUPPORT + 1
"""The lowest label of an object; 0 is background and 1 the supporting surface."""


def objects_by_label(table: ContingencyTable, first: int = FIRST_OBJECT) -> NDArray[np.int64]:
    """Return the labels of the segments from `first` on, int64; `first` is 1 if only label 0 means "not an object"."""
    return table.segments[table.segments >= first]


def objects_by_majority(table: ContingencyTable) -> NDArray[np.int64]:
    """Return the labels of the segments with more than half of their known pixels on ground-truth objects, int64."""
    on_objects = table.counts[:, table.instances >= FIRST_OBJECT].sum(axis=1)
    return table.segments[2 * on_objects > table.segment_area]


def objects_by_contact(table: ContingencyTable) -> NDArray[np.int64]:
    """Return the labels of the segments that share at least one pixel with a ground-truth object, int64."""
    return table.segments[table.counts[:, table.instances >= FIRST_OBJECT].any(axis=1)]
