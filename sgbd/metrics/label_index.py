"""Translation of the labels of an image into positions in a list of labels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.machine.compiled import compiled

# In a wider range labels are searched instead of looked up in a table.
_LONGEST_TABLE = 1 << 20

# And so are so few of them: a table for them takes longer.
_FEW = 1 << 8


def as_label_map(label_map: ArrayLike, name: str, lowest: int = 0) -> NDArray[np.integer]:
    """Check a label map.

    Args:
        label_map: Integers [H, W].
        name: What to call it in an error.
        lowest: The lowest label that is allowed.

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
    """The labels that occur in an array, each once, in ascending order."""
    if label_map.size == 0:
        return np.empty(0, dtype=np.int64)
    lowest, highest = int(label_map.min()), int(label_map.max())
    if not _fits_table(lowest, highest):
        return np.unique(label_map).astype(np.int64)
    return np.flatnonzero(_occurring(_flat(label_map), lowest, highest)) + lowest


def label_index(label_map: NDArray[np.integer], labels: ArrayLike) -> NDArray[np.int32]:
    """The position of every label in a list of labels.

    Args:
        label_map: Labels, of any shape.
        labels: Distinct labels [K], in any order.

    Returns:
        int32 of the shape of `label_map`: k where it holds ``labels[k]``, -1 where it holds none of them.
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
    return highest - lowest < _LONGEST_TABLE and -(1 << 31) <= lowest <= highest < 1 << 31


def _flat(label_map: NDArray[np.integer]) -> NDArray[np.int32]:
    # One type of input means one compilation of what follows, whatever type of integer the caller has.
    return label_map.ravel().astype(np.int32, copy=False)


@compiled
def _occurring(labels: NDArray[np.int32], lowest: int, highest: int) -> NDArray[np.bool_]:
    """Whether each label from `lowest` to `highest` occurs."""
    occurs = np.zeros(highest - lowest + 1, dtype=np.bool_)
    for label in labels:
        occurs[label - lowest] = True
    return occurs


@compiled
def _translated(labels: NDArray[np.int32], lowest: int, table: NDArray[np.int32]) -> NDArray[np.int32]:
    """What the table, which begins with the label `lowest`, holds for each label."""
    translation = np.empty(labels.shape, dtype=np.int32)
    for i in range(labels.size):
        translation[i] = table[labels[i] - lowest]
    return translation
