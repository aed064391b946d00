"""Training losses over the supervised pairs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from sgbd.graph import MERGE


@dataclass(frozen=True)
class EdgeLoss:
    r"""Binary cross-entropy of merge logits, optionally focal and weighted.

    .. math:: -w\, (1 - p_t)^\gamma \log p_t

    with :math:`p_t` the probability of the true label. The defaults give the plain cross-entropy of the paper;
    :math:`\gamma > 0` gives the focal loss of T.-Y. Lin et al., "Focal loss for dense object detection", ICCV 2017,
    doi:10.1109/ICCV.2017.324. Weights are scaled to a mean of 1 over the batch, so that the learning rate need not
    change.

    Attributes:
        gamma: Focusing exponent; larger values put more weight on misclassified pairs.
        balanced: Give both classes equal total weight, whatever their numbers of pairs in the batch.

    Raises:
        ValueError: On construction, if gamma is negative or not finite.
    """

    gamma: float = 0.0
    balanced: bool = False

    def __post_init__(self) -> None:
        """Validate gamma."""
        if not 0 <= self.gamma < math.inf:
            raise ValueError(f"the edge loss's gamma must be a finite number of at least 0; got {self.gamma}")

    def __call__(self, logits: Tensor, labels: Tensor, weight: Tensor | None = None) -> Tensor:
        """Return the mean loss.

        Args:
            logits: float32 [P], merge logits.
            labels: float32 [P], 1 merge, 0 cut.
            weight: float32 [P], weight of each pair; None for equal weights.

        Returns:
            float32 scalar.
        """
        if self.gamma == 0 and not self.balanced and weight is None:
            return binary_cross_entropy_with_logits(logits, labels)
        loss = binary_cross_entropy_with_logits(logits, labels, reduction="none")
        if self.gamma > 0:
            # Clamp away from 0, where a power below 1 has no finite gradient: a confident correct pair would give NaN.
            wrong = -torch.expm1(-loss)
            loss = loss * wrong.clamp(min=1e-12) ** self.gamma
        total = torch.ones_like(labels) if weight is None else weight
        if self.balanced:
            merges = labels == MERGE
            merge, cut = (total * merges).sum(), (total * ~merges).sum()
            total = total * torch.where(merges, 1 / merge.clamp(min=1e-6), 1 / cut.clamp(min=1e-6))
        return (loss * total).sum() / total.sum().clamp(min=1e-6)
