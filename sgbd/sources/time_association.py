"""Pair images of two cameras or streams by their time stamps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def associate(
    first: npt.ArrayLike, second: npt.ArrayLike, tolerance: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Pair the time stamps of two recordings: two form a pair if each is the other's nearest.

    No time stamp is used twice, and the pairs are sorted by time. Of several equally near time stamps the earliest is
    used; of identical ones, the first.

    Args:
        first: float64 [N], seconds, in any order.
        second: float64 [M], seconds, from the same clock.
        tolerance: Maximum time difference of a pair, seconds.

    Returns:
        Two int64 arrays of equal length: indices into `first`, and the indices of their partners in `second`.

    Raises:
        ValueError: If the tolerance is negative or NaN.
    """
    if not tolerance >= 0:
        raise ValueError(f"the tolerance of time differences must be 0 or more, in seconds; got {tolerance}")
    one, other = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if one.size == 0 or other.size == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    one_order, other_order = np.argsort(one, kind="stable"), np.argsort(other, kind="stable")
    one, other = one[one_order], other[other_order]
    partner = _nearest(one, other)
    mutual = _nearest(other, one)[partner] == np.arange(one.size)
    kept = np.flatnonzero(mutual & (np.abs(one - other[partner]) <= tolerance))
    return one_order[kept], other_order[partner[kept]]


def _nearest(times: npt.NDArray[np.float64], among: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """Return, for each of `times`, the index of the nearest value in the sorted `among`; the earliest in a tie."""
    after = np.searchsorted(among, times).clip(0, among.size - 1)
    before = np.maximum(after - 1, 0)
    nearer_before = np.abs(times - among[before]) <= np.abs(times - among[after])
    # Of identical values, return the first, wherever the search ended among them.
    return np.searchsorted(among, among[np.where(nearer_before, before, after)])
