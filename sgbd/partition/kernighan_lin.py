"""Multicut with Kernighan-Lin refinement: a greedy partition, improved by moving superpixels between its segments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sgbd.machine.compiled import compiled
from sgbd.machine.linked_lists import LinkedLists, prepend, unlink
from sgbd.partition.components import connected_components
from sgbd.partition.edge_weight import EDGE_EPSILON, BorderWeight
from sgbd.partition.heap import Heap, pop, push
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
        threshold: As in `GreedyMulticut`.
        border_weight: As in `GreedyMulticut`.
        epsilon: As in `GreedyMulticut`.
        objectness_weight: As in `GreedyMulticut`.
        max_rounds: Rounds over all pairs of segments that have changed; 0 leaves the greedy partition as it is.
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
    refined = number_by_first_appearance(segment)
    _refine(_Graph.of(pairs, weight, len(segment)), refined, max_rounds)
    # A superpixel that moved may have held two parts of its segment together.
    inner = pairs[:, refined[pairs[0]] == refined[pairs[1]]]
    refined = connected_components(len(refined), inner)
    # Gains are sums in another order than costs; where they differ by rounding alone, nothing was gained.
    better = multicut_cost(pairs, weight, refined) <= multicut_cost(pairs, weight, segment)
    return refined if better else number_by_first_appearance(segment)


class _Graph(NamedTuple):
    """A graph by the neighbours of each node: node v has the directed edges `offset[v]` to `offset[v + 1]` - 1.

    Attributes:
        offset: int64 [N + 1].
        source: int64 [2 E], ascending: where each directed edge starts.
        target: int64 [2 E], where it leads.
        weight: float64 [2 E].
    """

    offset: NDArray[np.int64]
    source: NDArray[np.int64]
    target: NDArray[np.int64]
    weight: NDArray[np.float64]

    @classmethod
    def of(cls, pairs: NDArray[np.int64], weight: NDArray[np.float64], num_nodes: int) -> _Graph:
        source, target = np.concatenate([pairs, pairs[::-1]], axis=1)
        # Canonical order, so that neither the order nor the direction of the pairs decides between equal moves.
        order = np.lexsort((target, source))
        offset = np.concatenate([[0], np.cumsum(np.bincount(source, minlength=num_nodes))])
        return cls(offset, source[order], target[order], np.concatenate([weight, weight])[order])


class _Work(NamedTuple):
    """What moving superpixels between two segments is worked out in; nothing in it outlasts a call of `_improve`.

    Attributes:
        gain: float64 [N], by how much it lowers the cost to move a superpixel to the other segment.
        moved: bool [N], whether it has been moved.
        sequence: int64 [N], the superpixels in the order in which they were moved.
        heap: Superpixels by gain; some wait in it with gains that have changed since.
    """

    gain: NDArray[np.float64]
    moved: NDArray[np.bool_]
    sequence: NDArray[np.int64]
    heap: Heap

    @classmethod
    def for_graph(cls, graph: _Graph) -> _Work:
        num_nodes = len(graph.offset) - 1
        # A superpixel enters the heap once for itself and once for every neighbour that moves.
        heap = Heap.with_room(len(graph.target) + num_nodes)
        return cls(np.zeros(num_nodes), np.zeros(num_nodes, np.bool_), np.empty(num_nodes, np.int64), heap)


def _refine(graph: _Graph, segment: NDArray[np.int64], max_rounds: int) -> None:
    """Improve a partition in place, until nothing gains any more."""
    num_nodes = len(segment)
    # A label without members is free for the next split.
    members = LinkedLists.empty(num_nodes, num_nodes)
    _list_members(segment, members)
    work = _Work.for_graph(graph)
    # Gains below are what rounding leaves over.
    tolerance = 1e-12 * float(np.abs(graph.weight).sum())
    changed = np.ones(num_nodes, dtype=np.bool_)
    for _ in range(max_rounds):
        a, b = segment[graph.source], segment[graph.target]
        waiting = (a < b) & (changed[a] | changed[b])
        borders = np.unique(a[waiting] * num_nodes + b[waiting])
        before, changed = changed, np.zeros_like(changed)
        _improve_borders(borders, graph, segment, members, work, tolerance, changed)
        _split_segments(before, graph, segment, members, work, tolerance, changed)
        if not changed.any():
            break


@compiled
def _list_members(segment: NDArray[np.int64], members: LinkedLists) -> None:
    for node in range(len(segment)):
        prepend(members, segment[node], node)


@compiled
def _improve_borders(
    borders: NDArray[np.int64],
    graph: _Graph,
    segment: NDArray[np.int64],
    members: LinkedLists,
    work: _Work,
    tolerance: float,
    changed: NDArray[np.bool_],
) -> None:
    """Improve neighbouring segments, two by two; marks those that `changed`.

    Args:
        borders: int64 [B], a · N + b for segments a < b that touched at the beginning of the round.
        graph: The graph.
        segment: int64 [N], segment of each superpixel; changed, as the following.
        members: Superpixels of each segment.
        work: To work in.
        tolerance: What counts as no gain.
        changed: bool [N], by segment.
    """
    for border in borders:
        a, b = border // len(segment), border % len(segment)
        # One may have been joined with another meanwhile.
        if members.head[a] >= 0 and members.head[b] >= 0 and _improve(a, b, graph, segment, members, work, tolerance):
            changed[a] = changed[b] = True


@compiled
def _split_segments(
    before: NDArray[np.bool_],
    graph: _Graph,
    segment: NDArray[np.int64],
    members: LinkedLists,
    work: _Work,
    tolerance: float,
    changed: NDArray[np.bool_],
) -> None:
    """Split segments that changed in the last round (`before`) or in this one; else as `_improve_borders`."""
    empty = 0
    for a in range(len(segment)):
        if members.head[a] < 0 or not (before[a] or changed[a]):
            continue
        while empty < len(segment) and members.head[empty] >= 0:
            empty += 1
        if empty == len(segment):
            break
        if _improve(a, empty, graph, segment, members, work, tolerance):
            changed[a] = changed[empty] = True
            empty = 0


@compiled
def _improve(
    a: int,
    b: int,
    graph: _Graph,
    segment: NDArray[np.int64],
    members: LinkedLists,
    work: _Work,
    tolerance: float,
) -> bool:
    """Move superpixels between the segments a and b (which may be empty), or join them; says whether it gained."""
    between, size = _weigh_moves(a, b, graph, segment, members, work)
    gains, moved, sequence, heap = work
    total = best = 0.0
    length = best_length = 0
    while size > 0 and length - best_length < PATIENCE:
        gain, node = heap.key[0], heap.item[0]
        size = pop(heap, size)
        if moved[node] or gain != gains[node]:
            continue
        size = _move_and_weigh(node, a, b, graph, segment, members, work, size)
        sequence[length] = node
        length += 1
        total += gain
        if total > best + tolerance:
            best, best_length = total, length
    join = between > tolerance and between >= best
    # Take back what came after the best state, or all if joining is better still.
    for k in range(length - 1, -1 if join else best_length - 1, -1):
        node = sequence[k]
        _move(node, b if segment[node] == a else a, segment, members)
    while join and members.head[b] >= 0:
        _move(members.head[b], a, segment, members)
    return join or best_length > 0


@compiled(inline="always")
def _weigh_moves(
    a: int, b: int, graph: _Graph, segment: NDArray[np.int64], members: LinkedLists, work: _Work
) -> tuple[float, int]:
    """Work out what moving each superpixel of two segments to the other gains, and put those at the border in the heap.

    The gain is the sum of the weights to the other segment less those to its own. If a segment is empty, every
    superpixel of the other may begin it.

    Returns:
        The sum of the weights between the two segments, and the size of the heap.
    """
    offset, _, target, weight = graph
    gain, moved = work.gain, work.moved
    between = 0.0
    size: int = np.int64(0)  # type: ignore[assignment]  # see sgbd.machine.compiled
    for side in range(2):
        here, there = (a, b) if side == 0 else (b, a)
        node = members.head[here]
        while node >= 0:
            gain[node] = 0.0
            moved[node] = False
            at_border = members.head[there] < 0
            for k in range(offset[node], offset[node + 1]):
                other = segment[target[k]]
                if other == there:
                    gain[node] += weight[k]
                    between += 0.5 * weight[k]
                    at_border = True
                elif other == here:
                    gain[node] -= weight[k]
            if at_border:
                size = push(work.heap, size, gain[node], node)
            node = members.following[node]
    return between, size


@compiled(inline="always")
def _move_and_weigh(
    node: int, a: int, b: int, graph: _Graph, segment: NDArray[np.int64], members: LinkedLists, work: _Work, size: int
) -> int:
    """Move a superpixel to the other segment, and put its neighbours in the heap with what moving them gains now.

    Returns:
        The new size of the heap.
    """
    offset, _, target, weight = graph
    gain, moved = work.gain, work.moved
    here = segment[node]
    moved[node] = True
    _move(node, b if here == a else a, segment, members)
    for k in range(offset[node], offset[node + 1]):
        other = target[k]
        if (segment[other] == a or segment[other] == b) and not moved[other]:
            gain[other] += 2 * weight[k] if segment[other] == here else -2 * weight[k]
            size = push(work.heap, size, gain[other], other)
    return size


@compiled(inline="always")
def _move(node: int, label: int, segment: NDArray[np.int64], members: LinkedLists) -> None:
    """Move a superpixel to a segment."""
    unlink(members, segment[node], node)
    prepend(members, label, node)
    segment[node] = label
