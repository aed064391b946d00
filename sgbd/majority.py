"""The majority instance of a superpixel, which defines its training label and its place in the oracle."""

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
    """Return the instance with most pixels in each superpixel.

    Args:
        superpixel: int [M], superpixel of each overlap.
        instance: int [M], true instance of each overlap, not negative.
        count: int [M], pixels of each overlap.
        nodes: Number of superpixels.

    Returns:
        int64 [N]; of several instances with as many pixels the smallest id; -1 for a superpixel of ignored pixels.
    """
    majority = np.full(nodes, IGNORE, np.int64)
    order = np.lexsort((-instance.astype(np.int64), count, superpixel))
    # Of the assignments to one superpixel the last stays: the largest count, the smallest id.
    majority[superpixel[order]] = instance[order]
    return majority


def labeled_instance(
    superpixel: npt.NDArray[np.integer],
    instance: npt.NDArray[np.integer],
    count: npt.NDArray[np.integer],
    area: npt.NDArray[np.integer],
) -> npt.NDArray[np.int64]:
    """Return the instance of each superpixel for training: none where most of its pixels are ignored.

    The oracle may give such a superpixel to the little that is known of it, because only known pixels are scored. To a
    network it would be a wrong answer: it sees the whole superpixel, most of which may be something else.

    Args:
        superpixel, instance, count: As in `majority_instance`; ignored pixels are not among them.
        area: int [N], all pixels of each superpixel.

    Returns:
        int64 [N], as in `majority_instance`; -1 also for superpixels more than half of whose pixels are ignored.
    """
    known = np.bincount(superpixel, count, len(area))
    return np.where(2 * known < area, IGNORE, majority_instance(superpixel, instance, count, len(area)))
