"""Precision of float32 matrix products, which in PyTorch is a setting of the process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

PRECISIONS = ("highest", "high", "medium")
"""PyTorch's names."""


@contextmanager
def matmul_precision(name: str) -> Iterator[None]:
    """Compute float32 matrix products with this precision inside the context.

    If the program has set the precision of a single backend (`torch.backends.cuda.matmul.fp32_precision`), that setting
    stays: PyTorch cannot tell the precision of all then, so it could not be set back.

    Args:
        name: One of `PRECISIONS`, see `torch.set_float32_matmul_precision`.
    """
    try:
        before = torch.get_float32_matmul_precision()
    except RuntimeError:
        yield
        return
    torch.set_float32_matmul_precision(name)
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)
