"""Average-linkage agglomeration: two segments belong together if their common border does on average."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgbd.partition.contraction import agglomerate
from sgbd.partition.edge_weight import BorderWeight, border_share, check_border_weight
from sgbd.partition.threshold_partitioner import ThresholdPartitioner


class AverageLinkage(ThresholdPartitioner):
    """Joins the segments whose common border has the greatest mean merge probability, while that is above a threshold.

    The signed average linkage of GASP (Bailoni et al., CVPR 2022, doi:10.1109/CVPR52688.2022.01135). Unlike in a
    multicut a long border is no stronger than a short one, only surer: what counts is the mean. So large segments don't
    swallow small ones by the sheer length of their border.

    Args:
        threshold: Mean merge probability from which segments are joined.
        border_weight: What an edge counts in the mean: "length", its border length (at least one pixel), "log",
            log(1 + border length), or "none", the same as every other.
        cannot_link: Whether edges come in the order of their distance from the threshold, and those below it forbid
            their segments to be joined ever. Surer of cuts, and less forgiving to a wrong one.
        objectness_weight: How much differing objectness lowers the probability of an edge, see
            `sgbd.partition.partitioner.joint_probability`; 0 for not at all.
    """

    def __init__(
        self,
        threshold: float = 0.5,
        border_weight: BorderWeight = "length",
        cannot_link: bool = False,
        objectness_weight: float = 0.0,
    ) -> None:
        super().__init__(threshold, objectness_weight)
        self.border_weight: BorderWeight = check_border_weight(border_weight)
        self.cannot_link = bool(cannot_link)

    def partition(
        self,
        num_nodes: int,
        pairs: NDArray[np.int64],
        probability: NDArray[np.float64],
        border_length: NDArray[np.float64],
    ) -> NDArray[np.int64]:
        """Partition a graph; pairs that don't touch count like a pixel of border."""
        share = border_share(np.maximum(border_length, 1), self.border_weight)
        return agglomerate(num_nodes, pairs, probability - self.threshold, "mean", share, self.cannot_link)
