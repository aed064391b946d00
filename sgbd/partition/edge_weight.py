"""Signed weights of edges: how strongly each speaks for merging or for cutting."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

BorderWeight = Literal["length", "log", "none"]
"""What an edge's vote counts: its border length, log(1 + border length), or 1."""

EDGE_EPSILON = 1e-6


def logit_weights(probability: ArrayLike, threshold: float, epsilon: float = EDGE_EPSILON) -> NDArray[np.float64]:
    """Signed weight logit(p) - logit(threshold) of each edge, float64 [E].

    Args:
        probability: float [E], merge probabilities.
        threshold: Merge probability at which an edge is indifferent.
        epsilon: Probabilities are clipped to [epsilon, 1 - epsilon].
    """
    p = np.clip(np.asarray(probability, dtype=np.float64), epsilon, 1 - epsilon)
    weight: NDArray[np.float64] = np.log(p / (1 - p)) - np.log(threshold / (1 - threshold))
    return weight


def border_share(border_length: ArrayLike, border_weight: BorderWeight) -> NDArray[np.float64]:
    """What the vote of each edge counts, float64 [E].

    Args:
        border_length: float [E], pixels.
        border_weight: "length", "log" or "none".
    """
    length = np.asarray(border_length, dtype=np.float64)
    if border_weight == "length":
        return length
    return np.log1p(length) if border_weight == "log" else np.ones_like(length)


def check_border_weight(border_weight: BorderWeight) -> BorderWeight:
    """Check what the votes of edges count by.

    Raises:
        ValueError: If it isn't one of the three.
    """
    if border_weight not in ("length", "log", "none"):
        raise ValueError(f"border_weight must be 'length', 'log' or 'none', got {border_weight!r}")
    return border_weight
