"""Scores of merge and cut decisions on the edges of a superpixel graph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sgbd.metrics.f_measure import precision_recall_f


@dataclass(frozen=True)
class EdgeScores:
    """Scores of the decisions on the edges of one graph (or of several, counted together).

    Attributes:
        cut_precision: Share (0 to 1) of the cut edges that lie between different instances.
        cut_recall: Share of the edges between different instances that are cut.
        cut_f_measure: Harmonic mean of the two. Cuts are the rare class, so this says more than the accuracy.
        merge_accuracy: Share of all edges that are correctly merged or correctly cut; 1 if there are none.
    """

    cut_precision: float
    cut_recall: float
    cut_f_measure: float
    merge_accuracy: float


def edge_scores(merged: ArrayLike, edge_label: ArrayLike) -> EdgeScores:
    """Score decisions on edges.

    Args:
        merged: bool [E], whether the two ends are merged: ``probability > threshold`` to score the edge model alone,
            ``segment[i] == segment[j]`` to score the partition.
        edge_label: [E], 1 = same instance, 0 = different instances, -1 = unknown: left out.

    Raises:
        ValueError: If the shapes differ, `merged` isn't boolean, or a label is none of these.
    """
    merged, label = np.asarray(merged), np.asarray(edge_label)
    if merged.dtype != bool:
        raise ValueError(f"merged must be boolean decisions, got {merged.dtype}: compare probabilities to a threshold")
    if merged.shape != label.shape or merged.ndim != 1:
        raise ValueError(f"there must be one decision for each label, got {list(merged.shape)} and {list(label.shape)}")
    if not ((label == 1) | (label == 0) | (label == -1)).all():
        raise ValueError(f"edge labels must be 1 (merge), 0 (cut) or -1 (unknown), got {np.unique(label)}")
    cut, true_cut = ~merged[label >= 0], label[label >= 0] == 0
    right = int((cut & true_cut).sum())
    precision, recall, f = precision_recall_f(right, int(cut.sum()), right, int(true_cut.sum()))
    return EdgeScores(precision, recall, f, float((cut == true_cut).mean()) if cut.size else 1.0)
