"""Draw random numbers on a logarithmic scale."""

from __future__ import annotations

import numpy as np


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniformly distributed.

    Args:
        rng: Random generator.
        low: Smallest value, above 0.
        high: Largest value.
    """
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
