import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sgbd.repaint import repaint


@given(hnp.arrays(np.int32, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=st.integers(0, 4)), st.booleans())
def test_every_pixel_gets_the_new_id_of_its_label(label_map: np.ndarray, turned: bool) -> None:
    names = np.array([7, -1, 3, 3, 0])
    given_map = label_map.T if turned else label_map
    painted = repaint(given_map, names)
    assert painted.dtype == np.int32
    assert (painted == names[given_map]).all()


def test_an_id_without_a_new_one_is_an_error() -> None:
    with pytest.raises(IndexError, match="2 new ids, but the label map has the id 2"):
        repaint(np.array([[0, 2]], np.int32), np.array([0, 1]))


def test_no_pixels() -> None:
    assert repaint(np.empty((0, 3), np.int32), np.array([0])).shape == (0, 3)
