"""Boundary precision, recall and F-measure of objects.

The contour of an object is compared with the contour of the object it is matched with (see `sgbd.metrics.overlap`): a
contour pixel is right if the other contour passes within a disk around it. After F. Perazzi et al., "A benchmark
dataset and evaluation methodology for video object segmentation", CVPR 2016, with the contour and the radius of the
published evaluation of unseen-object segmentation (C. Xie et al., CoRL 2019):

- the *contour* of a mask is the part of the mask that has one of its four neighbours in the mask's outside, which is
  everything that is 4-connected to beyond the image edge without crossing the mask. So it lies on the mask, it
  follows the image edge where the mask touches it, and holes (and what lies in them) have no contour;
- the disk holds the offsets with dx² + dy² <= r², r = ceil(0.003 · image diagonal) pixels, 3 for 640 x 480.

Ignored pixels belong to no mask, neither predicted nor true: both maps are cleared there, and then compared. No
contour pixel ever lies on an ignored pixel, and what is predicted there changes nothing; where two matched masks are
both cut off by the same ignored region, their contours agree along it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.compiled import compiled
from sgbd.frame import IGNORE
from sgbd.metrics.f_measure import precision_recall_f
from sgbd.metrics.label_index import as_label_map, label_index
from sgbd.metrics.overlap import Matching

RADIUS_SHARE: float = 0.003
"""Radius of the matching disk as a share of the image diagonal."""

# States of a pixel while the outside of a mask is filled: unknown, in the mask, and dealt with.
_FREE, _MASK, _STOP = 0, 1, 2


@dataclass(frozen=True)
class BoundaryScores:
    """Agreement of the contours of predicted and true objects in one frame.

    Attributes:
        precision: share (0 to 1) of the predicted objects' contour pixels that are matched.
        recall: share of the true objects' contour pixels that are matched.
        f_measure: harmonic mean of the two.
    """

    precision: float
    recall: float
    f_measure: float


@dataclass(frozen=True, eq=False)
class ContourMatch:
    """Contour pixels of the objects of one frame, and how many of them are matched.

    Attributes:
        predicted_length: int64 [P], contour pixels of each of the matching's predicted objects.
        predicted_matched: int64 [P], those near the contour of the true object it is matched with.
        true_length: int64 [Q], contour pixels of each true object.
        true_matched: int64 [Q], those near the contour of the predicted object it is matched with.
    """

    predicted_length: NDArray[np.int64]
    predicted_matched: NDArray[np.int64]
    true_length: NDArray[np.int64]
    true_matched: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ContourMap:
    """Contours of some labels of one label map, found once for however many comparisons.

    Attributes:
        labels: int64 [K], the labels that have a contour here.
        index: int32 [H, W], k on the contour of ``labels[k]``, -1 elsewhere. Masks don't overlap, so neither do
            contours.
        pixels: int64 [L], the contours' pixels as positions in the flat image, ascending.
    """

    labels: NDArray[np.int64]
    index: NDArray[np.int32]
    pixels: NDArray[np.int64]


def matching_radius(height: int, width: int) -> int:
    """Radius of the matching disk, in pixels."""
    return math.ceil(RADIUS_SHARE * math.hypot(height, width))


def contours(label_map: ArrayLike, labels: ArrayLike, truth: ArrayLike | None = None) -> ContourMap:
    """Find the contours of the masks of some labels.

    Args:
        label_map: integers [H, W].
        labels: the distinct labels [K] that have a contour.
        truth: integers [H, W], whose ignored pixels (-1) belong to no mask.

    Raises:
        ValueError: if the maps aren't integer label maps of one shape.
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
    index = _contours(mask, len(labels))
    return ContourMap(labels, index, np.flatnonzero(index >= 0))


