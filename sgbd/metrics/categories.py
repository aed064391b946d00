"""Scores per category, and their means over seen and unseen categories.

The protocol of generalised zero-shot instance segmentation in E. P. Örnek et al., "SupeRGB-D", IEEE RA-L 8(6), 2023,
arXiv:2212.11922. Within a frame:

- Every segment that shares a pixel with a ground-truth object takes part, with all its pixels and whatever its label,
  even if it is mostly background.
- Segments and objects are matched as in `sgbd.metrics.overlap`. Every matched object gets the overlap precision, recall
  and F-measure of its own pair, and the boundary scores of the pair's two contours.
- A category's score is the mean over its matched objects; an object without a match has no score. The published
  protocol therefore doesn't punish missed objects when there are fewer segments than objects; ``unmatched="zero"``
  counts them as 0 instead.

Over frames, a category's score is the mean over the frames in which it has one. Seen and unseen scores are means over
their categories with equal weights, and HM is the harmonic mean of the two, computed for each score separately.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from sgbd.metrics.boundary import ContourMap, match_contours
from sgbd.metrics.contingency import ContingencyTable
from sgbd.metrics.f_measure import f_measure, precision_recall_f
from sgbd.metrics.label_index import label_index
from sgbd.metrics.objects import objects_by_contact
from sgbd.metrics.overlap import match_objects

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class PairScores:
    """Scores from 0 to 1 of one matched object, or means of such scores; NaN if contours weren't compared."""

    overlap_precision: float
    overlap_recall: float
    overlap_f_measure: float
    boundary_precision: float = float("nan")
    boundary_recall: float = float("nan")
    boundary_f_measure: float = float("nan")


_SCORES = [field.name for field in fields(PairScores)]


@dataclass(frozen=True)
class CategoryScores:
    """Scores of one frame per category.

    Attributes:
        scores: The scores of every category that has a matched object.
        predicted: Number of segments that share a pixel with an object.
        detected: Number of objects whose match has F > 0.75.
        objects: Number of ground-truth objects.
    """

    scores: Mapping[Hashable, PairScores]
    predicted: int
    detected: int
    objects: int

    @property
    def mean(self) -> PairScores:
        """Mean over the frame's categories; all 1 if there are no objects, NaN if none of them has a category."""
        if self.objects == 0:
            return PairScores(1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
        return _mean(list(self.scores.values()))


def category_scores(
    table: ContingencyTable,
    category: Mapping[int, Hashable],
    prediction: ArrayLike | ContourMap | None = None,
    truth: ArrayLike | ContourMap | None = None,
    unmatched: Literal["skip", "zero"] = "skip",
) -> CategoryScores:
    """Compute the scores of one frame per category.

    Args:
        table: The contingency table of the frame.
        category: Category of each ground-truth object. Objects without one are matched, but have no score.
        prediction: Integers [H, W], predicted segment of each pixel; needed only for boundaries.
        truth: Integers [H, W], ground-truth instance of each pixel, -1 = ignore; needed only for boundaries.
        unmatched: What objects without a match count: "skip", no score (as published), or "zero", a score of 0.

    Raises:
        ValueError: If only one of `prediction` and `truth` is given, or `unmatched` is something else.
    """
    if unmatched not in ("skip", "zero"):
        raise ValueError(f"unmatched must be 'skip' or 'zero', got {unmatched!r}")
    if (prediction is None) != (truth is None):
        raise ValueError("boundaries need both label maps: give prediction and truth, or neither")
    matching = match_objects(table, objects_by_contact(table))
    overlap = np.stack([matching.precision, matching.recall, matching.f_measure], axis=1)
    boundary = np.full(overlap.shape, np.nan)
    if prediction is not None and truth is not None and category:
        match = match_contours(prediction, truth, matching)
        p = label_index(matching.segment, matching.predicted_objects)
        q = label_index(matching.instance, matching.true_objects)
        for k in range(len(boundary)):
            boundary[k] = precision_recall_f(
                int(match.predicted_matched[p[k]]),
                int(match.predicted_length[p[k]]),
                int(match.true_matched[q[k]]),
                int(match.true_length[q[k]]),
            )
    of_object = {
        int(instance): PairScores(*map(float, overlap[k]), *map(float, boundary[k]))
        for k, instance in enumerate(matching.instance)
    }
    if unmatched == "zero":
        worst = 0.0 if prediction is not None else float("nan")
        missed = PairScores(0.0, 0.0, 0.0, worst, worst, worst)
        of_object = {int(instance): of_object.get(int(instance), missed) for instance in matching.true_objects}
    of_category: dict[Hashable, list[PairScores]] = {}
    for instance, scores in of_object.items():
        if instance in category:
            of_category.setdefault(category[instance], []).append(scores)
    return CategoryScores(
        scores={name: _mean(scores) for name, scores in of_category.items()},
        predicted=len(matching.predicted_objects),
        detected=matching.detected,
        objects=len(matching.true_objects),
    )


def category_table(frames: Sequence[CategoryScores]) -> pd.DataFrame:
    """Average the scores of each category over the frames in which it has a score.

    Returns:
        A table with a row for each category, the columns of `PairScores`, and ``frames``, the number of these frames.
    """
    import pandas as pd  # imported on use: segmenting imports the metrics but not pandas

    of_category: dict[Hashable, list[PairScores]] = {}
    for frame in frames:
        for name, scores in frame.scores.items():
            of_category.setdefault(name, []).append(scores)
    rows = [[*astuple(_mean(scores)), len(scores)] for scores in of_category.values()]
    index = pd.Index(list(of_category), name="category", dtype=object)
    return pd.DataFrame(rows, index=index, columns=[*_SCORES, "frames"])


def seen_and_unseen(frames: Sequence[CategoryScores], seen: Collection[Hashable]) -> pd.DataFrame:
    """Average the scores over seen and over unseen categories, and compute their harmonic means.

    Args:
        frames: Scores of each frame.
        seen: The categories that occur in training; all others are unseen.

    Returns:
        A table with the rows ``seen``, ``unseen`` and ``harmonic_mean``, the columns of `PairScores`, and
        ``categories``, the number of categories in each mean. A row without categories is NaN, and then the harmonic
        mean is NaN too.
    """
    import pandas as pd

    table = category_table(frames)
    is_seen = np.array([name in seen for name in table.index], dtype=bool)
    groups = {"seen": table[is_seen], "unseen": table[~is_seen]}
    means = {name: group[_SCORES].astype(float).mean().tolist() for name, group in groups.items()}
    rows = {name: [*mean, len(groups[name])] for name, mean in means.items()}
    harmonic = [harmonic_mean(*pair) for pair in zip(means["seen"], means["unseen"], strict=True)]
    rows["harmonic_mean"] = [*harmonic, len(table)]
    result = pd.DataFrame.from_dict(rows, orient="index", columns=[*_SCORES, "categories"])
    return result.astype({"categories": int})


def harmonic_mean(seen: float, unseen: float) -> float:
    """Return the harmonic mean of a score on seen and on unseen categories; NaN if one is missing, 0 if both are 0."""
    return float("nan") if np.isnan(seen) or np.isnan(unseen) else f_measure(seen, unseen)


def _mean(scores: Sequence[PairScores]) -> PairScores:
    """Average scores field by field; all NaN if there are none."""
    if not scores:
        return PairScores(*[float("nan")] * len(_SCORES))
    return PairScores(*map(float, np.mean([astuple(score) for score in scores], axis=0)))
