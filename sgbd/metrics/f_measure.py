"""Precision, recall and F-measure from counts, with one convention for what is empty."""

from __future__ import annotations


def f_measure(precision: float, recall: float) -> float:
    """The harmonic mean of precision and recall; 0 where both are 0."""
    return 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0


def precision_recall_f(
    predicted_right: float, predicted: float, true_found: float, true: float
) -> tuple[float, float, float]:
    """Precision, recall and F-measure.

    Nothing predicted where nothing is true is right (1, 1, 1). Where only one side is empty there is nothing wrong on
    that side, so its score is 1 and the other's is 0, and F is 0: (1, 0, 0) when all was missed, (0, 1, 0) when all
    that was predicted is false. This is the convention of the published evaluation of unseen-object segmentation.

    Args:
        predicted_right: How much of the prediction is right.
        predicted: How much was predicted.
        true_found: How much of the truth was found; differs from `predicted_right` where matching is tolerant.
        true: How much is true.

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
