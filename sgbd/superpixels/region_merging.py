"""Merge neighbouring regions, most similar first: Ward's hierarchical clustering on the region adjacency graph.

A region is described by its mean colour and a plane of inverse depth. Merging two regions costs the increase in the
squared error of their pixels. For regions of n and m pixels with mean colours f and g, the colour part of the cost is
n m / (n + m) |f - g|^2. The depth part is the error of one plane fitted to both regions, minus the errors of their own
planes. So large, flat, evenly coloured surfaces grow together, and small regions that stand out remain. All costs are
computed from sums over the pixels of a region. These sums add up when regions merge, so the image is read only once.

Sources: Ward, Hierarchical grouping to optimize an objective function, JASA 1963, DOI 10.1080/01621459.1963.10500845;
Haris et al., Hybrid image segmentation using watersheds and fast region merging, TIP 1998, DOI 10.1109/83.730380.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.machine.compiled import compiled
from sgbd.machine.linked_lists import LinkedLists, prepend, unlink
from sgbd.machine.side_by_side import side_by_side
from sgbd.repaint import repaint
from sgbd.superpixels.slanted_planes import DISPARITY, plane_fit

# Columns of `sums`, one row per region: 0 the number of pixels, 1 to 3 the sums of L, a and b. The columns from _DEPTH
# on cover only pixels with depth: the nine sums that `plane_fit` needs, then in _SQUARES the sum of d d.
_DEPTH, _SQUARES, _SUMS = 4, 13, 14

# Columns of `looks`, one row per region: 0 to 2 the mean colour, _ERROR the squared error of the fitted plane.
_ERROR = 3


def merge_alike(
    label_map: LabelMap,
    planes: npt.NDArray[np.float32],
    n_segments: int,
    tolerance: float,
    min_size: int,
    threads: int = 1,
) -> LabelMap:
    """Merge neighbouring regions, always the pair whose merge costs least.

    Merging continues while the cheapest merge costs at most `tolerance` or more than `n_segments` regions are left.
    Then each region smaller than `min_size` is merged with the neighbour for which that costs least.

    Args:
        label_map: int32 [H, W], ids 0..N-1 in raster order of their first pixel, each one 4-connected region.
        planes: float32 [4, H, W]: L, a, b over the compactness, and inverse depth over its noise, 0 = missing.
        n_segments: Maximum number of regions.
        tolerance: Merges that raise the squared error by at most this are always made.
        min_size: Pixels a region needs so as not to be merged as a fragment.
        threads: Number of threads; it does not affect the result.

    Returns:
        int32 [H, W], a label map of the same form.
    """
    count = int(label_map.max()) + 1
    # A planar graph has fewer than three edges per node, and each edge has two ends.
    ends = np.empty(6 * count, np.int32)
    table = np.full(1 << int(8 * count).bit_length(), -1, np.int32)
    sums = np.zeros((count, _SUMS))
    # One thread computes each sum, in pixel order, so the result does not depend on the number of threads.
    _, edges = side_by_side(
        [
            partial(_sum_depth, label_map, planes[DISPARITY], sums),
            partial(_sum_colors_and_pair, label_map, planes, table, ends, sums),
        ],
        threads,
    )
    parents, heap = np.arange(count), np.arange(edges)
    met, half_edges = np.full(count, -1), LinkedLists.empty(count, 2 * edges)
    _merge(
        sums, ends, n_segments, tolerance, min_size,
        parents, met, half_edges, np.empty((count, 4)), np.empty(_SUMS - _DEPTH), np.empty(edges), heap, heap.copy(),
    )  # fmt: skip
    # The root of a group is its first region in raster order, so the new ids are in raster order too.
    roots = np.flatnonzero(parents == np.arange(count))
    return repaint(label_map, np.searchsorted(roots, parents), threads)


@compiled
def _sum_depth(label_map, disparity, sums):  # type: ignore[no-untyped-def]
    """Sum what a plane fit needs over the pixels of every region.

    Args:
        label_map: int32 [H, W].
        disparity: float32 [H, W], inverse depth, 0 = missing.
        sums: float64 [N, 14] of zeros; the columns from _DEPTH on are written.
    """
    height, width = label_map.shape
    for row in range(height):
        y = np.float64(row)
        column = 0
        while column < width:
            # Process one run of equal labels. The float sums continue from the region's totals, pixel by pixel, so the
            # order of additions does not depend on the runs. The sums of coordinates are integers, exact in any order.
            label = np.int64(label_map[row, column])
            level, down, right, squares = (
                sums[label, _DEPTH + 6],
                sums[label, _DEPTH + 7],
                sums[label, _DEPTH + 8],
                sums[label, _SQUARES],
            )
            valid = x_sum = xx_sum = np.int64(0)
            while column < width and label_map[row, column] == label:
                if disparity[row, column] > 0:
                    d, x = np.float64(disparity[row, column]), np.float64(column)
                    valid += 1
                    x_sum += column
                    xx_sum += column * column
                    level += d
                    down += d * y
                    right += d * x
                    squares += d * d
                column += 1
            sums[label, _DEPTH] += valid
            sums[label, _DEPTH + 1] += row * valid
            sums[label, _DEPTH + 2] += x_sum
            sums[label, _DEPTH + 3] += row * row * valid
            sums[label, _DEPTH + 4] += row * x_sum
            sums[label, _DEPTH + 5] += xx_sum
            sums[label, _DEPTH + 6], sums[label, _DEPTH + 7], sums[label, _DEPTH + 8] = level, down, right
            sums[label, _SQUARES] = squares


@compiled
def _sum_colors_and_pair(label_map, planes, table, ends, sums):  # type: ignore[no-untyped-def]
    """Count the pixels of every region, sum their colours, and find the pairs of regions that share a border.

    Args:
        label_map: int32 [H, W].
        planes: float32 [4, H, W].
        table: int32 [a power of two] of -1, used as a hash table of edges, see `_add`.
        ends: int32 [at least 2 E], written: the two regions of each edge, smaller id first.
        sums: float64 [N, 14] of zeros; the first _DEPTH columns are written.

    Returns:
        The number of edges E.
    """
    height, width = label_map.shape
    edges = np.int64(0)
    for row in range(height):
        column = 0
        last_above = last_below = left = np.int64(-1)
        while column < width:
            label, first = np.int64(label_map[row, column]), column
            lightness, a, b = sums[label, 1], sums[label, 2], sums[label, 3]
            while column < width and label_map[row, column] == label:
                lightness += planes[0, row, column]
                a += planes[1, row, column]
                b += planes[2, row, column]
                column += 1
            sums[label, 0] += column - first
            sums[label, 1], sums[label, 2], sums[label, 3] = lightness, a, b
            if left >= 0:
                edges = _add(table, ends, edges, left, label)
            left = label
            if row > 0:
                for k in range(first, column):
                    above = np.int64(label_map[row - 1, k])
                    # Borders are many pixels long, so the previous pair usually repeats: skip the hash lookup then.
                    if above != label and not (above == last_above and label == last_below):
                        edges = _add(table, ends, edges, above, label)
                        last_above, last_below = above, label
    return edges


@compiled
def _add(table, ends, edges, one, other):  # type: ignore[no-untyped-def]
    """Add the edge between two regions unless it exists, and return the new number of edges.

    `table` is a hash table with linear probing: a slot holds the index of an edge, or -1 if it is free.
    """
    if other < one:
        one, other = other, one
    last = len(table) - 1
    slot = (one * 73856093 ^ other * 19349663) & last
    while table[slot] >= 0:
        edge = table[slot]
        if ends[2 * edge] == one and ends[2 * edge + 1] == other:
            return edges
        slot = (slot + 1) & last
    table[slot] = edges
    ends[2 * edges], ends[2 * edges + 1] = one, other
    return edges + 1


@compiled(error_model="numpy")
def _merge(  # type: ignore[no-untyped-def]
    sums, ends, n_segments, tolerance, min_size, parents, met, half_edges, looks, union, costs, heap, places
):
    """Merge regions until the stopping criterion of `merge_alike` holds.

    The edges of a region are a linked list of *half edges*. Half edge h belongs to region ends[h]; its edge is h // 2
    and its other half is h ^ 1, so ends[h ^ 1] is the neighbour. A binary heap holds the edges, cheapest on top;
    `places[e]` is the position of edge e in the heap, or -1 once it was taken out.

    Args:
        sums: float64 [N, 14], the sums of each region; overwritten.
        ends: int32 [at least 2 E]; overwritten.
        n_segments: Maximum number of regions.
        tolerance: Merges that cost at most this are always made.
        min_size: Pixels a region needs so as not to be merged as a fragment.
        parents: int64 [N], initially 0 to N - 1; on return the root of each region: the smallest id of its group.
        met: int64 [N] of -1, work space: marks the neighbours of the region that stays, see `_take_over_edges`.
        half_edges: N empty lists of 2 E items, filled with the half edges of each region.
        looks: float64 [N, 4], work space: the mean colour of each region, and the squared error of its plane.
        union: float64 [10], work space: the depth sums of two regions together.
        costs: float64 [E], work space: the cost of each edge.
        heap: int64 [E], initially 0 to E - 1.
        places: int64 [E], initially 0 to E - 1.
    """
    count, edges = len(parents), len(costs)
    heads, after, _ = half_edges
    for half in range(2 * edges):
        prepend(half_edges, np.int64(ends[half]), half)
    for region in range(count):
        _judge(sums, region, looks)
    for edge in range(edges):
        costs[edge] = _cost(sums, looks, union, np.int64(ends[2 * edge]), np.int64(ends[2 * edge + 1]))
    waiting = edges
    for place in range(edges // 2 - 1, -1, -1):
        _sink(heap, places, costs, waiting, place)
    left = count
    only_fragments = False
    # Invariant: every edge in the heap joins two different remaining regions, no two edges join the same pair, and
    # costs and sums describe the regions as merged so far.
    while waiting > 0:
        edge = heap[0]
        keep, gone = np.int64(ends[2 * edge]), np.int64(ends[2 * edge + 1])
        only_fragments = only_fragments or (left <= n_segments and costs[edge] > tolerance)
        waiting = _remove(heap, places, costs, waiting, edge)
        # Regions only grow, so an edge between two that are large enough is never needed again.
        if only_fragments and sums[keep, 0] >= min_size and sums[gone, 0] >= min_size:
            continue
        unlink(half_edges, keep, 2 * edge)
        unlink(half_edges, gone, 2 * edge + 1)
        # The smaller id stays, so that the root of a group is its first region in raster order.
        if gone < keep:
            keep, gone = gone, keep
        parents[gone] = keep
        left -= 1
        for k in range(_SUMS):
            sums[keep, k] += sums[gone, k]
        _judge(sums, keep, looks)
        waiting = _take_over_edges(ends, half_edges, met, keep, gone, costs, heap, places, waiting)
        # The merged region has a new colour and plane: update the cost and heap position of all its waiting edges.
        half = heads[keep]
        while half >= 0:
            edge = half // 2
            if places[edge] >= 0:
                costs[edge] = _cost(sums, looks, union, np.int64(ends[half]), np.int64(ends[half ^ 1]))
                _rise(heap, places, costs, places[edge])
                _sink(heap, places, costs, waiting, places[edge])
            half = after[half]
    for region in range(count):
        # A parent has a smaller id, so its root is already known.
        parents[region] = parents[parents[region]]


@compiled(inline="always")
def _take_over_edges(ends, half_edges, met, keep, gone, costs, heap, places, waiting):  # type: ignore[no-untyped-def]
    """Give the edges of region `gone` to region `keep`, and return how many edges are left in the heap.

    If a region is a neighbour of both, it keeps its edge with `keep`; its edge with `gone` is removed.
    """
    heads, after, _ = half_edges
    # Mark the neighbours of the region that stays. The marks are cleared again at the end.
    half = heads[keep]
    while half >= 0:
        met[ends[half ^ 1]] = keep
        half = after[half]
    half = heads[gone]
    while half >= 0:
        following = after[half]
        other = np.int64(ends[half ^ 1])
        if met[other] == keep:
            unlink(half_edges, other, half ^ 1)
            if places[half // 2] >= 0:
                waiting = _remove(heap, places, costs, waiting, half // 2)
        else:
            ends[half] = keep
            prepend(half_edges, keep, half)
        half = following
    half = heads[keep]
    while half >= 0:
        met[ends[half ^ 1]] = -1
        half = after[half]
    return waiting


@compiled(inline="always")
def _judge(sums, region, looks):  # type: ignore[no-untyped-def]
    """Write the mean colour of a region and the squared error of its plane into `looks`, from its sums."""
    for k in range(3):
        looks[region, k] = sums[region, 1 + k] / sums[region, 0]
    if sums[region, _DEPTH] > 0:
        looks[region, _ERROR] = plane_fit(sums[region, _DEPTH:], sums[region, _SQUARES])[3]
    else:
        looks[region, _ERROR] = 0.0


@compiled(error_model="numpy")
def _cost(sums, looks, union, one, other):  # type: ignore[no-untyped-def]
    """Return the increase in squared error if two regions merge; without depth in both, only colour counts."""
    first, second = sums[one], sums[other]
    n, m = first[0], second[0]
    apart = 0.0
    for k in range(3):
        difference = looks[one, k] - looks[other, k]
        apart += difference * difference
    cost = n * m / (n + m) * apart
    if first[_DEPTH] > 0 and second[_DEPTH] > 0:
        for k in range(_SUMS - _DEPTH):
            union[k] = first[_DEPTH + k] + second[_DEPTH + k]
        more = plane_fit(union, union[_SQUARES - _DEPTH])[3] - looks[one, _ERROR] - looks[other, _ERROR]
        cost += 0.0 if more < 0 else more
    return cost


@compiled(inline="always")
def _remove(heap, places, costs, waiting, edge):  # type: ignore[no-untyped-def]
    """Take an edge out of the heap, and return how many are left."""
    place = places[edge]
    waiting -= 1
    # The last edge of the heap fills the gap, then moves up or down to restore the heap order.
    moved = heap[waiting]
    places[edge] = -1
    if place < waiting:
        heap[place], places[moved] = moved, place
        _rise(heap, places, costs, place)
        _sink(heap, places, costs, waiting, places[moved])
    return waiting


@compiled(inline="always")
def _rise(heap, places, costs, place):  # type: ignore[no-untyped-def]
    """Move the edge at a place up the heap until its parent costs no more than it does."""
    edge = heap[place]
    while place > 0:
        above = (place - 1) // 2
        if costs[heap[above]] <= costs[edge]:
            break
        heap[place], places[heap[above]] = heap[above], place
        place = above
    heap[place], places[edge] = edge, place


@compiled
def _sink(heap, places, costs, waiting, place):  # type: ignore[no-untyped-def]
    """Move the edge at a place down the heap until neither child costs less than it does."""
    edge = heap[place]
    while 2 * place + 1 < waiting:
        below = 2 * place + 1
        if below + 1 < waiting and costs[heap[below + 1]] < costs[heap[below]]:
            below += 1
        if costs[heap[below]] >= costs[edge]:
            break
        heap[place], places[heap[below]] = heap[below], place
        place = below
    heap[place], places[edge] = edge, place
