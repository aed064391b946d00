"""Scores of a segmentation as a clustering of pixels, without matching segments to instances.

They cover all regions, including background and supporting surface, but no ignored pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgbd.metrics.contingency import ContingencyTable
from sgbd.metrics.f_measure import precision_recall_f


@dataclass(frozen=True)
class ClusteringScores:
    """Agreement of segments and instances as clusterings of the pixels of one frame.

    Attributes:
        rand_error: Adapted Rand error, 0 (equal) to 1: 1 - F of precision and recall over pairs of pixels, where a
            pair counts as predicted (true) if both pixels lie in one segment (instance). I. Arganda-Carreras et al.,
            "Crowdsourcing the creation of image segmentation algorithms for connectomics", Frontiers in Neuroanatomy
            2015, doi:10.3389/fnana.2015.00142.
        split: H(segment | instance) in bits, 0 if no instance is split: over-segmentation.
        merge: H(instance | segment) in bits, 0 if no segment merges instances: under-segmentation.
        variation_of_information: Split + merge. M. Meilă, "Comparing clusterings", Journal of Multivariate Analysis
            2007, doi:10.1016/j.jmva.2006.11.013.
    """

    rand_error: float
    split: float
    merge: float
    variation_of_information: float


def clustering_scores(table: ContingencyTable) -> ClusteringScores:
    """Compute adapted Rand error and variation of information of one frame; all are 0 without known pixels."""
    together = _pairs(table.counts)
    _, _, f = precision_recall_f(together, _pairs(table.segment_area), together, _pairs(table.instance_area))
    joint = _entropy(table.counts)
    split, merge = joint - _entropy(table.instance_area), joint - _entropy(table.segment_area)
    # Rounding may give slightly negative differences, such as -1e-16.
    split, merge = max(split, 0.0), max(merge, 0.0)
    return ClusteringScores(rand_error=1 - f, split=split, merge=merge, variation_of_information=split + merge)


def _pairs(areas: NDArray[np.int64]) -> float:
    """Return the number of unordered pairs of pixels within the groups."""
    area = areas.astype(np.float64)
    return float((area * (area - 1)).sum() / 2)


def _entropy(areas: NDArray[np.int64]) -> float:
    """Return the entropy, in bits, of the group of a random pixel."""
    area = areas[areas > 0].astype(np.float64)
    if not area.size:
        return 0.0
    share = area / area.sum()
    return float(-(share * np.log2(share)).sum())
