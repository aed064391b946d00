"""Mutex watershed: the surest edges decide first, for merging or against it for good."""

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


class MutexWatershed:
    """Goes through the edges from the surest to the least sure one; each either joins or forbids to join.

    An edge above the threshold joins its two segments, unless that is forbidden; one below forbids them, and all that
    they become part of, to be joined. S. Wolf, A. Bailoni, C. Pape, N. Rahaman, A. Kreshuk, U. Köthe, F. A. Hamprecht,
    "The mutex watershed and its objective: efficient, parameter-free graph partitioning", IEEE TPAMI 43(10), 2021,
    doi:10.1109/TPAMI.2020.2980827. One sure cut outweighs any number of doubtful merges, and the other way round.

    An edge is as sure as |logit(p) - logit(threshold)| · s is large, where s is 1, the border length or log(1 + border
    length). Equally sure edges come in the order of their ends.

    Args:
        threshold: merge probability at which an edge is indifferent.
        border_weight: "none", "length" or "log".
        epsilon: probabilities are clipped to [epsilon, 1 - epsilon].
        objectness_weight: how much differing objectness lowers the probability of an edge, see
            `sgbd.partition.partitioner.joint_probability`; 0 for not at all.
    """

    def __init__(
        self,
        threshold: float = 0.5,
        border_weight: BorderWeight = "none",
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
        weight = logit_weights(merge, self.threshold, self.epsilon) * border_share(length, self.border_weight)
        return agglomerate(num_nodes, ends, weight, "absolute_maximum", cannot_link=True)

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(threshold={self.threshold}, border_weight={self.border_weight!r}, "
            f"epsilon={self.epsilon}, objectness_weight={self.objectness_weight})"
        )
