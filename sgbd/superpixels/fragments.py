"""Connection of an intersection and merging of its fragments, in one compiled pass over the pixels.

The same result as `connect.merge_fragments(connect.connected_regions(connect.intersect(first, second)), min_size)`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.compiled import compiled

# What is known of a group of pieces: its pixels, and the box around them, the last row and column inside.
PIXELS, TOP, BOTTOM, LEFT, RIGHT = range(5)


def connected_superpixels(first: npt.NDArray[np.int32], second: npt.NDArray[np.int32], min_size: int) -> LabelMap:
    """Intersect two over-segmentations, connect the result and merge its fragments.

    One pass finds the pieces by union-find, with their areas and boxes. Fragments are small, so that their borders are
    then looked up in their boxes alone, and the image is not passed over again until the superpixels are painted.

    Args:
        first: int32 [H, W], any ids.
        second: int32 [H, W], any ids.
        min_size: Pixels a superpixel needs to stay.

    Returns:
        int32 [H, W], ids 0..N-1 in raster order of their first pixel, each one 4-connected region.
    """
    pieces = np.empty(first.shape, np.int32)
    # There are as many pieces as pixels at the most; memory that is never written to costs nothing.
    parents = np.empty(first.size, np.int64)
    facts = np.empty((first.size, 5), np.int64)
    count = _find_pieces(first, second, pieces, parents, facts)
    parents, facts = parents[:count], facts[:count]
    groups = np.empty(count, np.int64)
    while True:
        _gather(parents, facts, groups)
        roots = np.flatnonzero(groups == np.arange(count))
        fragments = roots[facts[roots, PIXELS] < min_size]
        if len(fragments) == 0 or len(roots) == 1:
            break
        _merge_round(pieces, groups, facts, fragments, parents, np.empty_like(groups), np.zeros_like(groups))
    # A root is the first of its group in raster order.
    _paint(np.searchsorted(roots, groups).astype(np.int32), pieces)
    return pieces


@compiled
def _find_pieces(first, second, pieces, parents, facts):  # type: ignore[no-untyped-def]
    """Number the pieces in raster order; where two turn out to be connected, join them in `parents`."""
    height, width = first.shape
    count = np.int64(0)
    for row in range(height):
        column = 0
        while column < width:
            # Follow the run of pixels that are alike, and join it with what is alike above it.
            start, piece, last_above = column, count, count
            one, two = first[row, column], second[row, column]
            while column < width and first[row, column] == one and second[row, column] == two:
                if row > 0 and first[row - 1, column] == one and second[row - 1, column] == two:
                    above = np.int64(pieces[row - 1, column])
                    if above != last_above:
                        last_above = above
                        piece = _root(parents, above) if piece == count else _join(parents, piece, above)
                column += 1
            if piece == count:
                count += 1
                parents[piece] = piece
                facts[piece, PIXELS] = 0
                facts[piece, TOP] = row
                facts[piece, LEFT] = start
                facts[piece, RIGHT] = column - 1
            fact = facts[piece]
            fact[PIXELS] += column - start
            fact[BOTTOM] = row
            if start < fact[LEFT]:
                fact[LEFT] = start
            if column - 1 > fact[RIGHT]:
                fact[RIGHT] = column - 1
            for k in range(start, column):
                pieces[row, k] = piece
    return count


@compiled
def _gather(parents, facts, groups):  # type: ignore[no-untyped-def]
    """Name every piece by the root of its group, and bring what is known of the pieces together there."""
    for piece in range(len(parents)):
        root = _root(parents, piece)
        groups[piece] = root
        fact, whole = facts[piece], facts[root]
        if root != piece and fact[PIXELS] > 0:
            whole[PIXELS] += fact[PIXELS]
            fact[PIXELS] = 0
            for k in (TOP, LEFT):
                if fact[k] < whole[k]:
                    whole[k] = fact[k]
            for k in (BOTTOM, RIGHT):
                if fact[k] > whole[k]:
                    whole[k] = fact[k]


@compiled
def _merge_round(pieces, groups, facts, fragments, parents, met, border):  # type: ignore[no-untyped-def]
    """Join every fragment with the neighbour with the longest border.

    All of a round look at the groups as they were before it, so that their order changes nothing.

    Args:
        pieces: int32 [H, W].
        groups: int64 [count], the root of each piece before the round.
        facts: int64 [count, 5], of each root.
        fragments: int64 [F], roots.
        parents: int64 [count], written.
        met: int64 [count] to work in.
        border: int64 [count] of zeros to work in; zeros again at the end.
    """
    height, width = pieces.shape
    for fragment in fragments:
        fact = facts[fragment]
        neighbours = 0
        for row in range(fact[TOP], fact[BOTTOM] + 1):
            for column in range(fact[LEFT], fact[RIGHT] + 1):
                if groups[pieces[row, column]] != fragment:
                    continue
                for side in range(4):
                    # Above, below, left and right.
                    r = row + (side == 1) - (side == 0)
                    c = column + (side == 3) - (side == 2)
                    if r < 0 or r >= height or c < 0 or c >= width:
                        continue
                    other = groups[pieces[r, c]]
                    if other != fragment:
                        if border[other] == 0:
                            met[neighbours] = other
                            neighbours += 1
                        border[other] += 1
        best = met[0]
        for k in range(1, neighbours):
            other = met[k]
            longer = border[other] - border[best]
            larger = facts[other, PIXELS] - facts[best, PIXELS]
            if longer > 0 or (longer == 0 and (larger > 0 or (larger == 0 and other < best))):
                best = other
        for k in range(neighbours):
            border[met[k]] = 0
        _join(parents, fragment, best)


@compiled
def _paint(names, pieces):  # type: ignore[no-untyped-def]
    for row in range(pieces.shape[0]):
        for column in range(pieces.shape[1]):
            pieces[row, column] = names[pieces[row, column]]


@compiled
def _root(parents, piece):  # type: ignore[no-untyped-def]
    while parents[piece] != piece:
        parents[piece] = parents[parents[piece]]
        piece = parents[piece]
    return piece


@compiled
def _join(parents, one, other):  # type: ignore[no-untyped-def]
    """Join two groups under the root that comes first in raster order, and return it."""
    one, other = _root(parents, one), _root(parents, other)
    if other < one:
        one, other = other, one
    parents[other] = one
    return one
