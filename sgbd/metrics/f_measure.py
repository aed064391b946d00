"""Precision, recall and F-measure from counts, with one convention for empty predictions and ground truths."""

from __future__ import annotations


def f_measure(precision: float, recall: float) -> float:
    """Return the harmonic mean of precision and recall; 0 if both are 0."""
    return 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0


def precision_recall_f(
    predicted_right: float, predicted: float, true_found: float, true: float
) -> tuple[float, float, float]:
    """Return precision, recall and F-measure.

    If nothing is predicted and nothing is true, the prediction is right: (1, 1, 1). If only one side is empty, nothing
    on that side is wrong, so its score is 1, the other score is 0 and F is 0: (1, 0, 0) if everything was missed, (0,
    1, 0) if everything predicted is false. This is the convention of the published evaluation of unseen-object
    segmentation.

    Args:
        predicted_right: Amount of the prediction that is right.
        predicted: Amount predicted.
        true_found: Amount of the ground truth that was found; differs from `predicted_right` if matching has a
            tolerance.
        true: Amount of the ground truth.

    Returns:
        Precision, recall, F, each from 0 to 1.
    """
    if predicted == 0 and true == 0:
        return 1.0, 1.0, 1.0
    precision = predicted_right / predicted if predicted > 0 else 1.0
    recall = true_found / true if true > 0 else 1.0
    if predicted == 0 or true == 0:
        return float(precision), float(recall), 0.0
    return float(precision), float(recall), float(f_measure(precision, recall))
