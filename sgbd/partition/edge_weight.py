"""Signed weights of edges: how strongly each edge favours merging or cutting."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

BorderWeight = Literal["length", "log", "none"]
"""Weight of an edge's vote: its border length, log(1 + border length), or 1."""

EDGE_EPSILON = 1e-6


def logit_weights(probability: ArrayLike, threshold: float, epsilon: float = EDGE_EPSILON) -> NDArray[np.float64]:
    """Return the signed weight logit(p) - logit(threshold) of each edge, float64 [E].

    Args:
        probability: float [E], merge probabilities.
        threshold: Merge probability at which the weight is 0.
        epsilon: Probabilities are clipped to [epsilon, 1 - epsilon].
    """
    p = np.clip(np.asarray(probability, dtype=np.float64), epsilon, 1 - epsilon)
    weight: NDArray[np.float64] = np.log(p / (1 - p)) - np.log(threshold / (1 - threshold))
    return weight


def border_share(border_length: ArrayLike, border_weight: BorderWeight) -> NDArray[np.float64]:
    """Return the weight of each edge's vote, float64 [E].

    Args:
        border_length: float [E], pixels.
        border_weight: "length", "log" or "none".
    """
    length = np.asarray(border_length, dtype=np.float64)
    if border_weight == "length":
        return length
    return np.log1p(length) if border_weight == "log" else np.ones_like(length)


def check_border_weight(border_weight: BorderWeight) -> BorderWeight:
    """Check that a border weight is one of the three known ones, and return it.

    Raises:
        ValueError: If it isn't.
    """
    if border_weight not in ("length", "log", "none"):
        raise ValueError(f"border_weight must be 'length', 'log' or 'none', got {border_weight!r}")
    return border_weight
