"""Multicut: the partition that agrees best with all edges at once.

Every edge has a signed weight, positive where it speaks for merging and negative where it speaks for cutting. The
multicut problem asks for the partition whose cut edges have the least total weight; the number of segments follows.
One wrong edge is outvoted by the others along the same border, which is what connected components lack.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.partition.contraction import agglomerate
from sgbd.partition.edge_weight import (
    EDGE_EPSILON,
    BorderWeight,
    border_share,
    check_border_weight,
    check_epsilon,
    logit_weights,
)
from sgbd.partition.partitioner import check_graph, check_objectness_weight, check_threshold, joint_probability


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
        objectness_weight: how much differing objectness lowers the probability of an edge, see
            `sgbd.partition.partitioner.joint_probability`; 0 for not at all.
    """

    def __init__(
        self,
        threshold: float = 0.5,
        border_weight: BorderWeight = "length",
        epsilon: float = EDGE_EPSILON,
        objectness_weight: float = 0.0,
    ) -> None:
        self.threshold = check_threshold(threshold)
        self.border_weight: BorderWeight = check_border_weight(border_weight)
        self.epsilon = check_epsilon(epsilon)
        self.objectness_weight = check_objectness_weight(objectness_weight)

    def __call__(
        self,
        num_nodes: int,
        pairs: ArrayLike,
        probability: ArrayLike,
        border_length: ArrayLike,
        objectness: ArrayLike | None = None,
    ) -> NDArray[np.int64]:
        """Partition a graph; see `sgbd.partition.Partitioner`."""
        ends, merge, length = check_graph(num_nodes, pairs, probability, border_length)
        merge = joint_probability(ends, merge, objectness, self.objectness_weight)
        return self.solve(num_nodes, ends, self.weights(merge, length))

    def weights(self, probability: ArrayLike, border_length: ArrayLike) -> NDArray[np.float64]:
        """Signed weight of each edge, float64 [E]: positive for merging, negative for cutting.

        Args:
            probability: float [E], merge probabilities.
            border_length: float [E], pixels.
        """
        share = border_share(border_length, self.border_weight)
        return logit_weights(probability, self.threshold, self.epsilon) * share

    def solve(self, num_nodes: int, pairs: NDArray[np.int64], weight: NDArray[np.float64]) -> NDArray[np.int64]:
        """Partition a graph with signed weights; arguments as of `greedy_additive_edge_contraction`."""
        return greedy_additive_edge_contraction(num_nodes, pairs, weight)

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(threshold={self.threshold}, border_weight={self.border_weight!r}, "
            f"epsilon={self.epsilon}, objectness_weight={self.objectness_weight})"
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
    return agglomerate(num_nodes, pairs, weight)
