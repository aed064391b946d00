"""Agglomeration of graphs with signed weights: repeatedly contract the edge that links two segments most strongly.

One loop serves three partitioners, which differ in how the weights of parallel edges combine (the *linkage*):
A. Bailoni, C. Pape, N. Hütsch, S. Wolf, T. Beier, A. Kreshuk, F. A. Hamprecht, "GASP, a generalized framework for
agglomerative clustering of signed graphs and its application to instance segmentation", CVPR 2022, algorithm 1,
doi:10.1109/CVPR52688.2022.01135.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sgbd.machine.compiled import compiled
from sgbd.machine.union_find import find_root
from sgbd.partition.heap import Heap, pop, push
from sgbd.partition.partitioner import number_by_first_appearance

Linkage = Literal["sum", "mean", "absolute_maximum"]

_SUM, _MEAN, _ABSOLUTE_MAXIMUM = 0, 1, 2
_CODES = {"sum": _SUM, "mean": _MEAN, "absolute_maximum": _ABSOLUTE_MAXIMUM}


class _Edges(NamedTuple):
    """The state of every edge.

    Attributes:
        total: float64 [E], combined weight, by the linkage, of all original edges that this edge represents.
        share: float64 [E], their combined weight in a mean.
        strength: float64 [E], `total`, or `total` / `share` if the linkage is the mean.
        alive: bool [E], False once its two ends are in one segment, or a parallel edge has absorbed it.
        forbidden: bool [E], whether its two ends must never be joined.
    """

    total: NDArray[np.float64]
    share: NDArray[np.float64]
    strength: NDArray[np.float64]
    alive: NDArray[np.bool_]
    forbidden: NDArray[np.bool_]


class _Incidence(NamedTuple):
    """The edges of every node, as linked lists of half-edges.

    Edge e has two halves, 2 e and 2 e + 1, one in the list of each of its ends. The other half of h is h ^ 1.

    Attributes:
        node: int64 [2 E], the node whose list contains a half-edge.
        following: int64 [2 E], the next half-edge in the same list; -1 after the last.
        head: int64 [N], the first half-edge of each node; -1 if the list is empty.
        tail: int64 [N], the last half-edge of each node; -1 if the list is empty.
        degree: int64 [N], the length of each list, including edges that died since the list was built.
    """

    node: NDArray[np.int64]
    following: NDArray[np.int64]
    head: NDArray[np.int64]
    tail: NDArray[np.int64]
    degree: NDArray[np.int64]


def agglomerate(
    num_nodes: int,
    pairs: NDArray[np.int64],
    weight: NDArray[np.float64],
    linkage: Linkage = "sum",
    share: NDArray[np.float64] | None = None,
    cannot_link: bool = False,
) -> NDArray[np.int64]:
    """Partition a graph with signed edge weights by contracting its strongest edge repeatedly.

    Edges that become parallel are combined into one edge by the linkage. Without `cannot_link`, the strongest edge is
    contracted as long as its strength is positive. With it, edges are processed in the order of their absolute
    strength, and a negative edge forbids its two segments, and all segments that contain them, ever to be joined.

    Edges of equal strength are processed in the order of their ends. The result is therefore deterministic and does not
    depend on the order of the pairs, except through the rounding of sums.

    Args:
        num_nodes: Number of superpixels N.
        pairs: int64 [2, E], ends of each edge, no loops. Repeated pairs count as one edge, combined by the linkage.
        weight: float64 [E], positive for merging.
        linkage: Strength of several edges between two segments: the `sum` of their weights (greedy additive edge
            contraction), the `mean` weighted by `share` (average linkage), or the weight of greatest absolute value
            (`absolute_maximum`, which with `cannot_link` is the mutex watershed).
        share: float64 [E], positive, the weight of each edge in a mean; None for equal weights. Only for `mean`.
        cannot_link: Whether a negative edge forbids its segments to be joined.

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
        key, total, share = _without_repetitions(key, total, share, linkage)
    if linkage == "absolute_maximum":
        # Replace weights with signed ranks. No two are equal, so the order of the edges decides all ties in advance.
        rank = np.empty(len(total))
        rank[np.argsort(-np.abs(total), kind="stable")] = np.arange(len(total), 0, -1)
        total = np.where(total > 0, rank, -rank)
    strength = total / share if linkage == "mean" else total.copy()
    num_edges = len(total)
    edges = _Edges(total, share, strength, np.ones(num_edges, dtype=np.bool_), np.zeros(num_edges, dtype=np.bool_))
    node = np.stack(np.divmod(key, num_nodes), axis=1).ravel()
    head, tail = np.full((2, num_nodes), -1)
    incidence = _Incidence(node, np.empty_like(node), head, tail, np.zeros_like(head))
    parent = np.arange(num_nodes)
    # An edge is pushed once at the start and once for each edge that it absorbs.
    heap = Heap.with_room(2 * num_edges)
    _contract(edges, incidence, heap, parent, np.full_like(parent, -1), _CODES[linkage], cannot_link)
    return number_by_first_appearance(parent)


