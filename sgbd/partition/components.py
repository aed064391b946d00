"""Connected components of the edges that are kept: the partition of the SupeRGB-D paper."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.partition.partitioner import (
    check_graph,
    check_objectness_weight,
    check_threshold,
    joint_probability,
    number_by_first_appearance,
)


class ConnectedComponents:
    """Joins whatever is linked by edges with a merge probability above the threshold.

    Fast and simple, but one false merge anywhere between two objects joins them. From E. P. Örnek et al.,
    "SupeRGB-D", IEEE RA-L 8(6), 2023, arXiv:2212.11922.

    Args:
        threshold: an edge is kept if its probability is greater.
        objectness_weight: how much differing objectness lowers it, see `sgbd.partition.partitioner.joint_probability`;
            0, as in the paper, for not at all.
    """

    def __init__(self, threshold: float = 0.5, objectness_weight: float = 0.0) -> None:
        self.threshold = check_threshold(threshold)
        self.objectness_weight = check_objectness_weight(objectness_weight)

    def __call__(
        self,
        num_nodes: int,
        pairs: ArrayLike,
        probability: ArrayLike,
        border_length: ArrayLike,
        objectness: ArrayLike | None = None,
    ) -> NDArray[np.int64]:
        """Partition a graph; see `sgbd.partition.Partitioner`. Border lengths play no part."""
        ends, merge, _ = check_graph(num_nodes, pairs, probability, border_length)
        if num_nodes == 0:
            return np.empty(0, dtype=np.int64)
        merge = joint_probability(ends, merge, objectness, self.objectness_weight)
        # Here, for a multicut not to wait for what it does not use.
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        kept = ends[:, merge > self.threshold]
        graph = coo_array((np.ones(kept.shape[1], dtype=np.int8), (kept[0], kept[1])), shape=(num_nodes, num_nodes))
        _, group = connected_components(graph, directed=False)
        return number_by_first_appearance(group)

    def __repr__(self) -> str:
        return f"{type(self).__name__}(threshold={self.threshold}, objectness_weight={self.objectness_weight})"
