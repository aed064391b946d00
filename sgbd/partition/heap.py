"""A binary heap on arrays, for compiled loops.

It works like `heapq`, but needs no list of tuples per graph; building that list would take a fifth of the time of a
partition. The heap does not store its size: the caller keeps it and passes it to every call.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sgbd.machine.compiled import compiled


class Heap(NamedTuple):
    """Items ordered by key: the largest key comes first; among equal keys, the lowest item.

    Attributes:
        key: float64 [room].
        item: int64 [room].
    """

    key: NDArray[np.float64]
    item: NDArray[np.int64]

    @classmethod
    def with_room(cls, room: int) -> Heap:
        """Return an empty heap with room for this many items."""
        return cls(np.empty(room), np.empty(room, dtype=np.int64))


@compiled
def push(heap: Heap, size: int, key: float, item: int) -> int:
    """Push an item onto a heap of `size` items, and return the new size."""
    keys, items = heap
    here = size
    while here > 0:
        above = (here - 1) // 2
        if keys[above] > key or (keys[above] == key and items[above] <= item):
            break
        keys[here], items[here] = keys[above], items[above]
        here = above
    keys[here], items[here] = key, item
    return size + 1


@compiled
def pop(heap: Heap, size: int) -> int:
    """Remove the first item, which is `heap.item[0]`, from a heap of `size` items, and return the new size."""
    keys, items = heap
    size -= 1
    key, item = keys[size], items[size]
    here = 0
    while 2 * here + 1 < size:
        below = 2 * here + 1
        other = below + 1
        if other < size and (keys[other] > keys[below] or (keys[other] == keys[below] and items[other] < items[below])):
            below = other
        if key > keys[below] or (key == keys[below] and item <= items[below]):
            break
        keys[here], items[here] = keys[below], items[below]
        here = below
    keys[here], items[here] = key, item
    return size
