"""Boundary precision, recall and F-measure of objects.

The contour of an object is compared with the contour of the object matched with it (see `sgbd.metrics.overlap`): a
contour pixel is right if the other contour passes within a disk around it. After F. Perazzi et al., "A benchmark
dataset and evaluation methodology for video object segmentation", CVPR 2016, with the contour and the radius of the
published evaluation of unseen-object segmentation (C. Xie et al., CoRL 2019):

- The *contour* of a mask consists of its pixels that have one of their four neighbours outside. The *outside* is
  everything from which a 4-connected path leads beyond the image edge without crossing the mask. So the contour lies on
  the mask, it follows the image edge where the mask touches it, and holes (and what lies in them) have no contour.
- The disk holds the offsets with dx² + dy² <= r², r = ceil(0.003 · image diagonal) pixels, 3 for 640 x 480.

Ignored pixels belong to no mask, neither predicted nor true: both maps are cleared there before they are compared. No
contour pixel ever lies on an ignored pixel, and predictions there change nothing. If the same ignored region cuts off
both of two matched masks, their contours agree along it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.frame import IGNORE
from sgbd.machine.compiled import compiled
from sgbd.machine.union_find import find_root
from sgbd.metrics.f_measure import precision_recall_f
from sgbd.metrics.label_index import as_label_map, label_index
from sgbd.metrics.overlap import Matching

RADIUS_SHARE: float = 0.003
"""Radius of the matching disk as a share of the image diagonal."""


@dataclass(frozen=True)
class BoundaryScores:
    """Agreement of the contours of predicted and ground-truth objects in one frame.

    Attributes:
        precision: Share (0 to 1) of the predicted objects' contour pixels that are matched.
        recall: Share of the ground-truth objects' contour pixels that are matched.
        f_measure: Harmonic mean of the two.
    """

    precision: float
    recall: float
    f_measure: float


@dataclass(frozen=True, eq=False)
class ContourMatch:
    """Number of contour pixels of the objects of one frame, and how many of them are matched.

    Attributes:
        predicted_length: int64 [P], contour pixels of each of the matching's predicted objects.
        predicted_matched: int64 [P], those near the contour of the ground-truth object matched with it.
        true_length: int64 [Q], contour pixels of each ground-truth object.
        true_matched: int64 [Q], those near the contour of the predicted object matched with it.
    """

    predicted_length: NDArray[np.int64]
    predicted_matched: NDArray[np.int64]
    true_length: NDArray[np.int64]
    true_matched: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ContourMap:
    """Contours of some labels of one label map, computed once for any number of comparisons.

    Attributes:
        labels: int64 [K], the labels whose contours are here.
        index: int32 [H, W], k on the contour of ``labels[k]``, -1 elsewhere. Masks don't overlap, so neither do
            contours.
        pixels: int64 [L], the contours' pixels as positions in the flattened image, ascending.
    """

    labels: NDArray[np.int64]
    index: NDArray[np.int32]
    pixels: NDArray[np.int64]


def matching_radius(height: int, width: int) -> int:
    """Return the radius of the matching disk, in pixels."""
    return math.ceil(RADIUS_SHARE * math.hypot(height, width))


def contours(label_map: ArrayLike, labels: ArrayLike, truth: ArrayLike | None = None) -> ContourMap:
    """Find the contours of the masks of some labels.

    Args:
        label_map: Integers [H, W].
        labels: Distinct labels [K] whose contours to find.
        truth: Integers [H, W], whose ignored pixels (-1) belong to no mask.

    Returns:
        The contours; a label without pixels has a contour of length 0.

    Raises:
        ValueError: If the maps aren't integer label maps of one shape.
    """
    label_map = as_label_map(label_map, "the label map", lowest=IGNORE)
    labels = np.asarray(labels, dtype=np.int64)
    mask = label_index(label_map, labels)
    if truth is not None:
        truth = as_label_map(truth, "the truth", lowest=IGNORE)
        if truth.shape != label_map.shape:
            raise ValueError(
                f"prediction and truth must have one shape, got {list(label_map.shape)} and {list(truth.shape)}"
            )
        mask[truth == IGNORE] = -1
    index = _contours(mask.shape[0], mask.shape[1], *_runs(mask, len(labels)))
    return ContourMap(labels, index, np.flatnonzero(index >= 0))


def match_contours(
    prediction: ArrayLike | ContourMap, truth: ArrayLike | ContourMap, matching: Matching
) -> ContourMatch:
    """Match the contours of matched objects.

    Args:
        prediction: Integers [H, W], predicted segment of each pixel; or the contours of the predicted objects (others
            are allowed), computed with the ignored pixels of the ground truth cleared.
        truth: Integers [H, W], ground-truth instance of each pixel, -1 = ignore; or the contours of the ground-truth
            objects.
        matching: The objects and their matches.

    Returns:
        Contour pixels of every object, and how many of them are near the contour of its match.

    Raises:
        ValueError: If the maps aren't integer label maps of one shape, or the contour of an object is missing.
    """
    if not isinstance(prediction, ContourMap):
        prediction = as_label_map(prediction, "the prediction")
        ignored = None if isinstance(truth, ContourMap) else truth
        prediction = contours(prediction, matching.predicted_objects, ignored)
    if not isinstance(truth, ContourMap):
        truth = contours(truth, matching.true_objects)
    if prediction.index.shape != truth.index.shape:
        raise ValueError(
            f"prediction and truth must have one shape, got {list(prediction.index.shape)} and "
            f"{list(truth.index.shape)}"
        )
    predicted_place = _places(matching.predicted_objects, prediction, "the prediction")
    true_place = _places(matching.true_objects, truth, "the truth")
    partner_of_predicted = np.full(len(prediction.labels), -1, dtype=np.int32)
    partner_of_true = np.full(len(truth.labels), -1, dtype=np.int32)
    p, q = label_index(matching.segment, prediction.labels), label_index(matching.instance, truth.labels)
    partner_of_predicted[p] = q
    partner_of_true[q] = p
    disk = _disk(matching_radius(*prediction.index.shape))
    predicted_length, predicted_matched = _count_matched(
        prediction.pixels, prediction.index, truth.index, partner_of_predicted, disk
    )
    true_length, true_matched = _count_matched(truth.pixels, truth.index, prediction.index, partner_of_true, disk)
    return ContourMatch(
        predicted_length[predicted_place],
        predicted_matched[predicted_place],
        true_length[true_place],
        true_matched[true_place],
    )


def _places(objects: NDArray[np.int64], found: ContourMap, name: str) -> NDArray[np.int32]:
    """Return the index of each object in a contour map."""
    places = label_index(objects, found.labels)
    if (places < 0).any():
        raise ValueError(f"the contours of {name} lack the objects {objects[places < 0].tolist()}: find theirs too")
    return places


def boundary_scores(
    prediction: ArrayLike | ContourMap, truth: ArrayLike | ContourMap, matching: Matching
) -> BoundaryScores:
    """Compute boundary precision, recall and F-measure of one frame; arguments as in `match_contours`."""
    match = match_contours(prediction, truth, matching)
    return BoundaryScores(
        *precision_recall_f(
            int(match.predicted_matched.sum()),
            int(match.predicted_length.sum()),
            int(match.true_matched.sum()),
            int(match.true_length.sum()),
        )
    )


@lru_cache
def _disk(radius: int) -> NDArray[np.int64]:
    """Return the offsets (dy, dx) within the radius, int64 [D, 2], nearest first, so that a search ends early."""
    dy, dx = np.mgrid[-radius : radius + 1, -radius : radius + 1].reshape(2, -1)
    squared = dy * dy + dx * dx
    order = np.argsort(squared, kind="stable")
    order = order[squared[order] <= radius * radius]
    return np.stack([dy[order], dx[order]], axis=1)


@compiled
def _runs(
    mask: NDArray[np.int32], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Find the runs of each mask k (the pixels where `mask` is k): maximal sequences of neighbouring pixels in a row.

    Args:
        mask: int32 [H, W], 0 to `count` - 1; -1 for pixels of no mask.
        count: Number of masks K.

    Returns:
        All runs, sorted by mask, in raster order within a mask:

        - offset: int64 [K + 1], index of the first run of each mask, then the number R of all runs.
        - row, start, end: int64 [R], the row of each run, its first column, and the column after its last.
    """
    height, width = mask.shape
    found = np.empty((4, height * width), dtype=np.int32)  # pages that are never written cost nothing
    offset = np.zeros(count + 1, dtype=np.int64)
    total = 0
    for y in range(height):
        x = 0
        while x < width:
            k, first = mask[y, x], x
            while x < width and mask[y, x] == k:
                x += 1
            if k >= 0:
                found[0, total], found[1, total], found[2, total], found[3, total] = k, y, first, x
                offset[k + 1] += 1
                total += 1
    # Sort the runs by mask (counting sort): `free[k]` is the next free place of mask k.
    for k in range(count):
        offset[k + 1] += offset[k]
    free = offset[:-1].copy()
    row, start, end = np.empty(total, np.int64), np.empty(total, np.int64), np.empty(total, np.int64)
    for r in range(total):
        place = free[found[0, r]]
        row[place], start[place], end[place] = found[1, r], found[2, r], found[3, r]
        free[found[0, r]] += 1
    return offset, row, start, end


