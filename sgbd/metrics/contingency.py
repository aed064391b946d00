"""The contingency table of a segmentation and the ground truth: how many pixels each segment shares with each instance.

Every overlap and clustering score is a function of this table alone. If segments are unions of superpixels, the table
follows from the overlaps of superpixels and instances, without reading the pixels again. Pixels with unknown ground
truth (`sgbd.frame.IGNORE`) are left out of every count, on both sides.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.frame import IGNORE
from sgbd.machine.compiled import compiled
from sgbd.metrics.label_index import as_label_map, distinct_labels, label_index


@dataclass(frozen=True, eq=False)
class ContingencyTable:
    """Pixel counts shared by segments and instances, without the ignored pixels.

    Attributes:
        segments: int64 [S], labels of the predicted segments that contain a pixel of known ground truth, ascending.
        instances: int64 [T], labels of the ground-truth instances (0 background, 1 supporting surface, 2+ objects),
            ascending.
        counts: int64 [S, T], number of pixels in both.
    """

    segments: NDArray[np.int64]
    instances: NDArray[np.int64]
    counts: NDArray[np.int64]

    def __post_init__(self) -> None:
        if self.counts.shape != (len(self.segments), len(self.instances)):
            raise ValueError(
                f"counts must have shape [{len(self.segments)}, {len(self.instances)}] for {len(self.segments)} "
                f"segments and {len(self.instances)} instances, got {list(self.counts.shape)}"
            )

    @classmethod
    def from_label_maps(cls, prediction: ArrayLike, truth: ArrayLike) -> ContingencyTable:
        """Count the pixels of two label maps.

        Args:
            prediction: Integers [H, W], predicted segment of each pixel, not negative.
            truth: Integers [H, W], ground-truth instance of each pixel, -1 = ignore.

        Raises:
            ValueError: If the maps aren't integer label maps of one shape or hold labels that are too low.
        """
        prediction = as_label_map(prediction, "the prediction")
        truth = as_label_map(truth, "the truth", lowest=IGNORE)
        if prediction.shape != truth.shape:
            raise ValueError(
                f"prediction and truth must have one shape, got {list(prediction.shape)} and {list(truth.shape)}: "
                "resize the prediction (nearest neighbour) to the frame it was made from"
            )
        segments, instances = distinct_labels(prediction), distinct_labels(truth)
        row, column = label_index(prediction, segments), label_index(truth, instances)
        counts = _count_pixels(row.ravel(), column.ravel(), len(segments), len(instances))
        return cls._of_known(segments, instances, counts)

    @classmethod
    def from_superpixels(
        cls, superpixel: ArrayLike, instance: ArrayLike, count: ArrayLike, segment: ArrayLike
    ) -> ContingencyTable:
        """Sum the overlaps of superpixels with instances; the result equals counting the painted label map.

        Args:
            superpixel: int [M], superpixel of each overlap.
            instance: int [M], ground-truth instance of each overlap; -1 is left out.
            count: int [M], pixels of each overlap.
            segment: int [N], segment of each superpixel, not negative.

        Raises:
            ValueError: If the lengths differ, a superpixel has no segment or a segment is negative.
        """
        superpixel, instance = np.asarray(superpixel), np.asarray(instance)
        count, segment = np.asarray(count), np.asarray(segment)
        if not superpixel.shape == instance.shape == count.shape or superpixel.ndim != 1:
            raise ValueError(
                "superpixel, instance and count of the overlaps must have one length, got shapes "
                f"{list(superpixel.shape)}, {list(instance.shape)} and {list(count.shape)}"
            )
        if superpixel.size and not 0 <= superpixel.min() <= superpixel.max() < len(segment):
            raise ValueError(
                f"overlaps name superpixels {superpixel.min()} to {superpixel.max()}, but there are segments for "
                f"superpixels 0 to {len(segment) - 1}: both must come from one over-segmentation"
            )
        if segment.size and segment.min() < 0:
            raise ValueError(f"segments must not be negative, got {segment.min()}")
        of_overlap = segment[superpixel]
        segments, instances = distinct_labels(of_overlap), distinct_labels(instance)
        row, column = label_index(of_overlap, segments), label_index(instance, instances)
        shape = len(segments), len(instances)
        # bincount sums in float64, which is exact for pixel counts far below 2^53.
        counts = np.bincount(row * shape[1] + column, count, shape[0] * shape[1]).astype(np.int64).reshape(shape)
        return cls._of_known(segments, instances, counts)

    @classmethod
    def _of_known(
        cls, segments: NDArray[np.int64], instances: NDArray[np.int64], counts: NDArray[np.int64]
    ) -> ContingencyTable:
        """Build a table without the ignored pixels, and without labels that have no pixel left."""
        counts = np.where(instances == IGNORE, 0, counts)
        row, column = counts.any(axis=1), counts.any(axis=0)
        return cls(segments[row], instances[column], counts[row][:, column])

    @cached_property
    def segment_area(self) -> NDArray[np.int64]:
        """Pixels of known ground truth in each segment, int64 [S]."""
        return self.counts.sum(axis=1)

    @cached_property
    def instance_area(self) -> NDArray[np.int64]:
        """Pixels of each instance, int64 [T]."""
        return self.counts.sum(axis=0)

    @property
    def total(self) -> int:
        """Number of pixels of known ground truth."""
        return int(self.counts.sum())


@compiled
def _count_pixels(row: NDArray[np.int32], column: NDArray[np.int32], rows: int, columns: int) -> NDArray[np.int64]:
    """Return the two-dimensional histogram of pairs, int64 [rows, columns]."""
    counts = np.zeros((rows, columns), dtype=np.int64)
    for i in range(row.size):
        counts[row[i], column[i]] += 1
    return counts
