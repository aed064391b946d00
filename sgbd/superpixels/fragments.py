"""Connection of an intersection and merging of its fragments, in one compiled pass over the pixels.

The same result as `connect.merge_fragments(connect.connected_regions(connect.intersect(first, second)), min_size)`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.compiled import compiled

# What is known of a piece: its pixels, and the box around them (the last row and column are inside).
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
    pieces, parents, facts = _pieces(first, second)
    names = _merge(pieces, parents, facts, min_size)
    result: LabelMap = names[pieces]
    return result


@compiled
def _pieces(first, second):  # type: ignore[no-untyped-def]
    """Number the pieces in raster order; two that turn out to be connected are joined in `parents`."""
    height, width = first.shape
    pieces = np.empty((height, width), np.int32)
    parents = np.empty(height * width, np.int32)
    facts = np.empty((height * width, 5), np.int32)
    count = 0
    for row in range(height):
        column = 0
        while column < width:
            one, two = first[row, column], second[row, column]
            start, piece, last_above = column, -1, -1
            # Follow the run of pixels that are alike, and join it with what is alike above it.
            while column < width and first[row, column] == one and second[row, column] == two:
                if row > 0 and first[row - 1, column] == one and second[row - 1, column] == two:
                    above = pieces[row - 1, column]
                    if above != last_above:
                        last_above = above
                        piece = _root(parents, above) if piece < 0 else _join(parents, piece, above)
                column += 1
            if piece < 0:
                piece = count
                parents[piece] = piece
                facts[piece, PIXELS], facts[piece, TOP] = 0, row
                facts[piece, LEFT], facts[piece, RIGHT] = start, column - 1
                count += 1
            pieces[row, start:column] = piece
            fact = facts[piece]
            fact[PIXELS] += column - start
            fact[BOTTOM] = row
            fact[LEFT] = min(fact[LEFT], start)
            fact[RIGHT] = max(fact[RIGHT], column - 1)
    return pieces, parents[:count], facts[:count]


@compiled
def _merge(pieces, parents, facts, min_size):  # type: ignore[no-untyped-def]
    """Merge fragments in rounds, as `connect.merge_fragments` does, and number what is left in raster order."""
    height, width = pieces.shape
    count = len(parents)
    group = np.empty(count, np.int32)
    choice = np.empty(count, np.int32)
    border = np.zeros(count, np.int32)
    met = np.empty(count, np.int32)
    while True:
        # Roots are the first of their group, so that parents come before children.
        groups = 0
        for piece in range(count):
            root = _root(parents, piece)
            group[piece] = root
            if root == piece:
                groups += 1
            elif facts[piece, PIXELS] > 0:
                fact, whole = facts[piece], facts[root]
                whole[PIXELS] += fact[PIXELS]
                whole[TOP], whole[BOTTOM] = min(whole[TOP], fact[TOP]), max(whole[BOTTOM], fact[BOTTOM])
                whole[LEFT], whole[RIGHT] = min(whole[LEFT], fact[LEFT]), max(whole[RIGHT], fact[RIGHT])
                fact[PIXELS] = 0
        fragments = 0
        for piece in range(count):
            if group[piece] != piece or facts[piece, PIXELS] >= min_size or groups == 1:
                continue
            fact = facts[piece]
            neighbours = 0
            for row in range(fact[TOP], fact[BOTTOM] + 1):
                for column in range(fact[LEFT], fact[RIGHT] + 1):
                    if group[pieces[row, column]] != piece:
                        continue
                    for side in range(4):
                        r = row + (side == 1) - (side == 0)
                        c = column + (side == 3) - (side == 2)
                        if 0 <= r < height and 0 <= c < width:
                            other = group[pieces[r, c]]
                            if other != piece:
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
            choice[fragments] = best
            fragments += 1
        if fragments == 0:
            break
        # All of a round choose before any is merged: the order in which they are looked at changes nothing.
        k = 0
        for piece in range(count):
            if group[piece] == piece and facts[piece, PIXELS] < min_size:
                _join(parents, piece, choice[k])
                k += 1
    names = np.empty(count, np.int32)
    name = 0
    for piece in range(count):
        if group[piece] == piece:
            names[piece] = name
            name += 1
        else:
            names[piece] = names[group[piece]]
    return names


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
    first, second = min(one, other), max(one, other)
    parents[second] = first
    return first
