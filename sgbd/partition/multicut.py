"""Multicut: the partition that agrees best with all edges at once.

Every edge has a signed weight, positive where it speaks for merging and negative where it speaks for cutting. The
multicut problem asks for the partition whose cut edges have the least total weight; the number of segments follows.
One wrong edge is outvoted by the others along the same border, which is what connected components lack.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.compiled import compiled
from sgbd.partition.partitioner import check_graph, check_threshold, number_by_first_appearance

BorderWeight = Literal["length", "log", "none"]


class GreedyMulticut:
    """Greedy additive edge contraction (GAEC).

    Contracts the edge of greatest weight, adds up the weights of edges that become parallel, and goes on until no
    weight is positive. M. Keuper, E. Levinkov, N. Bonneel, G. Lavoué, T. Brox, B. Andres, "Efficient decomposition of
    image and mesh graphs by lifted multicuts", ICCV 2015, algorithm 1, doi:10.1109/ICCV.2015.204.

    The weight of an edge is (logit(p) - logit(threshold)) · s, where s is the border length, log(1 + border length)
    or 1. With s = border length every pixel of the border has one vote. The result is a local optimum: joining no two
    segments lowers the cost. It isn't always the global one.

    Equal weights are contracted in the order of the edges' ends, so the result doesn't depend on chance or on the
    order of the pairs (but for the rounding of sums).

    Args:
        threshold: merge probability at which an edge is indifferent.
        border_weight: "length", "log" or "none".
        epsilon: probabilities are clipped to [epsilon, 1 - epsilon], so that 0 and 1 have finite weights.
    """

    def __init__(self, threshold: float = 0.5, border_weight: BorderWeight = "length", epsilon: float = 1e-6) -> None:
        self.threshold = check_threshold(threshold)
        if border_weight not in ("length", "log", "none"):
            raise ValueError(f"border_weight must be 'length', 'log' or 'none', got {border_weight!r}")
        if not 0 < epsilon < 0.5:
            raise ValueError(f"epsilon must be between 0 and 0.5 (both excluded), got {epsilon}")
        self.border_weight: BorderWeight = border_weight
        self.epsilon = float(epsilon)

    def __call__(
        self, num_nodes: int, pairs: ArrayLike, probability: ArrayLike, border_length: ArrayLike
    ) -> NDArray[np.int64]:
        """Partition a graph; see `sgbd.partition.Partitioner`."""
        ends, merge, length = check_graph(num_nodes, pairs, probability, border_length)
        return greedy_additive_edge_contraction(num_nodes, ends, self.weights(merge, length))

    def weights(self, probability: ArrayLike, border_length: ArrayLike) -> NDArray[np.float64]:
        """Signed weight of each edge, float64 [E]: positive for merging, negative for cutting.

        Args:
            probability: float [E], merge probabilities.
            border_length: float [E], pixels.
        """
        p = np.clip(np.asarray(probability, dtype=np.float64), self.epsilon, 1 - self.epsilon)
        weight = np.log(p / (1 - p)) - np.log(self.threshold / (1 - self.threshold))
        if self.border_weight == "length":
            return weight * np.asarray(border_length, dtype=np.float64)
        if self.border_weight == "log":
            return weight * np.log1p(np.asarray(border_length, dtype=np.float64))
        return weight

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(threshold={self.threshold}, border_weight={self.border_weight!r}, "
            f"epsilon={self.epsilon})"
        )


def multicut_cost(pairs: NDArray[np.int64], weight: NDArray[np.float64], segment: NDArray[np.int64]) -> float:
    """Total weight of the edges between different segments; the multicut is the partition where it is least.

    Args:
        pairs: int64 [2, E].
        weight: float64 [E].
        segment: int64 [N], segment of each superpixel.
    """
    return float(weight[segment[pairs[0]] != segment[pairs[1]]].sum())


def greedy_additive_edge_contraction(
    num_nodes: int, pairs: NDArray[np.int64], weight: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Partition a graph with signed edge weights by GAEC; see `GreedyMulticut`.

    Args:
        num_nodes: number of superpixels N.
        pairs: int64 [2, E], ends of each edge, no loops. Repeated pairs count as one with the sum of the weights.
        weight: float64 [E], positive for merging.

    Returns:
        int64 [N], segment of each superpixel, numbered in the order of first appearance.
    """
    if num_nodes == 0:
        return np.empty(0, dtype=np.int64)
    key = np.minimum(pairs[0], pairs[1]) * num_nodes + np.maximum(pairs[0], pairs[1])
    if not (key[1:] > key[:-1]).all():
        key, edge = np.unique(key, return_inverse=True)
        weight = np.bincount(edge, weights=weight, minlength=len(key)).astype(np.float64)
    first, second = np.divmod(key, num_nodes)
    return number_by_first_appearance(_contract(num_nodes, first, second, np.array(weight, dtype=np.float64)))


