"""Overlap precision, recall and F-measure of objects, and the share of objects detected.

The measure of unseen-object segmentation: A. Dave, P. Tokmakov, D. Ramanan, "Towards segmenting anything that moves",
ICCV workshops 2019, as C. Xie, Y. Xiang, A. Mousavian, D. Fox, "The best of both modes", CoRL 2019, apply it to single
frames. Predicted and ground-truth objects are matched one to one so that the sum of their pairwise F-measures is
greatest. Precision is then the share of the predicted objects' pixels that lie on their match, and recall the share of
the ground-truth objects' pixels that their match covers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.metrics.contingency import ContingencyTable
from sgbd.metrics.f_measure import precision_recall_f
from sgbd.metrics.label_index import label_index
from sgbd.metrics.objects import FIRST_OBJECT, objects_by_label

DETECTION_THRESHOLD: float = 0.75
"""An object is detected if the F-measure with its match is above this."""


@dataclass(frozen=True, eq=False)
class Matching:
    """A one-to-one matching of predicted and ground-truth objects.

    Attributes:
        predicted_objects: int64 [P], labels of all predicted objects, matched or not.
        true_objects: int64 [Q], labels of all ground-truth objects.
        segment: int64 [K], the matched predicted objects, K = min(P, Q).
        instance: int64 [K], the ground-truth object matched with each, ascending.
        intersection: int64 [K], number of pixels in both.
        precision: float64 [K], share of the segment that lies on the instance.
        recall: float64 [K], share of the instance that the segment covers.
        f_measure: float64 [K]. It may be 0: the published assignment is complete, so even objects that share no pixel
            are paired.
    """

    predicted_objects: NDArray[np.int64]
    true_objects: NDArray[np.int64]
    segment: NDArray[np.int64]
    instance: NDArray[np.int64]
    intersection: NDArray[np.int64]
    precision: NDArray[np.float64]
    recall: NDArray[np.float64]
    f_measure: NDArray[np.float64]

    @property
    def detected(self) -> int:
        """Number of ground-truth objects that have a match with an F-measure above 0.75."""
        return int((self.f_measure > DETECTION_THRESHOLD).sum())


@dataclass(frozen=True)
class OverlapScores:
    """Overlap of predicted and ground-truth objects in one frame.

    Attributes:
        precision: Share (0 to 1) of the predicted objects' pixels that lie on the object they are matched with.
        recall: Share of the ground-truth objects' pixels that are covered by the segment they are matched with.
        f_measure: Harmonic mean of the two.
        detected_share: Share of the ground-truth objects whose match has F > 0.75 ("F@.75"); without ground-truth
            objects it is 1 if nothing was predicted, else 0.
        predicted: Number of predicted objects.
        detected: Number of detected ground-truth objects.
        objects: Number of ground-truth objects.
    """

    precision: float
    recall: float
    f_measure: float
    detected_share: float
    predicted: int
    detected: int
    objects: int


def match_objects(table: ContingencyTable, objects: ArrayLike | None = None) -> Matching:
    """Match predicted and ground-truth objects so that the sum of the pairs' F-measures is greatest (Hungarian method).

    Args:
        table: The contingency table of the frame.
        objects: Labels of the segments that are objects; by default the labels from 2 on, as in the ground truth.
            Labels of segments without a pixel of known ground truth are left out.

    Returns:
        The pairs with their overlap; all objects of the rarer kind are paired.
    """
    from scipy.optimize import linear_sum_assignment  # imported on use: segmenting imports the metrics but not SciPy

    if objects is None:
        objects = objects_by_label(table)
    places = label_index(table.segments, np.unique(np.asarray(objects, dtype=np.int64)))
    row, column = np.flatnonzero(places >= 0), np.flatnonzero(table.instances >= FIRST_OBJECT)
    predicted_objects, true_objects = table.segments[row], table.instances[column]
    shared = table.counts[row][:, column].T  # [Q, P]
    predicted_area = table.segment_area[row]
    true_area = table.instance_area[column]
    # The F-measure of each pair, 2PR / (P + R), in terms of pixel counts.
    pairwise = 2 * shared / (true_area[:, None] + predicted_area[None, :])
    q, p = linear_sum_assignment(pairwise, maximize=True)
    intersection = shared[q, p]
    return Matching(
        predicted_objects=predicted_objects,
        true_objects=true_objects,
        segment=predicted_objects[p],
        instance=true_objects[q],
        intersection=intersection,
        precision=intersection / predicted_area[p],
        recall=intersection / true_area[q],
        f_measure=pairwise[q, p],
    )


def overlap_scores(table: ContingencyTable, matching: Matching | None = None) -> OverlapScores:
    """Compute overlap precision, recall, F-measure and detected share of one frame.

    Args:
        table: The contingency table of the frame.
        matching: The matching of predicted and ground-truth objects in `table`; by default objects are chosen by label.

    Returns:
        The scores over all objects of the frame, summed in pixels.
    """
    if matching is None:
        matching = match_objects(table)
    right = int(matching.intersection.sum())
    predicted_pixels = table.segment_area[np.searchsorted(table.segments, matching.predicted_objects)].sum()
    true_pixels = table.instance_area[np.searchsorted(table.instances, matching.true_objects)].sum()
    precision, recall, f = precision_recall_f(right, int(predicted_pixels), right, int(true_pixels))
    predicted, objects = len(matching.predicted_objects), len(matching.true_objects)
    return OverlapScores(
        precision=precision,
        recall=recall,
        f_measure=f,
        detected_share=matching.detected / objects if objects else float(predicted == 0),
        predicted=predicted,
        detected=matching.detected,
        objects=objects,
    )
