"""Scores of segmentations, over-segmentations and edge decisions, from NumPy arrays.

- `contingency`: the pixels that each segment shares with each instance; nearly all scores are computed from these.
  `objects`: which segments and instances count as objects.
- `overlap` and `boundary`: the published precision, recall and F of objects and of their contours. `categories`: the
  same per category, for seen and unseen categories. `f_measure`: their values if nothing is predicted or true.
- `clustering`: adapted Rand error and variation of information, over all regions.
- `superpixel` and `oracle`: what an over-segmentation loses. `edges`: decisions on edges.
- `frame_scores`: all scores of one frame as a row, and their means over frames.
"""

from sgbd.metrics.boundary import BoundaryScores, ContourMap, ContourMatch, boundary_scores, contours, match_contours
from sgbd.metrics.categories import (
    CategoryScores,
    PairScores,
    category_scores,
    category_table,
    harmonic_mean,
    seen_and_unseen,
)
from sgbd.metrics.clustering import ClusteringScores, clustering_scores
from sgbd.metrics.contingency import ContingencyTable
from sgbd.metrics.edges import EdgeScores, edge_scores
from sgbd.metrics.frame_scores import FrameScores, frame_table, score_frame, summarize
from sgbd.metrics.objects import FIRST_OBJECT, objects_by_contact, objects_by_label, objects_by_majority
from sgbd.metrics.oracle import oracle_segments, oracle_table
from sgbd.metrics.overlap import Matching, OverlapScores, match_objects, overlap_scores
from sgbd.metrics.superpixel import (
    achievable_segmentation_accuracy,
    boundary_recall,
    explained_variation,
    undersegmentation_error,
)

__all__ = [
    "FIRST_OBJECT",
    "BoundaryScores",
    "CategoryScores",
    "ClusteringScores",
    "ContingencyTable",
    "ContourMap",
    "ContourMatch",
    "EdgeScores",
    "FrameScores",
    "Matching",
    "OverlapScores",
    "PairScores",
    "achievable_segmentation_accuracy",
    "boundary_recall",
    "boundary_scores",
    "category_scores",
    "category_table",
    "clustering_scores",
    "contours",
    "edge_scores",
    "explained_variation",
    "frame_table",
    "harmonic_mean",
    "match_contours",
    "match_objects",
    "objects_by_contact",
    "objects_by_label",
    "objects_by_majority",
    "oracle_segments",
    "oracle_table",
    "overlap_scores",
    "score_frame",
    "seen_and_unseen",
    "summarize",
    "undersegmentation_error",
]
