"""Sums and means over groups of rows, such as the messages that reach one superpixel."""

from __future__ import annotations

from torch import Tensor


def sum_by(group: Tensor, rows: Tensor, groups: int) -> Tensor:
    """Sum rows by their group.

    Args:
        group: int64 [R], group of each row.
        rows: float [R, C].
        groups: Number of groups.

    Returns:
        [groups, C]; 0 for a group without rows.
    """
    return rows.new_zeros(groups, rows.size(1)).index_add_(0, group, rows)


def mean_by(group: Tensor, rows: Tensor, groups: int) -> Tensor:
    """Average rows by their group; arguments and result as in `sum_by`."""
    count = rows.new_zeros(groups).index_add_(0, group, rows.new_ones(rows.size(0)))
    return sum_by(group, rows, groups) / count.clamp(min=1)[:, None]