@compiled
def _contours(
    height: int,
    width: int,
    offset: NDArray[np.int64],
    row: NDArray[np.int64],
    start: NDArray[np.int64],
    end: NDArray[np.int64],
) -> NDArray[np.int32]:
    """Find the contour of each mask from its runs of pixels, instead of pixel by pixel.

    Between two runs of a mask in one row lies a *gap*: gap i is the one before run i, for every run that is not the
    first of its row. Everything before the first run of a row and after the last is outside. A gap is outside if it is
    connected to the outside through gaps that overlap vertically. In the mask below, each run is drawn by its number;
    gap 2 is a hole, and gap 5 is outside::

        . 0 0 0 0 .
        . 1 . . 2 .      gap 2: runs 0 and 3 close it above and below
        . 3 3 3 3 .
        . 4 . . 5 .      gap 5: nothing closes it below

    Gaps are grouped by union-find; the outside is the additional member R.

    Args:
        height: Rows of the image, pixels.
        width: Columns of the image, pixels.
        offset: int64 [K + 1]; this and the following from `_runs`.
        row: int64 [R].
        start: int64 [R].
        end: int64 [R].

    Returns:
        int32 [H, W], k on the contour of mask k, -1 elsewhere.
    """
    count, total = len(offset) - 1, len(row)
    contour = np.full((height, width), -1, dtype=np.int32)
    parent = np.arange(total + 1)
    outside = total
    of_row = np.empty(height + 1, dtype=np.int64)
    for k in range(count):
        if offset[k] == offset[k + 1]:
            continue
        top, bottom = row[offset[k]], row[offset[k + 1] - 1]
        # The runs of row y are of_row[y - top] to of_row[y - top + 1] - 1.
        r = offset[k]
        for y in range(top, bottom + 2):
            while r < offset[k + 1] and row[r] < y:
                r += 1
            of_row[y - top] = r
        # Connect the gaps of each pair of rows (y - 1, y) with the outside and with each other.
        for y in range(top, bottom + 2):
            above, here = of_row[max(y - 1 - top, 0)], of_row[y - top]
            behind = of_row[y - top + 1] if y <= bottom else here
            _open_gaps(start, end, above, here, here, behind, parent, outside)
            _open_gaps(start, end, here, behind, above, here, parent, outside)
            _join_gaps(start, end, above, here, behind, parent)
        # The gaps are final. Mark the ends of runs beside the outside, then the pixels with the outside above or below.
        for y in range(top, bottom + 1):
            above, here, behind = of_row[max(y - 1 - top, 0)], of_row[y - top], of_row[y - top + 1]
            below = of_row[y - top + 2] if y < bottom else behind
            for r in range(here, behind):
                if r == here or find_root(parent, r) == find_root(parent, outside):
                    contour[y, start[r]] = k
                if r == behind - 1 or find_root(parent, r + 1) == find_root(parent, outside):
                    contour[y, end[r] - 1] = k
            _mark(contour, k, y, start, end, here, behind, above, here, parent, outside)
            _mark(contour, k, y, start, end, here, behind, behind, below, parent, outside)
    return contour


