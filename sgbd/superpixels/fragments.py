"""Connect the intersection of two label maps and merge its fragments, in one compiled pass over the pixels.

Without Numba, the functions of `sgbd.superpixels.connect` do the same step by step, with the same result.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.machine.compiled import HAS_NUMBA, compiled
from sgbd.machine.side_by_side import bands, side_by_side
from sgbd.machine.union_find import find_root
from sgbd.repaint import repaint
from sgbd.superpixels.connect import connected_regions, intersect, merge_fragments

# Columns of `facts`, one row per piece: its number of pixels and its bounding box, last row and column included.
PIXELS, TOP, BOTTOM, LEFT, RIGHT = range(5)

PIXELS_A_PIECE, FEW_PIECES = 16, 1024
"""Initial capacity: one piece per `PIXELS_A_PIECE` pixels, but at least `FEW_PIECES`; it grows if there are more."""


def connected_superpixels(
    first: npt.NDArray[np.int32], second: npt.NDArray[np.int32], min_size: int, threads: int = 1
) -> LabelMap:
    """Intersect two over-segmentations, split the result into connected pieces and merge its fragments.

    A fragment is merged into the neighbour with the longest common border. One pass over the image finds the pieces by
    union-find, with their areas and bounding boxes. As fragments are small, their borders are then looked up inside
    their boxes alone; the image is not traversed again until the superpixels are painted.

    Args:
        first: int32 [H, W], any ids.
        second: int32 [H, W], any ids.
        min_size: Smallest superpixel to keep, pixels.
        threads: Number of threads; it does not affect the result.

    Returns:
        int32 [H, W], ids 0..N-1 in raster order of their first pixel, each one 4-connected region.
    """
    if not HAS_NUMBA:
        return merge_fragments(connected_regions(intersect(first, second)), min_size)
    pieces = np.empty(first.shape, np.int32)
    parents, facts = _pieces_in_bands(first, second, pieces, threads)
    groups = np.empty(len(parents), np.int64)
    while True:
        _gather(parents, facts, groups)
        is_root = groups == np.arange(len(groups))
        roots = np.flatnonzero(is_root)
        fragments = roots[facts[roots, PIXELS] < min_size]
        if len(fragments) == 0 or len(roots) == 1:
            break
        _merge_round(pieces, groups, facts, fragments, parents, np.empty_like(groups), np.zeros_like(groups))
    # The root of a group is its first piece in raster order, so the new ids are in raster order too.
    return repaint(pieces, (np.cumsum(is_root) - 1)[groups], threads)


def _pieces_in_bands(
    first: npt.NDArray[np.int32], second: npt.NDArray[np.int32], pieces: npt.NDArray[np.int32], threads: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Find the pieces of each band of rows in a thread of its own, and join those that touch between two bands.

    Every band numbers its pieces from a start of its own. The numbers that it leaves unused belong to no pixel; in
    union-find, they are members of the first piece's set.

    Args:
        first: int32 [H, W].
        second: int32 [H, W].
        pieces: int32 [H, W], written: the piece of each pixel.
        threads: Number of bands and threads.

    Returns:
        The union-find parent of each piece, int64 [limit], and its facts, int64 [limit, 5], for all numbers.
    """
    height, width = first.shape
    rows = bands(height, min(threads, height))
    runs = np.empty((len(rows), 2, 2, width + 1), np.int64)
    room = min(first.size, max(FEW_PIECES, first.size // (PIXELS_A_PIECE * len(rows))))
    while True:
        parents, facts = np.zeros(len(rows) * room, np.int64), np.zeros((len(rows) * room, 5), np.int64)
        jobs = [
            partial(_find_pieces, first, second, *band, room * place, room, runs[place], pieces, parents, facts)
            for place, band in enumerate(rows)
        ]
        if max(side_by_side(jobs, threads)) <= room:
            break
        room = min(first.size, 4 * room)
    for top, _ in rows[1:]:
        _join_rows(first, second, top, pieces, parents)
    return parents, facts


@compiled
def _find_pieces(  # type: ignore[no-untyped-def]
    first, second, top, bottom, start_number, room, runs, pieces, parents, facts
):
    """Number the pieces of a band in raster order; if two turn out to be connected, join them in `parents`.

    Each row is cut into runs of pixels that are equal in both label maps. A run joins every overlapping run above it
    that has the same labels, or starts a new piece.

    Args:
        first: int32 [H, W].
        second: int32 [H, W].
        top: First row of the band.
        bottom: Row after the band.
        start_number: Number of its first piece.
        room: Maximum number of pieces.
        runs: int64 [2, 2, W + 1], work space: for the current and the previous row, alternating, the end (exclusive)
            and the piece of each run.
        pieces: int32 [H, W], written in the band: the piece of each pixel.
        parents: int64 [all numbers], written: the union-find parent of each piece.
        facts: int64 [all numbers, 5], written: see the columns above.

    Returns:
        The number of pieces, or room + 1 if they did not fit.
    """
    width = first.shape[1]
    count, limit = np.int64(start_number), np.int64(start_number + room)
    runs_above = np.int64(0)
    for row in range(top, bottom):
        ends, numbers = runs[row & 1, 0], runs[row & 1, 1]
        ends_above, numbers_above = runs[1 - (row & 1), 0], runs[1 - (row & 1), 1]
        # Find the ends of the runs without a branch: the next end overwrites `ends[found]` until the label changes.
        found = np.int64(0)
        ones, twos = first[row], second[row]
        for column in range(width - 1):
            ends[found] = column + 1
            found += (ones[column] != ones[column + 1]) | (twos[column] != twos[column + 1])
        ends[found] = width
        found += 1
        # Invariant: the current run is [start, end), and `above` is the first run of the row above that ends after
        # `start`. While `piece` equals `count`, the current run has not joined any piece.
        start, above = np.int64(0), np.int64(0)
        for run in range(found):
            end, piece = ends[run], count
            one, two = ones[start], twos[start]
            # Join the run with equal runs above it. A run above that ends beyond `end` also touches the next run.
            while above < runs_above:
                # The first column in which the run above lies over this one.
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
                    return np.int64(room + 1)
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
    return count - start_number


@compiled
def _join_rows(first, second, row, pieces, parents):  # type: ignore[no-untyped-def]
    """Join the pieces of a row with those above it that have the same labels."""
    for column in range(first.shape[1]):
        if first[row, column] == first[row - 1, column] and second[row, column] == second[row - 1, column]:
            _join(parents, np.int64(pieces[row, column]), np.int64(pieces[row - 1, column]))


@compiled
def _gather(parents, facts, groups):  # type: ignore[no-untyped-def]
    """Write the root of every piece into `groups`, and combine the areas and boxes of a group at its root.

    A piece whose facts were moved to its root has 0 pixels, so that they are not added twice.
    """
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
    """Join every fragment with the neighbour with the longest common border.

    All fragments of a round see the groups as they were before the round, so the order of the fragments does not
    matter.

    Args:
        pieces: int32 [H, W], the piece of each pixel.
        groups: int64 [count], the root of each piece before the round.
        facts: int64 [count, 5], the area and box of each root.
        fragments: int64 [F], roots of the groups to merge.
        parents: int64 [count], union-find parents; changed.
        met: int64 [count], work space: the neighbours found for a fragment.
        border: int64 [count] of zeros, work space: the length of the border with each group; zeros again on return.
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
                    # Sides 0 to 3: above, below, left, right.
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
    """Join two groups under the root that comes first in raster order, and return that root."""
    one, other = find_root(parents, one), find_root(parents, other)
    if other < one:
        one, other = other, one
    parents[other] = one
    return one
