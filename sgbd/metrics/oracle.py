"""The oracle: what a perfect partition of given superpixels would reach.

Every superpixel goes to the instance that most of its pixels belong to. What the oracle misses is lost by the
over-segmentation, what a prediction misses beyond it by the edge model and the partition. Majority assignment gives
the most correct pixels that any labelling of these superpixels can have; for the F-measure it is the customary bound,
and tight in practice, but on made-up cases another labelling can have a slightly higher F.
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
    """The majority instance of every superpixel.

    As a segmentation of superpixels it is labelled like the truth: score it with
    ``ContingencyTable.from_superpixels(superpixel, instance, count, segments)`` and paint it with
    ``segments[label_map]``.

    Args:
        superpixel: int [M], superpixel of each overlap.
        instance: int [M], true instance of each overlap; -1 is left out.
        count: int [M], pixels of each overlap.
        num_superpixels: N.

    Returns:
        int64 [N], a true instance for each superpixel: the one with the most pixels, of equals the lowest label; 0 for
        superpixels that lie wholly in ignored pixels.
    """
    superpixel, instance, count = np.asarray(superpixel), np.asarray(instance), np.asarray(count)
    known = instance >= 0
    majority = majority_instance(superpixel[known], instance[known], count[known], num_superpixels)
    return np.where(majority == IGNORE, BACKGROUND, majority)


def oracle_table(
    superpixel: ArrayLike, instance: ArrayLike, count: ArrayLike, num_superpixels: int
) -> ContingencyTable:
    """The contingency table of the oracle's segments and the truth; arguments as for `oracle_segments`."""
    segments = oracle_segments(superpixel, instance, count, num_superpixels)
    return ContingencyTable.from_superpixels(superpixel, instance, count, segments)
