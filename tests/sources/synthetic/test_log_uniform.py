import numpy as np
import pytest

from sgbd.sources.synthetic.log_uniform import log_uniform


def test_a_half_lies_below_the_geometric_mean() -> None:
    rng = np.random.default_rng(0)
    drawn = np.array([log_uniform(rng, 0.01, 1.0) for _ in range(4000)])
    assert drawn.min() >= 0.01
    assert drawn.max() <= 1.0
    assert (drawn < 0.1).mean() == pytest.approx(0.5, abs=0.03)
    assert (drawn < 0.01 * 10**0.5).mean() == pytest.approx(0.25, abs=0.03)