def match_contours(
    prediction: ArrayLike | ContourMap, truth: ArrayLike | ContourMap, matching: Matching
) -> ContourMatch:
    """Match the contours of matched objects.

    Args:
        prediction: integers [H, W], predicted segment of each pixel; or the contours of the predicted objects, and
            of any others, with the ignored pixels of the truth cleared.
        truth: integers [H, W], true instance of each pixel, -1 = ignore; or the contours of the true objects.
        matching: the objects and their matches.

    Raises:
        ValueError: if the maps aren't integer label maps of one shape, or an object has no contour among those given.
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
    places = label_index(objects, found.labels)
    if (places < 0).any():
        raise ValueError(f"the contours of {name} lack the objects {objects[places < 0].tolist()}: find theirs too")
    return places


def boundary_scores(
    prediction: ArrayLike | ContourMap, truth: ArrayLike | ContourMap, matching: Matching
) -> BoundaryScores:
    """Boundary precision, recall and F-measure of one frame; arguments as of `match_contours`."""
    match = match_contours(prediction, truth, matching)
    return BoundaryScores(
        *precision_recall_f(
            int(match.predicted_matched.sum()),
            int(match.predicted_length.sum()),
            int(match.true_matched.sum()),
            int(match.true_length.sum()),
        )
    )


def _disk(radius: int) -> NDArray[np.int64]:
    """Offsets (dy, dx) within the radius [D, 2], nearest first, so that a search ends early."""
    dy, dx = np.mgrid[-radius : radius + 1, -radius : radius + 1].reshape(2, -1)
    squared = dy * dy + dx * dx
    order = np.argsort(squared, kind="stable")
    order = order[squared[order] <= radius * radius]
    return np.stack([dy[order], dx[order]], axis=1)


@compiled
def _contours(mask: NDArray[np.int32], count: int) -> NDArray[np.int32]:
    """Contour of each mask k (the pixels where `mask` is k), by filling its outside within its bounding box."""
    height, width = mask.shape
    top = np.full(count, height, dtype=np.int64)
    bottom = np.full(count, -1, dtype=np.int64)
    left = np.full(count, width, dtype=np.int64)
    right = np.full(count, -1, dtype=np.int64)
    for y in range(height):
        for x in range(width):
            k = mask[y, x]
            if k >= 0:
                top[k] = min(top[k], y)
                bottom[k] = y
                left[k] = min(left[k], x)
                right[k] = max(right[k], x)

    contour = np.full((height, width), -1, dtype=np.int32)
    for k in range(count):
        if bottom[k] < 0:
            continue
        # The box of the mask with a margin of two: one for the outside to flow around the mask, one to stop it, so that
        # neighbours in the flat array need no check.
        rows, columns = bottom[k] - top[k] + 5, right[k] - left[k] + 5
        state = np.full(rows * columns, _STOP, dtype=np.uint8)
        for y in range(rows - 2):
            for x in range(columns - 2):
                v, u = top[k] + y - 1, left[k] + x - 1
                inside = 0 < y < rows - 3 and 0 < x < columns - 3 and mask[v, u] == k
                state[(y + 1) * columns + x + 1] = _MASK if inside else _FREE
        stack = np.empty(rows * columns, dtype=np.int64)
        stack[0] = columns + 1
        state[columns + 1] = _STOP
        size = 1
        while size > 0:
            size -= 1
            here = stack[size]
            for neighbour in (here - columns, here - 1, here + 1, here + columns):
                if state[neighbour] == _FREE:
                    state[neighbour] = _STOP
                    stack[size] = neighbour
                    size += 1
                elif state[neighbour] == _MASK:
                    state[neighbour] = _STOP
                    contour[top[k] + neighbour // columns - 2, left[k] + neighbour % columns - 2] = k
    return contour


@compiled
def _count_matched(
    pixels: NDArray[np.int64],
    contour: NDArray[np.int32],
    other: NDArray[np.int32],
    partner: NDArray[np.int32],
    disk: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Length of each contour, and how many of its pixels have its partner's contour in `other` within the disk."""
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
