"""Positions of labels, by table lookup or search, compared with a dictionary."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sgbd.metrics.label_index import distinct_labels, label_index


@given(
    st.sampled_from([0, 1, 7, 255, 256, 257, 1000]),
    st.sampled_from([0, 1, 5, 40]),
    st.sampled_from([10, 1 << 22]),
    st.integers(0, 2**32 - 1),
)
def test_few_and_many_labels_of_narrow_and_wide_range(size: int, count: int, highest: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    label_map = rng.integers(-3, highest, size)
    labels = rng.permutation(np.unique(rng.integers(-3, highest, count)))
    place = {int(label): k for k, label in enumerate(labels)}
    found = label_index(label_map, labels)
    assert found.dtype == np.int32
    assert found.tolist() == [place.get(int(label), -1) for label in label_map]
    assert distinct_labels(label_map).tolist() == sorted(set(label_map.tolist()))


@pytest.mark.parametrize("shape", [(3, 4), (30, 40)])
def test_positions_have_the_shape_of_the_map(shape: tuple[int, int]) -> None:
    label_map = np.arange(shape[0] * shape[1], dtype=np.int32).reshape(shape)
    assert label_index(label_map, [7, 0]).shape == shape
    assert label_index(label_map, [7, 0])[0, 0] == 1
