"""Agglomeration of signed graphs by edge contraction, in order of the strength of what links two segments.

One loop for three partitioners, which differ in how the weights of parallel edges combine (the *linkage*): A. Bailoni,
C. Pape, N. Hütsch, S. Wolf, T. Beier, A. Kreshuk, F. A. Hamprecht, "GASP, a generalized framework for agglomerative
clustering of signed graphs and its application to instance segmentation", CVPR 2022, algorithm 1,
doi:10.1109/CVPR52688.2022.01135.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sgbd.machine.compiled import compiled
from sgbd.partition.heap import pop, push
from sgbd.partition.partitioner import number_by_first_appearance

Linkage = Literal["sum", "mean", "absolute_maximum"]

_SUM, _MEAN, _ABSOLUTE_MAXIMUM = 0, 1, 2
_CODES = {"sum": _SUM, "mean": _MEAN, "absolute_maximum": _ABSOLUTE_MAXIMUM}


def agglomerate(
    num_nodes: int,
    pairs: NDArray[np.int64],
    weight: NDArray[np.float64],
    linkage: Linkage = "sum",
    share: NDArray[np.float64] | None = None,
    cannot_link: bool = False,
) -> NDArray[np.int64]:
    """Partition a graph with signed edge weights by contracting its strongest edge again and again.

    Edges that become parallel are one from then on, of the strength that the linkage says. Without `cannot_link` the
    edge of greatest strength is contracted as long as it is positive. With it, edges come in the order of their
    absolute strength, and a negative one forbids its two segments, and all they become part of, to be joined ever.

    Equal strengths come in the order of the edges' ends, so the result does not depend on chance or on the order of the
    pairs (but for the rounding of sums).

    Args:
        num_nodes: Number of superpixels N.
        pairs: int64 [2, E], ends of each edge, no loops. Repeated pairs count as one edge, combined by the linkage.
        weight: float64 [E], positive for merging.
        linkage: Strength of several edges between two segments: the `sum` of their weights (greedy additive edge
            contraction), the `mean` weighted by `share` (average linkage), or the weight of greatest absolute value
            (`absolute_maximum`, which with `cannot_link` is the mutex watershed).
        share: float64 [E], positive, how much each edge counts in a mean; None for all the same. Only for `mean`.
        cannot_link: Whether negative edges forbid.

    Returns:
        int64 [N], segment of each superpixel, numbered in the order of first appearance.
    """
    if num_nodes == 0:
        return np.empty(0, dtype=np.int64)
    key = np.minimum(pairs[0], pairs[1]) * num_nodes + np.maximum(pairs[0], pairs[1])
    total = np.array(weight, dtype=np.float64)
    share = np.ones(len(key)) if share is None else np.array(share, dtype=np.float64)
    if linkage == "mean":
        total *= share
    if not (key[1:] > key[:-1]).all():
        if linkage == "absolute_maximum":
            # Of a repeated pair the strongest edge stays, of equally strong ones the attractive.
            order = np.lexsort((-total, -np.abs(total), key))
            kept = order[np.concatenate([[True], key[order][1:] != key[order][:-1]])]
            key, total, share = key[kept], total[kept], share[kept]
        else:
            key, edge = np.unique(key, return_inverse=True)
            total = np.bincount(edge, weights=total, minlength=len(key)).astype(np.float64)
            share = np.bincount(edge, weights=share, minlength=len(key)).astype(np.float64)
    first, second = np.divmod(key, num_nodes)
    if linkage == "absolute_maximum":
        # Signed ranks instead of weights: no two are equal, so a tie is decided once and for all, by the edges' order.
        rank = np.empty(len(total))
        rank[np.argsort(-np.abs(total), kind="stable")] = np.arange(len(total), 0, -1)
        total = np.where(total > 0, rank, -rank)
    strength = total / share if linkage == "mean" else total.copy()
    num_edges = len(total)
    parent = np.arange(num_nodes)
    head, tail, edge_to = np.full((3, num_nodes), -1)
    end, following = np.full((2, 2 * num_edges), -1)
    alive, forbidden = np.ones(num_edges, dtype=np.bool_), np.zeros(num_edges, dtype=np.bool_)
    heap_key, heap_edge = np.empty(2 * num_edges), np.empty(2 * num_edges, dtype=np.int64)
    _contract(
        first, second, total, share, strength, _CODES[linkage], cannot_link,
        parent, np.zeros_like(parent), head, tail, edge_to, end, following, alive, forbidden, heap_key, heap_edge,
    )  # fmt: skip
    return number_by_first_appearance(parent)


@compiled
def _contract(
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    total: NDArray[np.float64],
    share: NDArray[np.float64],
    strength: NDArray[np.float64],
    linkage: int,
    cannot_link: bool,
    parent: NDArray[np.int64],
    degree: NDArray[np.int64],
    head: NDArray[np.int64],
    tail: NDArray[np.int64],
    edge_to: NDArray[np.int64],
    end: NDArray[np.int64],
    following: NDArray[np.int64],
    alive: NDArray[np.bool_],
    forbidden: NDArray[np.bool_],
    heap_key: NDArray[np.float64],
    heap_edge: NDArray[np.int64],
) -> None:
    """Contract edges greedily.

    Edge e is the two half-edges 2e and 2e + 1; `end` says where a half-edge starts, its other half where it leads.
    The half-edges of a node form a linked list from `head` to `tail`; those of dead edges are skipped and dropped.

    Args:
        first: int64 [E], one end of each edge.
        second: int64 [E], its other end.
        total: float64 [E]; overwritten, like all that follows.
        share: float64 [E].
        strength: float64 [E]: `total`, or `total` / `share` if the linkage is the mean.
        linkage: One of _SUM, _MEAN and _ABSOLUTE_MAXIMUM.
        cannot_link: Whether negative edges forbid.
        parent: int64 [N], 0 to N - 1; then a representative of each superpixel's group.
        degree: int64 [N] of zeros.
        head: int64 [N] of -1.
        tail: int64 [N] of -1.
        edge_to: int64 [N] of -1, the kept node's edge to each of its neighbours.
        end: int64 [2 E].
        following: int64 [2 E] of -1, the next half-edge of the same node.
        alive: bool [E], true.
        forbidden: bool [E], false.
        heap_key: float64 [2 E]. The heap may hold outdated strengths of an edge; they are recognised when they come up.
            An edge enters it once for itself and once for each edge that it absorbs.
        heap_edge: int64 [2 E].
    """
    num_nodes, num_edges = len(parent), len(total)
    for half in range(2 * num_edges):
        node = first[half >> 1] if half & 1 == 0 else second[half >> 1]
        end[half] = node
        if head[node] < 0:
            head[node] = half
        else:
            following[tail[node]] = half
        tail[node] = half
        degree[node] += 1

    size: int = np.int64(0)  # type: ignore[assignment]  # see sgbd.machine.compiled
    for edge in range(num_edges):
        if cannot_link or strength[edge] > 0:
            size = push(heap_key, heap_edge, size, abs(strength[edge]), edge)
    while size > 0:
        greatest, contracted = heap_key[0], heap_edge[0]
        size = pop(heap_key, heap_edge, size)
        if not alive[contracted] or forbidden[contracted] or abs(strength[contracted]) != greatest:
            continue
        if strength[contracted] <= 0:
            forbidden[contracted] = cannot_link
            continue
        kept, gone = end[2 * contracted], end[2 * contracted + 1]
        if degree[kept] < degree[gone]:
            kept, gone = gone, kept
        alive[contracted] = False
        parent[gone] = kept

        half = head[kept]
        last = -1
        degree[kept] = 0
        while half >= 0:
            upcoming = following[half]
            if alive[half >> 1]:
                edge_to[end[half ^ 1]] = half >> 1
                degree[kept] += 1
                if last < 0:
                    head[kept] = half
                else:
                    following[last] = half
                last = half
            half = upcoming

        half = head[gone]
        while half >= 0:
            upcoming = following[half]
            edge = half >> 1
            if alive[edge]:
                neighbor = end[half ^ 1]
                parallel = edge_to[neighbor]
                if parallel >= 0:
                    if linkage == _ABSOLUTE_MAXIMUM:
                        if abs(total[edge]) > abs(total[parallel]):
                            total[parallel] = total[edge]
                        strength[parallel] = total[parallel]
                    else:
                        total[parallel] += total[edge]
                        share[parallel] += share[edge]
                        strength[parallel] = total[parallel] / share[parallel] if linkage == _MEAN else total[parallel]
                    forbidden[parallel] |= forbidden[edge]
                    alive[edge] = False
                    if not forbidden[parallel] and (cannot_link or strength[parallel] > 0):
                        size = push(heap_key, heap_edge, size, abs(strength[parallel]), parallel)
                else:
                    end[half] = kept
                    degree[kept] += 1
                    if last < 0:
                        head[kept] = half
                    else:
                        following[last] = half
                    last = half
            half = upcoming

        tail[kept] = last
        if last < 0:
            head[kept] = -1
        else:
            following[last] = -1
        half = head[kept]
        while half >= 0:
            edge_to[end[half ^ 1]] = -1
            half = following[half]

    for node in range(num_nodes):
        root = node
        while parent[root] != root:
            parent[root] = parent[parent[root]]
            root = parent[root]
        parent[node] = root
