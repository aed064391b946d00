"""Average-linkage agglomeration: join two segments if the mean merge probability along their border is high enough."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgbd.partition.contraction import agglomerate
from sgbd.partition.edge_weight import BorderWeight, border_share, check_border_weight
from sgbd.partition.threshold_partitioner import ThresholdPartitioner


class AverageLinkage(ThresholdPartitioner):
    """Joins the segments whose common border has the highest mean merge probability, while it is above a threshold.

    The signed average linkage of GASP (Bailoni et al., CVPR 2022, doi:10.1109/CVPR52688.2022.01135). Only the mean
    counts: unlike in a multicut, a long border is not stronger than a short one, only more certain. So large segments
    don't swallow small ones merely because their border is long.

    Args:
        threshold: Mean merge probability above which segments are joined.
        border_weight: Weight of an edge in the mean: "length", its border length (at least one pixel), "log",
            log(1 + border length), or "none", equal weights.
        cannot_link: If true, process edges in the order of their distance from the threshold; an edge below the
            threshold then forbids its segments ever to be joined. This makes cuts more reliable, but a wrong cut is
            final.
        objectness_weight: How much a difference in objectness lowers the probability of an edge, see
            `sgbd.partition.partitioner.joint_probability`; 0 ignores objectness.
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
        """Partition a graph; pairs that don't touch count as one pixel of border."""
        share = border_share(np.maximum(border_length, 1), self.border_weight)
        return agglomerate(num_nodes, pairs, probability - self.threshold, "mean", share, self.cannot_link)
