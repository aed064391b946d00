"""The edge loss compared with its formula, term by term."""

from __future__ import annotations

import math

import pytest
import torch

from sgbd.losses import EdgeLoss

LOGITS = [2.0, -1.0, 0.5, -3.0, 0.0]
LABELS = [1.0, 1.0, 0.0, 0.0, 1.0]
WEIGHTS = [1.0, 2.0, 4.0, 0.5, 0.0]


def by_hand(gamma: float, weights: list[float]) -> float:
    """Return the weighted mean of -(1 - p)^gamma log p, where p is the probability of the correct label."""
    total = 0.0
    for logit, label, weight in zip(LOGITS, LABELS, weights, strict=True):
        merge = 1 / (1 + math.exp(-logit))
        right = merge if label else 1 - merge
        total -= weight * (1 - right) ** gamma * math.log(right)
    return total / sum(weights)


def balanced(weights: list[float]) -> list[float]:
    """Return the weights, normalised to sum to 1 in each class."""
    sums = {value: sum(w for w, label in zip(weights, LABELS, strict=True) if label == value) for value in set(LABELS)}
    return [weight / sums[label] for weight, label in zip(weights, LABELS, strict=True)]


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("is_balanced", [False, True])
@pytest.mark.parametrize("gamma", [0.0, 0.5, 1.0, 2.0])
def test_the_loss_is_its_formula(gamma: float, is_balanced: bool, weighted: bool) -> None:
    weights = WEIGHTS if weighted else [1.0] * 5
    given = torch.tensor(WEIGHTS) if weighted else None
    got = EdgeLoss(gamma, is_balanced)(torch.tensor(LOGITS), torch.tensor(LABELS), given)
    assert got.shape == ()
    assert float(got) == pytest.approx(by_hand(gamma, balanced(weights) if is_balanced else weights), rel=1e-5)


def test_weights_count_by_their_ratios_only() -> None:
    logits, labels, weights = (torch.tensor(values) for values in (LOGITS, LABELS, WEIGHTS))
    torch.testing.assert_close(EdgeLoss()(logits, labels, 100 * weights), EdgeLoss()(logits, labels, weights))


@pytest.mark.parametrize("label", [0.0, 1.0])
def test_a_batch_of_one_class_is_its_plain_mean_when_balanced(label: float) -> None:
    logits, labels = torch.tensor(LOGITS), torch.full((5,), label)
    torch.testing.assert_close(EdgeLoss(balanced=True)(logits, labels), EdgeLoss()(logits, labels))


@pytest.mark.parametrize("gamma", [0.0, 0.3, 1.0, 2.0])
@pytest.mark.parametrize("size", [20.0, 200.0])
def test_sure_pairs_leave_the_gradient_finite(gamma: float, size: float) -> None:
    logits = torch.tensor([size, -size, size, -size], requires_grad=True)
    loss = EdgeLoss(gamma, balanced=True)(logits, torch.tensor([1.0, 0.0, 0.0, 1.0]))
    loss.backward()
    assert float(loss.detach()) == pytest.approx(size / 2, rel=1e-5)
    assert logits.grad is not None
    # Correct pairs have no gradient, wrong ones the full gradient.
    torch.testing.assert_close(logits.grad, torch.tensor([0.0, 0.0, 0.25, -0.25]), rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("gamma", [-0.1, math.nan, math.inf])
def test_impossible_gammas_are_refused(gamma: float) -> None:
    with pytest.raises(ValueError, match=f"gamma must be a finite number of at least 0; got {gamma}"):
        EdgeLoss(gamma)
