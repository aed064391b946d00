"""Number of threads of PyTorch's operations."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import torch

_inside: dict[int, tuple[int, int]] = {}
"""Of every thread inside `torch_threads`: the number that it uses, and the number that it will return to."""
_lock = threading.Lock()


def _forget() -> None:
    """Release the lock in a forked child, in which no other thread exists."""
    _inside.clear()
    _lock.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_forget)


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Run PyTorch's operations in this many threads inside the context.

    The matrices of a superpixel graph are small: a second thread gains little on an idle machine. If the cores are
    busy, the threads wait for each other, which costs an order of magnitude.

    Args:
        count: Number of threads, at least 1.
    """
    thread = threading.get_ident()
    with _lock:
        before = torch.get_num_threads()
        outermost = thread not in _inside
        if outermost:
            # A thread that is new to PyTorch starts with the number set last in any thread. If another thread set it
            # for such a context, it must not outlast the context.
            before = next((earlier for used, earlier in _inside.values() if used == before), before)
        torch.set_num_threads(count)
        if outermost:
            _inside[thread] = count, before
    try:
        yield
    finally:
        with _lock:
            torch.set_num_threads(before)
            if outermost:
                _inside.pop(thread, None)
