"""Items made in a thread, each while the one before it is worked on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from sgbd.machine.side_by_side import thread_count

Item = TypeVar("Item")


def one_ahead(make: Callable[[], Item | None]) -> Iterator[Item]:
    """Make items one after the other, the next one in a thread of its own while the caller works on this one.

    They are made in turn, by one thread, and none is begun before the one before the last was taken: the results are
    those of a plain loop. On a single processor it is one.

    Args:
        make: Makes the next item; None ends the items.

    Yields:
        The items in turn.

    Raises:
        BaseException: What `make` raised, where the item that it did not make would have come.
    """
    if thread_count() == 1:
        while (item := make()) is not None:
            yield item
        return
    # Leaving the block, also where the caller breaks off, waits for the item that is being made.
    with ThreadPoolExecutor(1, "sgbd_one_ahead") as thread:
        future = thread.submit(make)
        while (item := future.result()) is not None:
            future = thread.submit(make)
            yield item
