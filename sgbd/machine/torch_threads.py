"""Number of threads of PyTorch's operations."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Run PyTorch's operations in this many threads inside the context.

    The matrices of a superpixel graph are small: a second thread gains little on an idle machine. If the cores are
    busy, the threads wait for each other, which costs an order of magnitude.

    Args:
        count: Number of threads, at least 1.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
