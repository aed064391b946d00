"""Calibrated scores: the probability that a segment is right, learned on validation frames.

A segment is right if its intersection over union with a true object is above 0.75. A logistic regression on a few
features of the segment predicts the probability of this (J. Platt, "Probabilistic outputs for support vector machines",
1999, extended to several inputs). Its coefficients are plain numbers in the recipe of a checkpoint.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from sgbd.metrics import ContingencyTable

RIGHT_IOU = 0.75
"""A segment is right if its intersection over union with a true object is above this."""

CLIP = 1e-3
"""Probabilities are clipped to this distance from 0 and 1 before their logit is taken."""

SEGMENT_FEATURES = (
    "log_area",
    "log_superpixels",
    "inner_merge",
    "inner_merge_least",
    "outer_cut",
    "outer_merge_most",
    "objectness",
    "objectness_least",
)
"""Features of a segment from which its score is predicted.

- log_area: log of its area as a fraction of the image.
- log_superpixels: log of its number of superpixels.
- inner_merge: logit of the mean merge probability of its inner edges, weighted by border length; inner_merge_least:
  logit of the smallest of these probabilities.
- outer_cut: logit of the mean cut probability of its edges to other segments, weighted by border length;
  outer_merge_most: logit of the greatest merge probability of these edges.
- objectness: logit of the mean objectness over its pixels; objectness_least: logit of the smallest objectness of its
  superpixels.
"""


def segment_features(
    segment: npt.NDArray[np.int64],
    area: npt.NDArray[np.number],
    pairs: npt.NDArray[np.int64],
    probability: npt.NDArray[np.floating],
    border_length: npt.NDArray[np.floating],
    objectness: npt.NDArray[np.floating] | None,
) -> npt.NDArray[np.float64]:
    """Compute the features of a partition's segments.

    Args:
        segment: int64 [N], segment of each superpixel, 0..S-1.
        area: [N], pixels of each superpixel.
        pairs: int64 [2, E].
        probability: float [E], merge probabilities.
        border_length: float [E], pixels, or another weight set by the graph builder. Values below 1, such as those of
            pairs that do not touch, count as 1.
        objectness: float [N]; None counts as 1.

    Returns:
        float64 [S, F], columns as in `SEGMENT_FEATURES`. A segment without inner or outer edges gets the values of
        perfect ones.
    """
    count = int(segment.max(initial=-1)) + 1
    weight = np.maximum(border_length, 1).astype(np.float64)
    p = np.asarray(probability, dtype=np.float64)
    first, second = segment[pairs[0]], segment[pairs[1]]
    inside = first == second

    def mean(
        where: npt.NDArray[np.int64], value: npt.NDArray[np.float64], share: npt.NDArray[np.float64]
    ) -> npt.NDArray[np.float64]:
        total = np.bincount(where, share, count)
        return np.where(total > 0, np.bincount(where, share * value, count) / np.maximum(total, 1e-12), 1.0)

    inner_least = np.ones(count)
    np.minimum.at(inner_least, first[inside], p[inside])
    outer = np.concatenate([first[~inside], second[~inside]])
    outer_p, outer_weight = np.tile(p[~inside], 2), np.tile(weight[~inside], 2)
    outer_most = np.zeros(count)
    np.maximum.at(outer_most, outer, outer_p)
    node = np.ones(len(segment)) if objectness is None else np.asarray(objectness, dtype=np.float64)
    node_least = np.ones(count)
    np.minimum.at(node_least, segment, node)
    pixels = np.bincount(segment, area, count)
    return np.stack(
        [
            np.log(np.maximum(pixels, 1) / max(float(np.sum(area)), 1.0)),
            np.log(np.bincount(segment, minlength=count)),
            _logit(mean(first[inside], p[inside], weight[inside])),
            _logit(inner_least),
            _logit(mean(outer, 1 - outer_p, outer_weight)),
            _logit(outer_most),
            _logit(np.bincount(segment, area * node, count) / np.maximum(pixels, 1)),
            _logit(node_least),
        ],
        axis=1,
    )


class ScoreCalibration:
    """A logistic regression from the features of a segment to the probability that it is right.

    Args:
        features: Names of the columns it was fitted on; must equal `SEGMENT_FEATURES`.
        center: Mean of each column.
        scale: Standard deviation of each column.
        coefficients: Coefficient of each standardised column.
        intercept: Intercept of the regression.

    Raises:
        ValueError: If the columns differ from those of this version, or there is not one finite number per column.
    """

    def __init__(
        self,
        features: Sequence[str],
        center: Sequence[float],
        scale: Sequence[float],
        coefficients: Sequence[float],
        intercept: float,
    ) -> None:
        if tuple(features) != SEGMENT_FEATURES:
            raise ValueError(
                f"the calibration was fitted on {', '.join(features)}; this version of sgbd has "
                f"{', '.join(SEGMENT_FEATURES)}. Calibrate again."
            )
        for name, values in (("center", center), ("scale", scale), ("coefficients", coefficients)):
            if len(values) != len(features) or not np.isfinite(values).all():
                raise ValueError(f"calibration.{name} must be {len(features)} finite numbers; got {list(values)}")
        self.features = list(features)
        self.center, self.scale, self.coefficients = list(center), list(scale), list(coefficients)
        self.intercept = float(intercept)

    def __call__(self, features: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the probability that each segment is right, float64 [S], from `segment_features` [S, F]."""
        standardized = (features - np.array(self.center)) / np.array(self.scale)
        probability: npt.NDArray[np.float64] = _logistic(standardized @ np.array(self.coefficients) + self.intercept)
        return probability

    @classmethod
    def fit(
        cls, features: npt.NDArray[np.float64], right: npt.NDArray[np.bool_], penalty: float = 1.0
    ) -> ScoreCalibration:
        """Fit the regression to segments with known ground truth.

        Args:
            features: float64 [K, F], see `segment_features`.
            right: bool [K], whether each segment is right.
            penalty: Weight of half the sum of squared coefficients, added to the sum of the log losses. The intercept
                is not penalised, so the mean score equals the fraction of right segments.

        Raises:
            ValueError: If all segments are right or all are wrong, so that nothing can be learned from them.
        """
        # Imported here, so that segmenting a frame does not wait for SciPy's optimizers.
        from scipy.optimize import minimize

        if right.all() or not right.any():
            raise ValueError(
                f"{int(right.sum())} of {len(right)} validation segments are right: scores can be calibrated only "
                "where some are and some are not. Give more validation frames, or do without calibration."
            )
        center, spread = features.mean(axis=0), features.std(axis=0)
        scale = np.where(spread > 1e-9, spread, 1.0)
        x = np.concatenate([(features - center) / scale, np.ones((len(features), 1))], axis=1)
        sign = np.where(right, 1.0, -1.0)

        def loss(w: npt.NDArray[np.float64]) -> tuple[float, npt.NDArray[np.float64]]:
            margin = sign * (x @ w)
            penalized = np.append(w[:-1], 0.0)
            gradient = -x.T @ (sign * _logistic(-margin)) + penalty * penalized
            return float(np.logaddexp(0, -margin).sum() + 0.5 * penalty * penalized @ penalized), gradient

        found = minimize(loss, np.zeros(x.shape[1]), jac=True, method="L-BFGS-B", options={"gtol": 1e-8, "ftol": 1e-14})
        return cls(SEGMENT_FEATURES, center.tolist(), scale.tolist(), found.x[:-1].tolist(), float(found.x[-1]))


