"""Connected components of the edges that are kept: the partition of the SupeRGB-D paper."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgbd.machine.compiled import compiled
from sgbd.machine.union_find import find_root
from sgbd.partition.partitioner import number_by_first_appearance
from sgbd.partition.threshold_partitioner import ThresholdPartitioner


class ConnectedComponents(ThresholdPartitioner):
    """Joins whatever is linked by edges with a merge probability above the threshold.

    Fast and simple, but one false merge anywhere between two objects joins them. From E. P. Örnek et al.,
    "SupeRGB-D", IEEE RA-L 8(6), 2023, arXiv:2212.11922.

    Args:
        threshold: An edge is kept if its probability is greater.
        objectness_weight: How much differing objectness lowers it, see `sgbd.partition.partitioner.joint_probability`;
            0, as in the paper, for not at all.
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
        """Partition a graph; border lengths play no part."""
        return connected_components(num_nodes, pairs[:, probability > self.threshold])


def connected_components(num_nodes: int, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Group the nodes of a graph that its edges link, directly or over others.

    SciPy's function of that name does the same, but its import costs a robot a third of a second and 20 MiB.

    Args:
        num_nodes: Number of nodes N.
        pairs: int64 [2, E], the ends of each edge, in any order, repeated ones too.

    Returns:
        int64 [N], the component of each node, numbered in the order of first appearance.
    """
    parents = np.arange(num_nodes)
    _join(np.ascontiguousarray(pairs), parents)
    return number_by_first_appearance(parents)


@compiled
def _join(pairs: NDArray[np.int64], parents: NDArray[np.int64]) -> None:
    """Write the first node of its component to every node's place in `parents`, int64 [N], at first 0 to N - 1."""
    for edge in range(pairs.shape[1]):
        one, other = find_root(parents, pairs[0, edge]), find_root(parents, pairs[1, edge])
        if one < other:
            parents[other] = one
        else:
            parents[one] = other
    # No node's parent comes after it, so that every one's is final when its turn comes.
    for node in range(len(parents)):
        parents[node] = parents[parents[node]]
