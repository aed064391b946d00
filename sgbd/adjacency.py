"""Region adjacency: the pairs of neighbouring superpixels in a label map."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

LabelMap = npt.NDArray[np.int32]
Pairs = npt.NDArray[np.int64]

Adjacency = Callable[[LabelMap], Pairs]
"""Maps a label map int32 [H, W] with ids 0..N-1 to pairs int64 [2, E], each once, i < j, in lexicographic order."""


def checked_pairs(found: npt.ArrayLike, count: int) -> Pairs:
    """Check the pairs of a user-defined adjacency, whose mistakes would otherwise give wrong features silently.

    Args:
        found: What the adjacency returned; the order of the pairs does not matter.
        count: Number N of superpixels.

    Returns:
        int64 [2, E].

    Raises:
        ValueError: If these are not integers [2, E] with 0 <= i < j < N, each pair once.
    """
    pairs = np.asarray(found)
    if pairs.ndim != 2 or pairs.shape[0] != 2 or not (np.issubdtype(pairs.dtype, np.integer) or pairs.size == 0):
        raise ValueError(
            f"an adjacency must give pairs of superpixels, integers of shape [2, E]; got {pairs.dtype} of shape "
            f"{list(pairs.shape)}"
        )
    pairs = pairs.astype(np.int64, copy=False)
    i, j = pairs
    wrong = np.flatnonzero((i < 0) | (i >= j) | (j >= count))
    if wrong.size:
        raise ValueError(
            f"an adjacency must give pairs (i, j) of the superpixels 0 to {count - 1} with i < j; got "
            f"({i[wrong[0]]}, {j[wrong[0]]})"
        )
    keys, occurrences = np.unique(i * count + j, return_counts=True)
    if len(keys) < len(i):
        twice = int(keys[occurrences > 1][0])
        raise ValueError(f"an adjacency must give every pair once; got {divmod(twice, count)} several times")
    return pairs


def border_pairs(label_map: LabelMap) -> Pairs:
    """Find the pairs of superpixels that share a border (4-connected neighbours in the image).

    Args:
        label_map: int32 [H, W], ids 0..N-1.

    Returns:
        int64 [2, E], i < j, sorted.
    """
    return border_lengths(label_map)[0]


def border_lengths(label_map: LabelMap) -> tuple[Pairs, npt.NDArray[np.int64]]:
    """Find the pairs of superpixels that share a border, and the length of each border.

    Args:
        label_map: int32 [H, W], ids 0..N-1.

    Returns:
        Pairs int64 [2, E] as in `border_pairs`, and border lengths int64 [E]: the number of horizontally or vertically
        adjacent pixel pairs that the border separates.
    """
    count = int(label_map.max(initial=-1)) + 1
    keys = []
    for first, second in (
        (label_map[:, :-1], label_map[:, 1:]),
        (label_map[:-1, :], label_map[1:, :]),
    ):
        different = first != second
        a, b = first[different].astype(np.int64), second[different].astype(np.int64)
        keys.append(np.minimum(a, b) * count + np.maximum(a, b))
    unique, lengths = np.unique(np.concatenate(keys), return_counts=True)
    return np.stack([unique // max(count, 1), unique % max(count, 1)]), lengths


def bounding_box_pairs(label_map: LabelMap) -> Pairs:
    """Find the pairs of superpixels whose bounding boxes touch or overlap, like the implementation of SupeRGB-D.

    About a third of these pairs share no border. This adjacency exists to reproduce the paper (arXiv 2212.11922).

    Args:
        label_map: int32 [H, W], ids 0..N-1.

    Returns:
        int64 [2, E], i < j, sorted.
    """
    count = int(label_map.max(initial=-1)) + 1
    flat = label_map.ravel()
    top, left = np.full(count, label_map.shape[0]), np.full(count, label_map.shape[1])
    bottom, right = np.full(count, -1), np.full(count, -1)
    rows, columns = np.divmod(np.arange(flat.size), label_map.shape[1])
    for extreme, values, ufunc in (
        (top, rows, np.minimum),
        (left, columns, np.minimum),
        (bottom, rows, np.maximum),
        (right, columns, np.maximum),
    ):
        ufunc.at(extreme, flat, values)
    # Bounds are inclusive: boxes touch if one starts at most one pixel after the other ends.
    touch = (
        (top[:, None] <= bottom + 1)
        & (top <= bottom[:, None] + 1)
        & (left[:, None] <= right + 1)
        & (left <= right[:, None] + 1)
    )
    return np.stack(np.nonzero(np.triu(touch, k=1))).astype(np.int64)
