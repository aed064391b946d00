"""The oracle: the scores that a perfect partition of given superpixels would reach.

Every superpixel is assigned to the instance that contains most of its pixels. What the oracle misses is lost by the
over-segmentation; what a prediction misses beyond that is lost by the edge model and the partition. Majority assignment
gives the largest number of correct pixels that any labelling of these superpixels can have. For the F-measure it is the
customary bound and tight in practice, but in contrived cases another labelling can have a slightly higher F.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.frame import BACKGROUND, IGNORE
from sgbd.majority import majority_instance
from sgbd.metrics.contingency import ContingencyTable


def oracle_segments(
    superpixel: ArrayLike, instance: ArrayLike, count: ArrayLike, num_superpixels: int
) -> NDArray[np.int64]:
    """Return the majority instance of every superpixel.

    The result is a segmentation of superpixels with the labels of the ground truth: score it with
    ``ContingencyTable.from_superpixels(superpixel, instance, count, segments)`` and paint it with
    ``segments[label_map]``.

    Args:
        superpixel: int [M], superpixel of each overlap.
        instance: int [M], ground-truth instance of each overlap; -1 is left out.
        count: int [M], pixels of each overlap.
        num_superpixels: N.

    Returns:
        int64 [N], an instance for each superpixel: the one with the most pixels, on a tie the lowest label; 0 for
        superpixels that lie entirely in ignored pixels.
    """
    superpixel, instance, count = np.asarray(superpixel), np.asarray(instance), np.asarray(count)
    known = instance >= 0
    majority = majority_instance(superpixel[known], instance[known], count[known], num_superpixels)
    return np.where(majority == IGNORE, BACKGROUND, majority)


def oracle_table(
    superpixel: ArrayLike, instance: ArrayLike, count: ArrayLike, num_superpixels: int
) -> ContingencyTable:
    """Return the contingency table of the oracle's segments and the ground truth; arguments as in `oracle_segments`."""
    segments = oracle_segments(superpixel, instance, count, num_superpixels)
    return ContingencyTable.from_superpixels(superpixel, instance, count, segments)
