import numpy as np
import pytest

from sgbd.reporting.reliability import reliability_figure


def test_a_point_for_each_bin_that_has_objects() -> None:
    scores = np.array([0.05, 0.92, 0.98, 1.0, 0.5])
    right = np.array([False, True, True, False, True])
    upper, lower = reliability_figure(scores, right).axes
    points = upper.get_lines()[1].get_xydata()
    assert points == pytest.approx(np.array([[0.05, 0], [0.5, 1], [2.9 / 3, 2 / 3]]))
    assert [bar.get_height() for bar in lower.patches] == [1, 0, 0, 0, 0, 1, 0, 0, 0, 3]
