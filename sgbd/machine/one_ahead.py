"""Compute the next item in a thread while the caller works on the current one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from sgbd.machine.side_by_side import thread_count

Item = TypeVar("Item")


def one_ahead(make: Callable[[], Item | None]) -> Iterator[Item]:
    """Make items one after another, the next one in a separate thread while the caller works on the current one.

    One thread makes them in order, and starts an item only when the caller asks for the one before it, so the results
    are those of a plain loop. On a single processor it is a plain loop.

    Args:
        make: Makes the next item; None ends the items.

    Yields:
        The items in order.

    Raises:
        BaseException: What `make` raised, in place of the item that it failed to make.
    """
    if thread_count() == 1:
        while (item := make()) is not None:
            yield item
        return
    # Leaving the block waits for the item being made, also if the caller stops early.
    with ThreadPoolExecutor(1, "sgbd_one_ahead") as thread:
        future = thread.submit(make)
        while (item := future.result()) is not None:
            future = thread.submit(make)
            yield item
