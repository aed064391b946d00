"""Average-linkage agglomeration: two segments belong together if their common border does on average."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.partition.contraction import agglomerate
from sgbd.partition.edge_weight import BorderWeight, border_share, check_border_weight
from sgbd.partition.partitioner import check_graph, check_objectness_weight, check_threshold, joint_probability


class AverageLinkage:
    """Joins the segments whose common border has the greatest mean merge probability, while that is above a threshold.

    The signed average linkage of GASP (Bailoni et al., CVPR 2022, doi:10.1109/CVPR52688.2022.01135). Unlike in a
    multicut a long border is no stronger than a short one, only surer: what counts is the mean. So large segments don't
    swallow small ones by the sheer length of their border.

    Args:
        threshold: mean merge probability from which segments are joined.
        border_weight: what an edge counts in the mean: "length", its border length (at least one pixel), "log",
            log(1 + border length), or "none", the same as every other.
        cannot_link: whether edges come in the order of their distance from the threshold, and those below it forbid
            their segments to be joined ever. Surer of cuts, and less forgiving to a wrong one.
        objectness_weight: how much differing objectness lowers the probability of an edge, see
            `sgbd.partition.partitioner.joint_probability`; 0 for not at all.
    """

    def __init__(
        self,
        threshold: float = 0.5,
        border_weight: BorderWeight = "length",
        cannot_link: bool = False,
        objectness_weight: float = 0.0,
    ) -> None:
        self.threshold = check_threshold(threshold)
        self.border_weight: BorderWeight = check_border_weight(border_weight)
        self.cannot_link = bool(cannot_link)
        self.objectness_weight = check_objectness_weight(objectness_weight)

    def __call__(
        self,
        num_nodes: int,
        pairs: ArrayLike,
        probability: ArrayLike,
        border_length: ArrayLike,
        objectness: ArrayLike | None = None,
    ) -> NDArray[np.int64]:
        """Partition a graph; see `sgbd.partition.Partitioner`. Pairs that don't touch count like a pixel of border."""
        ends, merge, length = check_graph(num_nodes, pairs, probability, border_length)
        merge = joint_probability(ends, merge, objectness, self.objectness_weight)
        share = border_share(np.maximum(length, 1), self.border_weight)
        return agglomerate(num_nodes, ends, merge - self.threshold, "mean", share, self.cannot_link)

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(threshold={self.threshold}, border_weight={self.border_weight!r}, "
            f"cannot_link={self.cannot_link}, objectness_weight={self.objectness_weight})"
        )
