"""Doubly linked lists on arrays, for compiled loops: an item is in at most one list and leaves it in constant time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sgbd.machine.compiled import compiled


class LinkedLists(NamedTuple):
    """Lists of items; -1 stands for no item.

    Attributes:
        head: int64 [L], the first item of each list.
        following: int64 [M], the next item in the same list.
        preceding: int64 [M], the previous item in the same list.
    """

    head: NDArray[np.int64]
    following: NDArray[np.int64]
    preceding: NDArray[np.int64]

    @classmethod
    def empty(cls, lists: int, items: int) -> LinkedLists:
        """Return `lists` empty lists, and room for `items` items, none of them in a list."""
        return cls(np.full(lists, -1), *np.full((2, items), -1))


@compiled(inline="always")
def prepend(lists: LinkedLists, number: int | np.int64, item: int | np.int64) -> None:
    """Insert an item that is in no list at the beginning of list `number`."""
    first = lists.head[number]
    lists.following[item], lists.preceding[item] = first, -1
    if first >= 0:
        lists.preceding[first] = item
    lists.head[number] = item


@compiled(inline="always")
def unlink(lists: LinkedLists, number: int | np.int64, item: int | np.int64) -> None:
    """Remove an item from its list, `number`."""
    before, after = lists.preceding[item], lists.following[item]
    if before >= 0:
        lists.following[before] = after
    else:
        lists.head[number] = after
    if after >= 0:
        lists.preceding[after] = before