@compiled
def _push(heap_weight: NDArray[np.float64], heap_edge: NDArray[np.int64], size: int, weight: float, edge: int) -> int:
    """Put an edge into a binary heap with the greatest weight first, of equals the lowest edge; returns its new size.

    As `heapq` does it, but on arrays: no list of tuples is built for every graph, which is a fifth of the time.
    """
    here = size
    while here > 0:
        above = (here - 1) // 2
        if heap_weight[above] > weight or (heap_weight[above] == weight and heap_edge[above] <= edge):
            break
        heap_weight[here], heap_edge[here] = heap_weight[above], heap_edge[above]
        here = above
    heap_weight[here], heap_edge[here] = weight, edge
    return size + 1


@compiled
def _pop(heap_weight: NDArray[np.float64], heap_edge: NDArray[np.int64], size: int) -> int:
    """Take the first edge out of the heap; returns its new size."""
    size -= 1
    weight, edge = heap_weight[size], heap_edge[size]
    here = 0
    while 2 * here + 1 < size:
        below = 2 * here + 1
        other = below + 1
        if other < size and (
            heap_weight[other] > heap_weight[below]
            or (heap_weight[other] == heap_weight[below] and heap_edge[other] < heap_edge[below])
        ):
            below = other
        if weight > heap_weight[below] or (weight == heap_weight[below] and edge <= heap_edge[below]):
            break
        heap_weight[here], heap_edge[here] = heap_weight[below], heap_edge[below]
        here = below
    heap_weight[here], heap_edge[here] = weight, edge
    return size


@compiled
def _contract(
    num_nodes: int, first: NDArray[np.int64], second: NDArray[np.int64], weight: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Contract edges greedily; `weight` is used up. Returns a representative of each superpixel's group."""
    num_edges = len(weight)
    parent = np.arange(num_nodes)
    # Edge e is the two half-edges 2e and 2e + 1; `end` says where a half-edge starts, its other half where it leads.
    # The half-edges of a node form a linked list from `head` to `tail`; those of dead edges are skipped and dropped.
    end = np.empty(2 * num_edges, dtype=np.int64)
    following = np.full(2 * num_edges, -1, dtype=np.int64)
    head = np.full(num_nodes, -1, dtype=np.int64)
    tail = np.full(num_nodes, -1, dtype=np.int64)
    degree = np.zeros(num_nodes, dtype=np.int64)
    alive = np.ones(num_edges, dtype=np.bool_)
    for half in range(2 * num_edges):
        node = first[half >> 1] if half & 1 == 0 else second[half >> 1]
        end[half] = node
        if head[node] < 0:
            head[node] = half
        else:
            following[tail[node]] = half
        tail[node] = half
        degree[node] += 1

    # The heap may hold outdated weights of an edge; they are recognised when they come up. An edge enters it once for
    # itself and once for each edge that it absorbs.
    heap_weight = np.empty(2 * num_edges, dtype=np.float64)
    heap_edge = np.empty(2 * num_edges, dtype=np.int64)
    size = 0
    for edge in range(num_edges):
        if weight[edge] > 0:
            size = _push(heap_weight, heap_edge, size, weight[edge], edge)
    edge_to = np.full(num_nodes, -1, dtype=np.int64)  # the kept node's edge to each of its neighbours
    while size > 0:
        greatest, contracted = heap_weight[0], heap_edge[0]
        size = _pop(heap_weight, heap_edge, size)
        if not alive[contracted] or weight[contracted] != greatest:
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
                neighbour = end[half ^ 1]
                parallel = edge_to[neighbour]
                if parallel >= 0:
                    weight[parallel] += weight[edge]
                    alive[edge] = False
                    if weight[parallel] > 0:
                        size = _push(heap_weight, heap_edge, size, weight[parallel], parallel)
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
    return parent
