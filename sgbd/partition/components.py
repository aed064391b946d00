"""Connected components of the edges that are kept: the partition of the SupeRGB-D paper."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgbd.partition.partitioner import number_by_first_appearance
from sgbd.partition.threshold_partitioner import ThresholdPartitioner


class ConnectedComponents(ThresholdPartitioner):
    """Joins whatever is linked by edges with a merge probability above the threshold.

    Fast and simple, but one false merge anywhere between two objects joins them. From E. P. Örnek et al.,
    "SupeRGB-D", IEEE RA-L 8(6), 2023, arXiv:2212.11922.

    Args:
        threshold: an edge is kept if its probability is greater.
        objectness_weight: how much differing objectness lowers it, see `sgbd.partition.partitioner.joint_probability`;
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
        if num_nodes == 0:
            return np.empty(0, dtype=np.int64)
        # Here, for a multicut not to wait for what it does not use.
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        kept = pairs[:, probability > self.threshold]
        graph = coo_array((np.ones(kept.shape[1], dtype=np.int8), (kept[0], kept[1])), shape=(num_nodes, num_nodes))
        _, group = connected_components(graph, directed=False)
        return number_by_first_appearance(group)
