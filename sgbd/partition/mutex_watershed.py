"""Mutex watershed: the surest edges decide first, for merging or against it for good."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgbd.partition.contraction import agglomerate
from sgbd.partition.edge_weight import EDGE_EPSILON, BorderWeight
from sgbd.partition.threshold_partitioner import SignedWeightPartitioner


class MutexWatershed(SignedWeightPartitioner):
    """Goes through the edges from the surest to the least sure one; each either joins or forbids to join.

    An edge above the threshold joins its two segments, unless that is forbidden; one below forbids them, and all that
    they become part of, to be joined. S. Wolf, A. Bailoni, C. Pape, N. Rahaman, A. Kreshuk, U. Köthe, F. A. Hamprecht,
    "The mutex watershed and its objective: efficient, parameter-free graph partitioning", IEEE TPAMI 43(10), 2021,
    doi:10.1109/TPAMI.2020.2980827. One sure cut outweighs any number of doubtful merges, and the other way round.

    An edge is as sure as |logit(p) - logit(threshold)| · s is large, where s is 1, the border length or log(1 + border
    length). Equally sure edges come in the order of their ends.

    Args:
        threshold: Merge probability at which an edge is indifferent.
        border_weight: "none", "length" or "log".
        epsilon: Probabilities are clipped to [epsilon, 1 - epsilon].
        objectness_weight: How much differing objectness lowers the probability of an edge, see
            `sgbd.partition.partitioner.joint_probability`; 0 for not at all.
    """

    def __init__(
        self,
        threshold: float = 0.5,
        border_weight: BorderWeight = "none",
        epsilon: float = EDGE_EPSILON,
        objectness_weight: float = 0.0,
    ) -> None:
        super().__init__(threshold, border_weight, epsilon, objectness_weight)

    def solve(self, num_nodes: int, pairs: NDArray[np.int64], weight: NDArray[np.float64]) -> NDArray[np.int64]:
        """Partition a graph with signed weights; see `SignedWeightPartitioner.solve`."""
        return agglomerate(num_nodes, pairs, weight, "absolute_maximum", cannot_link=True)