@compiled
def _open_gaps(
    start: NDArray[np.int64],
    end: NDArray[np.int64],
    first: int,
    last: int,
    other: int,
    other_last: int,
    parent: NDArray[np.int64],
    outside: int,
) -> None:
    """Join the gaps of one row with the outside if they touch the outside of a neighbouring row.

    The row has the runs `first` to `last` - 1. The neighbouring row, above or below, has the runs `other` to
    `other_last` - 1; without any, all of it is outside.
    """
    for gap in range(first + 1, last):
        if other == other_last or end[gap - 1] < start[other] or start[gap] > end[other_last - 1]:
            parent[find_root(parent, gap)] = find_root(parent, outside)


@compiled
def _join_gaps(
    start: NDArray[np.int64], end: NDArray[np.int64], first: int, middle: int, last: int, parent: NDArray[np.int64]
) -> None:
    """Join the gaps of two adjacent rows that overlap.

    The upper row has the runs `first` to `middle` - 1, the lower one `middle` to `last` - 1.
    """
    one, other = first + 1, middle + 1
    while one < middle and other < last:
        if end[one - 1] < start[other] and end[other - 1] < start[one]:
            parent[find_root(parent, one)] = find_root(parent, other)
        # Go on from the gap that ends first: it overlaps no later gap.
        if start[one] < start[other]:
            one += 1
        else:
            other += 1


