"""Multicut: the partition that agrees best with all edges at once.

Every edge has a signed weight: positive favours merging, negative cutting. The multicut problem asks for the partition
whose cut edges have the least total weight; the number of segments follows from it. Other edges along the same border
can outvote a wrong edge, which connected components do not allow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgbd.partition.contraction import agglomerate
from sgbd.partition.threshold_partitioner import SignedWeightPartitioner


class GreedyMulticut(SignedWeightPartitioner):
    """Greedy additive edge contraction (GAEC).

    Contracts the edge of greatest weight and adds up the weights of edges that become parallel, until no weight is
    positive. M. Keuper, E. Levinkov, N. Bonneel, G. Lavoué, T. Brox, B. Andres, "Efficient decomposition of image and
    mesh graphs by lifted multicuts", ICCV 2015, algorithm 1, doi:10.1109/ICCV.2015.204.

    The weight of an edge is (logit(p) - logit(threshold)) · s, where s is the border length, log(1 + border length)
    or 1. With s = border length, every pixel of the border has one vote. The result is a local optimum, where joining
    any two segments would not lower the cost; it isn't always the global one.

    Edges of equal weight are contracted in the order of their ends. The result is therefore deterministic and does not
    depend on the order of the pairs, except through the rounding of sums.

    Args:
        threshold: Merge probability at which an edge has weight 0.
        border_weight: "length", "log" or "none".
        epsilon: Probabilities are clipped to [epsilon, 1 - epsilon], so that 0 and 1 have finite weights.
        objectness_weight: How much a difference in objectness lowers the probability of an edge, see
            `sgbd.partition.partitioner.joint_probability`; 0 ignores objectness.
    """

    def solve(self, num_nodes: int, pairs: NDArray[np.int64], weight: NDArray[np.float64]) -> NDArray[np.int64]:
        """Partition a graph with signed weights; see `SignedWeightPartitioner.solve`."""
        return greedy_additive_edge_contraction(num_nodes, pairs, weight)


def multicut_cost(pairs: NDArray[np.int64], weight: NDArray[np.float64], segment: NDArray[np.int64]) -> float:
    """Return the total weight of the edges between different segments; the multicut minimises it.

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
        num_nodes: Number of superpixels N.
        pairs: int64 [2, E], ends of each edge, no loops. Repeated pairs count as one edge with the sum of the weights.
        weight: float64 [E], positive for merging.

    Returns:
        int64 [N], segment of each superpixel, numbered in the order of first appearance.
    """
    return agglomerate(num_nodes, pairs, weight)
