"""Moments accumulated in pieces, and the treatment of constant columns."""

from __future__ import annotations

import itertools

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.models.standardize import ColumnMoments, Standardize


@settings(max_examples=30, deadline=None)
@given(cuts=st.lists(st.integers(0, 40), max_size=4), offset=st.sampled_from([0.0, 3.0, 1e4]), seed=st.integers(0, 99))
def test_moments_in_pieces_are_the_moments_of_the_whole(cuts: list[int], offset: float, seed: int) -> None:
    rows = torch.randn(40, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64) + offset
    moments = ColumnMoments(3)
    edges = [0, *sorted(cuts), 40]
    for start, stop in itertools.pairwise(edges):
        moments.update(rows[start:stop])
    assert moments.count == 40
    torch.testing.assert_close(moments.mean, rows.mean(0), rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(moments.scale, rows.std(0, correction=0), rtol=1e-9, atol=1e-12)


def test_a_constant_column_becomes_zero_not_noise() -> None:
    module = Standardize(2)
    module.fit([torch.tensor([[0.1, 1.0], [0.1, 3.0], [0.1, 2.0]])])
    out = module(torch.tensor([[0.1, 2.0], [0.1, 3.0]]))
    torch.testing.assert_close(out, torch.tensor([[0.0, 0.0], [0.0, 1.5**0.5]]))


def test_unfitted_hands_through() -> None:
    rows = torch.randn(4, 2)
    assert torch.equal(Standardize(2)(rows), rows)


def test_no_columns() -> None:
    module = Standardize(0)
    module.fit([torch.empty(5, 0)])
    assert module(torch.empty(7, 0)).shape == (7, 0)


def test_moments_are_in_the_state_but_are_no_parameters() -> None:
    module = Standardize(2)
    assert set(module.state_dict()) == {"mean", "scale"}
    assert list(module.parameters()) == []


def test_another_width_is_refused() -> None:
    with pytest.raises(ValueError, match="standardises 2 columns; the data has 3"):
        Standardize(2).fit(ColumnMoments(3))