@compiled
def _mark(
    contour: NDArray[np.int32],
    k: int,
    y: int,
    start: NDArray[np.int64],
    end: NDArray[np.int64],
    first: int,
    last: int,
    other: int,
    other_last: int,
    parent: NDArray[np.int64],
    outside: int,
) -> None:
    """Mark the pixels of row y with the outside directly above or below them.

    Row y has the runs `first` to `last` - 1, and the row above or below it has the runs `other` to `other_last` - 1.
    """
    gap = other
    for r in range(first, last):
        while gap < other_last and start[gap] <= start[r]:
            gap += 1
        # Gap `gap` is the first one that extends beyond the start of run r. Visit gaps from there to the end of the
        # run; the spaces before the first run (`other`) and after the last (`other_last`) are outside.
        here = gap
        while True:
            begin = end[here - 1] if here > other else -1
            stop = start[here] if here < other_last else contour.shape[1]
            if begin >= end[r]:
                break
            if here in (other, other_last) or find_root(parent, here) == find_root(parent, outside):
                for x in range(max(begin, start[r]), min(stop, end[r])):
                    contour[y, x] = k
            if here == other_last:
                break
            here += 1


@compiled
def _count_matched(
    pixels: NDArray[np.int64],
    contour: NDArray[np.int32],
    other: NDArray[np.int32],
    partner: NDArray[np.int32],
    disk: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Count the pixels of each contour, and those that have a pixel of the partner's contour within the disk.

    Args:
        pixels: int64 [L], the contour pixels as positions in the flattened image.
        contour: int32 [H, W], the contour at each pixel, -1 elsewhere.
        other: int32 [H, W], the contours of the other map.
        partner: int32 [K], the contour in `other` matched with each contour, -1 for none.
        disk: int64 [D, 2], from `_disk`.

    Returns:
        Two int64 [K]: the number of pixels, and how many of them are matched.
    """
    height, width = contour.shape
    length = np.zeros(len(partner), dtype=np.int64)
    matched = np.zeros(len(partner), dtype=np.int64)
    for pixel in pixels:
        y, x = pixel // width, pixel % width
        k = contour[y, x]
        length[k] += 1
        if partner[k] < 0:
            continue
        for d in range(len(disk)):
            v, u = y + disk[d, 0], x + disk[d, 1]
            if 0 <= v < height and 0 <= u < width and other[v, u] == partner[k]:
                matched[k] += 1
                break
    return length, matched