def _without_repetitions(
    key: NDArray[np.int64], total: NDArray[np.float64], share: NDArray[np.float64], linkage: Linkage
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Sort edges by their key and combine those with the same key."""
    if linkage == "absolute_maximum":
        # Of a repeated pair, keep the strongest edge; if two are equally strong, the positive one.
        order = np.lexsort((-total, -np.abs(total), key))
        kept = order[np.concatenate([[True], key[order][1:] != key[order][:-1]])]
        return key[kept], total[kept], share[kept]
    key, edge = np.unique(key, return_inverse=True)
    total = np.bincount(edge, weights=total, minlength=len(key)).astype(np.float64)
    share = np.bincount(edge, weights=share, minlength=len(key)).astype(np.float64)
    return key, total, share


@compiled
def _contract(
    edges: _Edges,
    incidence: _Incidence,
    heap: Heap,
    parent: NDArray[np.int64],
    edge_to: NDArray[np.int64],
    linkage: int,
    cannot_link: bool,
) -> None:
    """Contract edges greedily, strongest first. All arrays are overwritten.

    When the strength of an edge changes, its heap entry is not searched for. The edge is pushed again with its new
    strength, and the outdated entry is skipped when it is popped.

    Args:
        edges: The edges, all alive and none forbidden.
        incidence: The node of each half-edge, and empty lists.
        heap: Heap with room for twice as many items as there are edges.
        parent: int64 [N], initially 0 to N - 1; on return a representative of each node's segment.
        edge_to: int64 [N] of -1, work space, see `_join_nodes`.
        linkage: One of _SUM, _MEAN and _ABSOLUTE_MAXIMUM.
        cannot_link: Whether negative edges forbid.
    """
    for half in range(len(incidence.node)):
        _append(incidence, incidence.node[half], half)
    size: int = np.int64(0)  # type: ignore[assignment]  # see sgbd.machine.compiled
    for edge in range(len(edges.total)):
        if cannot_link or edges.strength[edge] > 0:
            size = push(heap, size, abs(edges.strength[edge]), edge)
    # Invariant: no two living edges join the same two segments. Each living edge that may still decide anything is in
    # the heap with its current strength, perhaps beside outdated entries.
    while size > 0:
        strength, edge = heap.key[0], heap.item[0]
        size = pop(heap, size)
        if not edges.alive[edge] or edges.forbidden[edge] or abs(edges.strength[edge]) != strength:
            continue
        if edges.strength[edge] <= 0:
            edges.forbidden[edge] = cannot_link
            continue
        edges.alive[edge] = False
        # Remove the node with fewer edges, because each of them has to be moved.
        kept, gone = incidence.node[2 * edge], incidence.node[2 * edge + 1]
        if incidence.degree[kept] < incidence.degree[gone]:
            kept, gone = gone, kept
        parent[gone] = kept
        size = _join_nodes(edges, incidence, heap, size, edge_to, kept, gone, linkage, cannot_link)
    for node in range(len(parent)):
        parent[node] = find_root(parent, node)


@compiled(inline="always")
def _join_nodes(
    edges: _Edges,
    incidence: _Incidence,
    heap: Heap,
    size: int,
    edge_to: NDArray[np.int64],
    kept: int,
    gone: int,
    linkage: int,
    cannot_link: bool,
) -> int:
    """Move the edges of node `gone` to node `kept`, and return the new size of the heap.

    While it runs, `edge_to` holds the edge from `kept` to each of its neighbours. An edge of `gone` to such a neighbour
    is parallel to that edge and is absorbed by it.
    """
    node, following = incidence.node, incidence.following
    # Rebuild the list of `kept` without dead edges, and note which edge leads to which neighbour.
    half = incidence.head[kept]
    incidence.head[kept] = incidence.tail[kept] = -1
    incidence.degree[kept] = 0
    while half >= 0:
        upcoming, edge = following[half], half >> 1
        if edges.alive[edge]:
            edge_to[node[half ^ 1]] = edge
            _append(incidence, kept, half)
        half = upcoming
    half = incidence.head[gone]
    while half >= 0:
        upcoming, edge = following[half], half >> 1
        if edges.alive[edge]:
            parallel = edge_to[node[half ^ 1]]
            if parallel >= 0:
                _absorb(edges, parallel, edge, linkage)
                strength = edges.strength[parallel]
                if not edges.forbidden[parallel] and (cannot_link or strength > 0):
                    size = push(heap, size, abs(strength), parallel)
            else:
                node[half] = kept
                _append(incidence, kept, half)
        half = upcoming
    half = incidence.head[kept]
    while half >= 0:
        edge_to[node[half ^ 1]] = -1
        half = following[half]
    return size


@compiled(inline="always")
def _append(incidence: _Incidence, node: int, half: int) -> None:
    """Append a half-edge to the list of a node."""
    last = incidence.tail[node]
    if last < 0:
        incidence.head[node] = half
    else:
        incidence.following[last] = half
    incidence.following[half] = -1
    incidence.tail[node] = half
    incidence.degree[node] += 1


@compiled(inline="always")
def _absorb(edges: _Edges, stays: int, goes: int, linkage: int) -> None:
    """Combine two parallel edges into `stays`; `goes` dies."""
    total, share = edges.total, edges.share
    if linkage == _ABSOLUTE_MAXIMUM:
        if abs(total[goes]) > abs(total[stays]):
            total[stays] = total[goes]
        edges.strength[stays] = total[stays]
    else:
        total[stays] += total[goes]
        share[stays] += share[goes]
        edges.strength[stays] = total[stays] / share[stays] if linkage == _MEAN else total[stays]
    edges.forbidden[stays] |= edges.forbidden[goes]
    edges.alive[goes] = False
