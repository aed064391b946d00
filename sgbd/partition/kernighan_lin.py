"""Multicut with Kernighan-Lin refinement: a greedy partition, improved by moving superpixels between its segments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgbd.machine.compiled import compiled
from sgbd.partition.components import connected_components
from sgbd.partition.edge_weight import EDGE_EPSILON, BorderWeight
from sgbd.partition.heap import pop, push
from sgbd.partition.multicut import GreedyMulticut, greedy_additive_edge_contraction, multicut_cost
from sgbd.partition.partitioner import number_by_first_appearance

PATIENCE = 50
"""Moves between two segments without a new best after which no further ones are tried."""


class Multicut(GreedyMulticut):
    """Greedy additive edge contraction, then Kernighan-Lin moves with joins (KLj).

    What the greedy contraction joined too early can be taken back: between every two neighbouring segments superpixels
    change sides one after another, those first that gain most or cost least, and the best beginning of that sequence
    is kept; or the two are joined, or a segment is split. M. Keuper et al., "Efficient decomposition of image and mesh
    graphs by lifted multicuts", ICCV 2015, algorithm 2, doi:10.1109/ICCV.2015.204.

    The cost of the result is never above that of `GreedyMulticut`.

    Args:
        threshold: as in `GreedyMulticut`.
        border_weight: as in `GreedyMulticut`.
        epsilon: as in `GreedyMulticut`.
        objectness_weight: as in `GreedyMulticut`.
        max_rounds: rounds over all pairs of segments that have changed; 0 leaves the greedy partition as it is.
    """

    def __init__(
        self,
        threshold: float = 0.5,
        border_weight: BorderWeight = "length",
        epsilon: float = EDGE_EPSILON,
        objectness_weight: float = 0.0,
        max_rounds: int = 20,
    ) -> None:
        super().__init__(threshold, border_weight, epsilon, objectness_weight)
        if isinstance(max_rounds, bool) or not isinstance(max_rounds, int) or max_rounds < 0:
            raise ValueError(f"max_rounds must be an integer from 0 on, got {max_rounds!r}")
        self.max_rounds = max_rounds

    def solve(self, num_nodes: int, pairs: NDArray[np.int64], weight: NDArray[np.float64]) -> NDArray[np.int64]:
        """Partition a graph with signed weights."""
        segment = greedy_additive_edge_contraction(num_nodes, pairs, weight)
        return kernighan_lin(pairs, weight, segment, self.max_rounds)


def kernighan_lin(
    pairs: NDArray[np.int64], weight: NDArray[np.float64], segment: NDArray[np.int64], max_rounds: int = 20
) -> NDArray[np.int64]:
    """Refine a partition of a graph with signed edge weights; see `Multicut`.

    Args:
        pairs: int64 [2, E], ends of each edge, no loops.
        weight: float64 [E], positive for merging.
        segment: int64 [N], the partition to start from.
        max_rounds: Rounds over all pairs of segments that have changed.

    Returns:
        int64 [N], a partition into connected segments that costs no more, numbered in the order of first appearance.
    """
    if pairs.size == 0 or max_rounds == 0:
        return number_by_first_appearance(segment)
    num_nodes = len(segment)
    # Canonical order, so that neither the order nor the direction of the pairs decides between equal moves.
    source, target = np.concatenate([pairs, pairs[::-1]], axis=1)
    order = np.lexsort((target, source))
    offset = np.concatenate([[0], np.cumsum(np.bincount(source, minlength=num_nodes))])
    refined = number_by_first_appearance(segment)
    _refine(offset, target[order], np.concatenate([weight, weight])[order], refined, max_rounds)
    # A moved superpixel may have held two parts of its segment together.
    inner = pairs[:, refined[pairs[0]] == refined[pairs[1]]]
    refined = connected_components(num_nodes, inner)
    # Gains are sums in another order than costs; where they differ by rounding alone, nothing was gained.
    better = multicut_cost(pairs, weight, refined) <= multicut_cost(pairs, weight, segment)
    return refined if better else number_by_first_appearance(segment)


@compiled
def _refine(
    offset: NDArray[np.int64],
    neighbor: NDArray[np.int64],
    weight: NDArray[np.float64],
    segment: NDArray[np.int64],
    max_rounds: int,
) -> None:
    """Improve `segment` in place; the neighbours of node v are `neighbor[offset[v] : offset[v + 1]]`."""
    num_nodes = len(segment)
    # Members of each segment as a doubly linked list; a label without any is free for the next split.
    head = np.full(num_nodes, -1, dtype=np.int64)
    following = np.full(num_nodes, -1, dtype=np.int64)
    preceding = np.full(num_nodes, -1, dtype=np.int64)
    for node in range(num_nodes):
        _enter(node, segment[node], head, following, preceding)
    tolerance = 1e-12 * np.abs(weight).sum()
    gain = np.zeros(num_nodes, dtype=np.float64)
    moved = np.zeros(num_nodes, dtype=np.bool_)
    sequence = np.empty(num_nodes, dtype=np.int64)
    # A node enters the heap once for itself and once for every neighbour that moves.
    heap_key = np.empty(len(neighbor) + num_nodes, dtype=np.float64)
    heap_node = np.empty(len(neighbor) + num_nodes, dtype=np.int64)
    changed = np.ones(num_nodes, dtype=np.bool_)
    for _ in range(max_rounds):
        keys = np.empty(len(neighbor), dtype=np.int64)
        count = 0
        for node in range(num_nodes):
            for k in range(offset[node], offset[node + 1]):
                a, b = segment[node], segment[neighbor[k]]
                if a < b and (changed[a] or changed[b]):
                    keys[count] = a * num_nodes + b
                    count += 1
        borders = np.unique(keys[:count])
        before = changed.copy()
        changed[:] = False
        improved = False
        for key in borders:
            a, b = key // num_nodes, key % num_nodes
            if head[a] >= 0 and head[b] >= 0 and _improve(
                a, b, offset, neighbor, weight, segment, head, following, preceding,
                gain, moved, sequence, heap_key, heap_node, tolerance,
            ):  # fmt: skip
                changed[a] = changed[b] = improved = True
        empty = 0
        for a in range(num_nodes):
            if head[a] < 0 or not (before[a] or changed[a]):
                continue
            while empty < num_nodes and head[empty] >= 0:
                empty += 1
            if empty == num_nodes:
                break
            if _improve(
                a, empty, offset, neighbor, weight, segment, head, following, preceding,
                gain, moved, sequence, heap_key, heap_node, tolerance,
            ):  # fmt: skip
                changed[a] = changed[empty] = improved = True
                empty = 0
        if not improved:
            break


@compiled
def _improve(
    a: int,
    b: int,
    offset: NDArray[np.int64],
    neighbor: NDArray[np.int64],
    weight: NDArray[np.float64],
    segment: NDArray[np.int64],
    head: NDArray[np.int64],
    following: NDArray[np.int64],
    preceding: NDArray[np.int64],
    gain: NDArray[np.float64],
    moved: NDArray[np.bool_],
    sequence: NDArray[np.int64],
    heap_key: NDArray[np.float64],
    heap_node: NDArray[np.int64],
    tolerance: float,
) -> bool:
    """Move superpixels between the segments a and b (which may be empty), or join them; says whether it gained."""
    # What it gains to move a superpixel: the weights to the other segment less those to its own.
    between = 0.0
    size: int = np.int64(0)  # type: ignore[assignment]  # see sgbd.machine.compiled
    for side in range(2):
        here, there = (a, b) if side == 0 else (b, a)
        node = head[here]
        while node >= 0:
            gain[node] = 0.0
            moved[node] = False
            at_border = head[there] < 0
            for k in range(offset[node], offset[node + 1]):
                other = segment[neighbor[k]]
                if other == there:
                    gain[node] += weight[k]
                    between += 0.5 * weight[k]
                    at_border = True
                elif other == here:
                    gain[node] -= weight[k]
            if at_border:
                size = push(heap_key, heap_node, size, gain[node], node)
            node = following[node]

    total = best = 0.0
    length = best_length = 0
    while size > 0 and length - best_length < PATIENCE:
        key, node = heap_key[0], heap_node[0]
        size = pop(heap_key, heap_node, size)
        if moved[node] or key != gain[node]:
            continue
        total += gain[node]
        moved[node] = True
        sequence[length] = node
        length += 1
        here = segment[node]
        there = b if here == a else a
        _leave(node, here, head, following, preceding)
        _enter(node, there, head, following, preceding)
        segment[node] = there
        if total > best + tolerance:
            best, best_length = total, length
        for k in range(offset[node], offset[node + 1]):
            other = neighbor[k]
            if (segment[other] == a or segment[other] == b) and not moved[other]:
                gain[other] += 2 * weight[k] if segment[other] == here else -2 * weight[k]
                size = push(heap_key, heap_node, size, gain[other], other)

    join = between > tolerance and between >= best
    for k in range(length - 1, -1 if join else best_length - 1, -1):
        node = sequence[k]
        here = segment[node]
        there = b if here == a else a
        _leave(node, here, head, following, preceding)
        _enter(node, there, head, following, preceding)
        segment[node] = there
    if join:
        while head[b] >= 0:
            node = head[b]
            _leave(node, b, head, following, preceding)
            _enter(node, a, head, following, preceding)
            segment[node] = a
    return join or best_length > 0


@compiled
def _enter(
    node: int, label: int, head: NDArray[np.int64], following: NDArray[np.int64], preceding: NDArray[np.int64]
) -> None:
    """Put a node into the list of a segment."""
    preceding[node], following[node] = -1, head[label]
    if head[label] >= 0:
        preceding[head[label]] = node
    head[label] = node


@compiled
def _leave(
    node: int, label: int, head: NDArray[np.int64], following: NDArray[np.int64], preceding: NDArray[np.int64]
) -> None:
    """Take a node out of the list of its segment."""
    if preceding[node] >= 0:
        following[preceding[node]] = following[node]
    else:
        head[label] = following[node]
    if following[node] >= 0:
        preceding[following[node]] = preceding[node]
