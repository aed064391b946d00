"""The instance that most of a superpixel belongs to: its label in training, and where the oracle puts it."""

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