def right_segments(table: ContingencyTable, count: int, iou: float = RIGHT_IOU) -> npt.NDArray[np.bool_]:
    """Decide which segments are right, bool [S]. Ignored pixels count neither for segments nor for instances.

    Args:
        table: Contingency table of the segments 0..S-1 and the true instances.
        count: Number of segments S.
        iou: Intersection over union above which a segment is right.
    """
    from sgbd.metrics import FIRST_OBJECT  # imported here: segmenting a frame needs this module, but not the metrics

    right = np.zeros(count, dtype=np.bool_)
    shared = table.counts[:, table.instances >= FIRST_OBJECT]
    true_area = table.instance_area[table.instances >= FIRST_OBJECT]
    union = table.segment_area[:, None] + true_area[None, :] - shared
    right[table.segments] = (shared > iou * union).any(axis=1)
    return right


def expected_calibration_error(scores: npt.NDArray[np.floating], right: npt.NDArray[np.bool_], bins: int = 10) -> float:
    """Return the expected calibration error of scores, with bins of equal width.

    M. P. Naeini, G. F. Cooper, M. Hauskrecht, "Obtaining well calibrated probabilities using Bayesian binning", AAAI
    2015: the mean over the bins of |mean score - fraction right|, weighted by the number of segments in each bin.

    Args:
        scores: float [K], 0 to 1.
        right: bool [K].
        bins: Number of bins.

    Returns:
        0 to 1; NaN without segments.
    """
    if len(scores) == 0:
        return float("nan")
    place = np.minimum((np.asarray(scores, dtype=np.float64) * bins).astype(np.int64), bins - 1)
    difference = np.bincount(place, scores, bins) - np.bincount(place, right, bins)
    return float(np.abs(difference).sum() / len(scores))


def _logit(p: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    clipped = np.clip(p, CLIP, 1 - CLIP)
    return np.log(clipped / (1 - clipped))


def _logistic(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return 0.5 + 0.5 * np.tanh(0.5 * x)  # equals 1 / (1 + exp(-x)), but does not overflow
