"""Connected components of the edges above a threshold: the partition of the SupeRGB-D paper."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgbd.machine.compiled import compiled
from sgbd.machine.union_find import find_root
from sgbd.partition.partitioner import number_by_first_appearance
from sgbd.partition.threshold_partitioner import ThresholdPartitioner


class ConnectedComponents(ThresholdPartitioner):
    """Joins all superpixels that are linked by edges with a merge probability above the threshold.

    Fast and simple, but one false merge anywhere between two objects joins them. From E. P. Örnek et al.,
    "SupeRGB-D", IEEE RA-L 8(6), 2023, arXiv:2212.11922.

    Args:
        threshold: An edge is kept if its probability is greater than this.
        objectness_weight: How much a difference in objectness lowers the probability of an edge, see
            `sgbd.partition.partitioner.joint_probability`; 0, as in the paper, ignores objectness.
    """

    def __init__(self, threshold: float = 0.5, objectness_weight: float = 0.0) -> None:
        super().__init__(threshold, objectness_weight)

    def partition(
        self,
        num_nodes: int,
        pairs: NDArray[np.int64],
        probability: NDArray[np.float64],
        border_length: NDArray[np.float64],
    ) -> NDArray[np.int64]:
        """Partition a graph; border lengths are ignored."""
        return connected_components(num_nodes, pairs[:, probability > self.threshold])


def connected_components(num_nodes: int, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Group the nodes of a graph that are linked by edges, directly or through other nodes.

    SciPy's function of the same name does this too, but importing it takes a third of a second and 20 MiB on a robot.

    Args:
        num_nodes: Number of nodes N.
        pairs: int64 [2, E], the ends of each edge, in any order; repetitions are allowed.

    Returns:
        int64 [N], the component of each node, numbered in the order of first appearance.
    """
    parents = np.arange(num_nodes)
    _join(np.ascontiguousarray(pairs), parents)
    return number_by_first_appearance(parents)


@compiled
def _join(pairs: NDArray[np.int64], parents: NDArray[np.int64]) -> None:
    """Write the first node of each node's component into `parents`, int64 [N], which holds 0 to N - 1 at first."""
    for edge in range(pairs.shape[1]):
        one, other = find_root(parents, pairs[0, edge]), find_root(parents, pairs[1, edge])
        if one < other:
            parents[other] = one
        else:
            parents[one] = other
    # A node's parent never has a larger index, so it already points to its root when the node's turn comes.
    for node in range(len(parents)):
        parents[node] = parents[parents[node]]
