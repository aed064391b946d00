"""Map the labels of an image to their positions in a list of labels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.machine.compiled import compiled

# If labels span a wider range than this, they are searched in a sorted list instead of looked up in a table.
_LONGEST_TABLE = 1 << 20

# So are label maps of at most this many pixels, for which building a table takes longer.
_FEW = 1 << 8


def as_label_map(label_map: ArrayLike, name: str, lowest: int = 0) -> NDArray[np.integer]:
    """Check a label map, and return it as an array.

    Args:
        label_map: Integers [H, W].
        name: How to call it in an error message.
        lowest: Lowest allowed label.

    Raises:
        ValueError: If it isn't a two-dimensional array of integers, or holds a label below `lowest`.
    """
    array = np.asarray(label_map)
    if array.ndim != 2 or not np.issubdtype(array.dtype, np.integer):
        raise ValueError(
            f"{name} must be an integer label map of shape [H, W], got {array.dtype} of shape {list(array.shape)}"
        )
    if array.size and array.min() < lowest:
        raise ValueError(f"labels of {name} must be at least {lowest}, got {array.min()}")
    return array


def distinct_labels(label_map: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return the distinct labels of an array in ascending order."""
    if label_map.size == 0:
        return np.empty(0, dtype=np.int64)
    lowest, highest = int(label_map.min()), int(label_map.max())
    if not _fits_table(lowest, highest):
        return np.unique(label_map).astype(np.int64)
    return np.flatnonzero(_occurring(_flat(label_map), lowest, highest)) + lowest


def label_index(label_map: NDArray[np.integer], labels: ArrayLike) -> NDArray[np.int32]:
    """Return the position of every label in a list of labels.

    Args:
        label_map: Labels, of any shape.
        labels: Distinct labels [K], in any order.

    Returns:
        int32 of the shape of `label_map`: k where the label is ``labels[k]``, -1 where it is not in the list.
    """
    labels = np.asarray(labels, dtype=np.int64)
    if label_map.size == 0 or labels.size == 0:
        return np.full(label_map.shape, -1, dtype=np.int32)
    if label_map.size > _FEW:
        lowest, highest = int(label_map.min()), int(label_map.max())
        if _fits_table(lowest, highest):
            table = np.full(highest - lowest + 1, -1, dtype=np.int32)
            inside = np.flatnonzero((labels >= lowest) & (labels <= highest))
            table[labels[inside] - lowest] = inside
            return _translated(_flat(label_map), lowest, table).reshape(label_map.shape)
    order = np.argsort(labels)
    ascending = labels[order]
    position = np.minimum(np.searchsorted(ascending, label_map), len(labels) - 1)
    return np.where(ascending[position] == label_map, order[position], -1).astype(np.int32)


def _fits_table(lowest: int, highest: int) -> bool:
    """Return whether a table over this range of labels is small enough, and all labels fit into int32."""
    return highest - lowest < _LONGEST_TABLE and -(1 << 31) <= lowest <= highest < 1 << 31


def _flat(label_map: NDArray[np.integer]) -> NDArray[np.int32]:
    """Return the labels as a flat int32 array: with a single dtype, the functions below are compiled only once."""
    return label_map.ravel().astype(np.int32, copy=False)


@compiled
def _occurring(labels: NDArray[np.int32], lowest: int, highest: int) -> NDArray[np.bool_]:
    """Return whether each label from `lowest` to `highest` occurs, bool [highest - lowest + 1]."""
    occurs = np.zeros(highest - lowest + 1, dtype=np.bool_)
    for label in labels:
        occurs[label - lowest] = True
    return occurs


@compiled
def _translated(labels: NDArray[np.int32], lowest: int, table: NDArray[np.int32]) -> NDArray[np.int32]:
    """Look up each label in a table whose first entry belongs to the label `lowest`."""
    translation = np.empty(labels.shape, dtype=np.int32)
    for i in range(labels.size):
        translation[i] = table[labels[i] - lowest]
    return translation
