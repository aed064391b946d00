"""Mutex watershed: the most certain edges decide first, and a decision not to merge is final."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgbd.partition.contraction import agglomerate
from sgbd.partition.edge_weight import EDGE_EPSILON, BorderWeight
from sgbd.partition.threshold_partitioner import SignedWeightPartitioner


class MutexWatershed(SignedWeightPartitioner):
    """Processes edges from the most to the least certain; each either joins its segments or forbids them to be joined.

    An edge above the threshold joins its two segments unless that is forbidden. An edge below it forbids its segments,
    and all segments that contain them, to be joined. One certain cut outweighs any number of doubtful merges, and the
    other way round. S. Wolf, A. Bailoni, C. Pape, N. Rahaman, A. Kreshuk, U. Köthe, F. A. Hamprecht, "The mutex
    watershed and its objective: efficient, parameter-free graph partitioning", IEEE TPAMI 43(10), 2021,
    doi:10.1109/TPAMI.2020.2980827.

    The certainty of an edge is |logit(p) - logit(threshold)| · s, where s is 1, the border length or log(1 + border
    length). Equally certain edges are processed in the order of their ends.

    Args:
        threshold: Merge probability at which an edge has weight 0.
        border_weight: "none", "length" or "log".
        epsilon: Probabilities are clipped to [epsilon, 1 - epsilon].
        objectness_weight: How much a difference in objectness lowers the probability of an edge, see
            `sgbd.partition.partitioner.joint_probability`; 0 ignores objectness.
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
