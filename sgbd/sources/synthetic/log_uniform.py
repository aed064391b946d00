"""Random sizes: small ones as often as large ones."""

from __future__ import annotations

import numpy as np


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniformly distributed.

    Args:
        rng: Source of randomness.
        low: Least number, above 0.
        high: Greatest number.
    """
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
