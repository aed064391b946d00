"""Connection of an intersection and merging of its fragments, in one compiled pass over the pixels.

Without Numba the functions of `sgbd.superpixels.connect` do it, a step at a time, with the same result.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.machine.compiled import HAS_NUMBA, compiled
from sgbd.machine.union_find import find_root
from sgbd.repaint import repaint
from sgbd.superpixels.connect import connected_regions, intersect, merge_fragments

# What is known of a group of pieces: its pixels, and the box around them, the last row and column inside.
PIXELS, TOP, BOTTOM, LEFT, RIGHT = range(5)

PIXELS_A_PIECE, FEW_PIECES = 16, 1024
"""Room is made for a piece in so many pixels, and for so many pieces at the least; where they are more, for more."""


def connected_superpixels(first: npt.NDArray[np.int32], second: npt.NDArray[np.int32], min_size: int) -> LabelMap:
    """Intersect two over-segmentations, connect the result and merge its fragments.

    Fragments go to the neighbour with the longest border. One pass finds the pieces by union-find, with their areas and
    boxes. Fragments are small, so that their borders are then looked up in their boxes alone, and the image is not
    passed over again until the superpixels are painted.

    Args:
        first: int32 [H, W], any ids.
        second: int32 [H, W], any ids.
        min_size: Pixels a superpixel needs to stay.

    Returns:
        int32 [H, W], ids 0..N-1 in raster order of their first pixel, each one 4-connected region.
    """
    if not HAS_NUMBA:
        return merge_fragments(connected_regions(intersect(first, second)), min_size)
    pieces = np.empty(first.shape, np.int32)
    limit = min(first.size, max(FEW_PIECES, first.size // PIXELS_A_PIECE))
    runs = np.empty((2, 2, first.shape[1] + 1), np.int64)
    while True:
        parents, facts = np.empty(limit, np.int64), np.empty((limit, 5), np.int64)
        count = _find_pieces(first, second, runs, pieces, parents, facts)
        if count <= limit:
            break
        limit = min(first.size, 4 * limit)
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
    return repaint(pieces, np.searchsorted(roots, groups))


@compiled
def _find_pieces(first, second, runs, pieces, parents, facts):  # type: ignore[no-untyped-def]
    """Number the pieces in raster order; where two turn out to be connected, join them in `parents`.

    Args:
        first: int32 [H, W].
        second: int32 [H, W].
        runs: int64 [2, 2, W + 1] to work in: of two rows by turns, the runs of pixels that are alike, where each ends
            and its piece.
        pieces: int32 [H, W], written.
        parents: int64 [limit], written.
        facts: int64 [limit, 5], written.

    Returns:
        The number of pieces; one above the limit says that they did not fit.
    """
    height, width = first.shape
    count, limit = np.int64(0), len(parents)
    runs_above = np.int64(0)
    for row in range(height):
        ends, numbers = runs[row & 1, 0], runs[row & 1, 1]
        ends_above, numbers_above = runs[1 - (row & 1), 0], runs[1 - (row & 1), 1]
        # Found without a branch: where the next pixel is another.
        found = np.int64(0)
        ones, twos = first[row], second[row]
        for column in range(width - 1):
            ends[found] = column + 1
            found += (ones[column] != ones[column + 1]) | (twos[column] != twos[column + 1])
        ends[found] = width
        found += 1
        start, above = np.int64(0), np.int64(0)
        for run in range(found):
            end, piece = ends[run], count
            one, two = ones[start], twos[start]
            # Join it with what is alike above it; the last run above may go on above the next one, too.
            while above < runs_above:
                begin = start if above == 0 or ends_above[above - 1] < start else ends_above[above - 1]
                if first[row - 1, begin] == one and second[row - 1, begin] == two:
                    other = numbers_above[above]
                    piece = find_root(parents, other) if piece == count else _join(parents, piece, other)
                last_of_run = ends_above[above] >= end
                above += ends_above[above] <= end
                if last_of_run:
                    break
            if piece == count:
                if count == limit:
                    return limit + 1
                count += 1
                parents[piece] = piece
                facts[piece, PIXELS] = 0
                facts[piece, TOP] = row
                facts[piece, LEFT] = facts[piece, RIGHT] = start
            fact = facts[piece]
            fact[PIXELS] += end - start
            fact[BOTTOM] = row
            if start < fact[LEFT]:
                fact[LEFT] = start
            if end - 1 > fact[RIGHT]:
                fact[RIGHT] = end - 1
            for k in range(start, end):
                pieces[row, k] = piece
            numbers[run] = piece
            start = end
        runs_above = found
    return count


@compiled
def _gather(parents, facts, groups):  # type: ignore[no-untyped-def]
    """Name every piece by the root of its group, and bring what is known of the pieces together there."""
    for piece in range(len(parents)):
        root = find_root(parents, piece)
        groups[piece] = root
        if root != piece and facts[piece, PIXELS] > 0:
            fact, whole = facts[piece], facts[root]
            whole[PIXELS] += fact[PIXELS]
            fact[PIXELS] = 0
            for edge in (TOP, LEFT):
                whole[edge] = fact[edge] if fact[edge] < whole[edge] else whole[edge]
            for edge in (BOTTOM, RIGHT):
                whole[edge] = fact[edge] if fact[edge] > whole[edge] else whole[edge]


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
        neighbors = 0
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
                            met[neighbors] = other
                            neighbors += 1
                        border[other] += 1
        best = met[0]
        for k in range(1, neighbors):
            other = met[k]
            longer = border[other] - border[best]
            larger = facts[other, PIXELS] - facts[best, PIXELS]
            if longer > 0 or (longer == 0 and (larger > 0 or (larger == 0 and other < best))):
                best = other
        for k in range(neighbors):
            border[met[k]] = 0
        _join(parents, fragment, best)


@compiled
def _join(parents, one, other):  # type: ignore[no-untyped-def]
    """Join two groups under the root that comes first in raster order, and return it."""
    one, other = find_root(parents, one), find_root(parents, other)
    if other < one:
        one, other = other, one
    parents[other] = one
    return one
