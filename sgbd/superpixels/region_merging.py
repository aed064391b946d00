"""Merging of neighbouring regions, the most alike first: Ward's hierarchical clustering on the region adjacency graph.

A region is a plane of inverse depth and a mean colour. What it costs to merge two is by how much the squared error of
their pixels rises: for the colours n m / (n + m) |f - g|^2, for the depth the error of one plane for both minus the
errors of a plane each. So large, flat, even surfaces grow together, and small regions that stand out stay. Everything
is computed from sums over the pixels of a region, which add up when regions merge; the image is not looked at again.

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

# Sums over a region: its pixels and their colours, then over those with depth what a plane needs, and d d.
_DEPTH, _SQUARES, _SUMS = 4, 13, 14

# How a region looks: its mean colour, and the squared error of its plane.
_ERROR = 3


def merge_alike(
    label_map: LabelMap,
    planes: npt.NDArray[np.float32],
    n_segments: int,
    tolerance: float,
    min_size: int,
    threads: int = 1,
) -> LabelMap:
    """Merge neighbouring regions, always the two whose merging costs least.

    It goes on while merging costs no more than `tolerance` or there are more than `n_segments` regions. Then what is
    smaller than `min_size` is merged with the neighbour for which that costs least.

    Args:
        label_map: int32 [H, W], ids 0..N-1 in raster order of their first pixel, each one 4-connected region.
        planes: float32 [4, H, W]: L, a, b over the compactness, and inverse depth over its noise, 0 = missing.
        n_segments: Regions at the most.
        tolerance: Squared error that counts for nothing.
        min_size: Pixels a region needs to stay.
        threads: Threads to work in; the result does not depend on it.

    Returns:
        int32 [H, W] of the same form.
    """
    count = int(label_map.max()) + 1
    # A planar graph has fewer than three edges a node.
    ends = np.empty(6 * count, np.int32)
    table = np.full(1 << int(8 * count).bit_length(), -1, np.int32)
    sums = np.zeros((count, _SUMS))
    # Every sum is taken by one thread in the order of the pixels.
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
    # A root is the first of its group in raster order.
    roots = np.flatnonzero(parents == np.arange(count))
    return repaint(label_map, np.searchsorted(roots, parents))


@compiled
def _sum_depth(label_map, disparity, sums):  # type: ignore[no-untyped-def]
    """Sum up what a plane needs over the pixels of every region.

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
            # Sums of floats grow pixel by pixel, which is their order whatever the runs; those of places are whole
            # numbers, which can be summed in any order.
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
    """Sum up the pixels of every region and their colours, and pair the regions that share a border.

    Args:
        label_map: int32 [H, W].
        planes: float32 [4, H, W].
        table: int32 [a power of two] of -1 to work in: a hash table of edges.
        ends: int32 [2 * edges at the most], written: the two ends of each edge.
        sums: float64 [N, 14] of zeros; the first _DEPTH columns are written.

    Returns:
        The number of edges.
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
                    # Borders run on for many pixels: what was met last is most often met again.
                    if above != label and not (above == last_above and label == last_below):
                        edges = _add(table, ends, edges, above, label)
                        last_above, last_below = above, label
    return edges


@compiled
def _add(table, ends, edges, one, other):  # type: ignore[no-untyped-def]
    """Add an edge unless it is there, and return how many there are."""
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
    """Merge regions.

    The edges of a region are a linked list of *half edges*: half edge h belongs to region ends[h], its edge is
    h // 2, and h ^ 1 is its other half. All edges wait in a heap, the cheapest on top; `places` knows where each is.

    Args:
        sums: float64 [N, 14], of each region; overwritten.
        ends: int32 [2 E at the least]; overwritten.
        n_segments: Regions at the most.
        tolerance: Cost that counts for nothing.
        min_size: Pixels a region needs to stay.
        parents: int64 [N], the regions themselves, 0 to N - 1; then the root of each: the smallest id of its group.
        met: int64 [N] of -1 to work in.
        half_edges: N empty lists of 2 E items to work in: the half edges of each region.
        looks: float64 [N, 4] to work in: the mean colour of each region, and the squared error of its plane.
        union: float64 [10] to work in: the sums of two regions that a plane needs.
        costs: float64 [E] to work in.
        heap: int64 [E], 0 to E - 1, to work in.
        places: int64 [E], 0 to E - 1, to work in.
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
    while waiting > 0:
        edge = heap[0]
        keep, gone = np.int64(ends[2 * edge]), np.int64(ends[2 * edge + 1])
        only_fragments = only_fragments or (left <= n_segments and costs[edge] > tolerance)
        waiting = _remove(heap, places, costs, waiting, edge)
        if only_fragments and sums[keep, 0] >= min_size and sums[gone, 0] >= min_size:
            continue
        unlink(half_edges, keep, 2 * edge)
        unlink(half_edges, gone, 2 * edge + 1)
        if gone < keep:
            keep, gone = gone, keep
        parents[gone] = keep
        left -= 1
        for k in range(_SUMS):
            sums[keep, k] += sums[gone, k]
        _judge(sums, keep, looks)
        waiting = _take_over_edges(ends, half_edges, met, keep, gone, costs, heap, places, waiting)
        half = heads[keep]
        while half >= 0:
            edge = half // 2
            if places[edge] >= 0:
                costs[edge] = _cost(sums, looks, union, np.int64(ends[half]), np.int64(ends[half ^ 1]))
                _rise(heap, places, costs, places[edge])
                _sink(heap, places, costs, waiting, places[edge])
            half = after[half]
    for region in range(count):
        # A parent has the smaller id, so that its own root is known by now.
        parents[region] = parents[parents[region]]


@compiled(inline="always")
def _take_over_edges(ends, half_edges, met, keep, gone, costs, heap, places, waiting):  # type: ignore[no-untyped-def]
    """Give a region that stays the edges of one that goes, and return how many edges wait in the heap then.

    A neighbour of both keeps the edge that it has with the region that stays; its other edge is taken out.
    """
    heads, after, _ = half_edges
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
    """Write the mean colour of a region and the squared error of its plane."""
    for k in range(3):
        looks[region, k] = sums[region, 1 + k] / sums[region, 0]
    if sums[region, _DEPTH] > 0:
        looks[region, _ERROR] = plane_fit(sums[region, _DEPTH:], sums[region, _SQUARES])[3]
    else:
        looks[region, _ERROR] = 0.0


@compiled(error_model="numpy")
def _cost(sums, looks, union, one, other):  # type: ignore[no-untyped-def]
    """By how much the squared error rises when two regions merge; regions without depth are compared by colour."""
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
    moved = heap[waiting]
    places[edge] = -1
    if place < waiting:
        heap[place], places[moved] = moved, place
        _rise(heap, places, costs, place)
        _sink(heap, places, costs, waiting, places[moved])
    return waiting


@compiled(inline="always")
def _rise(heap, places, costs, place):  # type: ignore[no-untyped-def]
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
