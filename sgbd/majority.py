"""The majority instance of a superpixel, which defines its training label and its segment in the oracle partition."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.frame import IGNORE


def majority_instance(
    superpixel: npt.NDArray[np.integer],
    instance: npt.NDArray[np.integer],
    count: npt.NDArray[np.integer],
    nodes: int,
) -> npt.NDArray[np.int64]:
    """Return the instance with the most pixels in each superpixel.

    Args:
        superpixel: int [M], superpixel of each overlap.
        instance: int [M], ground-truth instance of each overlap, not negative.
        count: int [M], number of pixels in each overlap.
        nodes: Number N of superpixels.

    Returns:
        int64 [N]; ties go to the smallest id; -1 if all pixels of a superpixel are ignored.
    """
    majority = np.full(nodes, IGNORE, np.int64)
    order = np.lexsort((-instance.astype(np.int64), count, superpixel))
    # The last assignment to a superpixel wins: the one with the largest count and the smallest id.
    majority[superpixel[order]] = instance[order]
    return majority


def labeled_instance(
    superpixel: npt.NDArray[np.integer],
    instance: npt.NDArray[np.integer],
    count: npt.NDArray[np.integer],
    area: npt.NDArray[np.integer],
) -> npt.NDArray[np.int64]:
    """Return the instance of each superpixel for training: none if more than half of its pixels are ignored.

    The oracle may assign such a superpixel by its few known pixels, because only known pixels are scored. For training
    this label could be wrong: the network sees the whole superpixel, most of which may be something else.

    Args:
        superpixel, instance, count: As in `majority_instance`, without ignored pixels.
        area: int [N], number of all pixels of each superpixel.

    Returns:
        int64 [N], as in `majority_instance`, but -1 if more than half of a superpixel's pixels are ignored.
    """
    known = np.bincount(superpixel, count, len(area))
    return np.where(2 * known < area, IGNORE, majority_instance(superpixel, instance, count, len(area)))
