"""A linear layer in evaluation, computed by the faster of the two libraries for matrix products in PyTorch.

For float32, PyTorch itself uses MKL, which leaves half of the width of AVX-512 vectors unused on AMD's processors.
oneDNN, which PyTorch uses for other types, uses all of it at the same precision, and adds bias and ReLU on the way.
"""

from __future__ import annotations

from functools import cache

import torch
from torch import Tensor

ROW_STEP = 256
"""oneDNN computes only multiples of this number of rows: for each number, it compiles loops, which take half a
millisecond, and half a MiB as long as the process lives."""

LARGE = 2**23
"""Number of multiplications from which oneDNN is used. Its first call takes 5 MiB, and every call some 10 µs more than
MKL's, so narrow layers gain little."""


@cache
def has_wide_vectors() -> bool:
    """Return whether the processor has AVX-512, and this version of PyTorch offers oneDNN's linear layer."""
    return (
        torch.backends.cpu.get_cpu_capability() == "AVX512"
        and torch.backends.mkldnn.is_available()
        and hasattr(torch.ops.mkldnn, "_linear_pointwise")
    )


def linear_layer(rows: Tensor, weight: Tensor, bias: Tensor, relu: bool, out: Tensor | None) -> Tensor:
    """Apply a linear layer, followed by a ReLU if asked for.

    Args:
        rows: float32 [R, I], contiguous.
        weight: float32 [O, I], contiguous.
        bias: float32 [O].
        relu: Whether a ReLU follows.
        out: float32 [R, O], memory that the result may be written to. None if the operations are traced or need
            gradients, which PyTorch's own choice of library provides.

    Returns:
        float32 [R, O].
    """
    count = rows.size(0)
    if out is not None and count % ROW_STEP == 0 and count * weight.numel() >= LARGE and has_wide_vectors():
        product: Tensor = torch.ops.mkldnn._linear_pointwise(rows, weight, bias, "relu" if relu else "none", [], "")
        return product
    product = torch.addmm(bias, rows, weight.t(), out=out)
    return product.relu_() if relu else product
