"""Conditions and conversions for faster evaluation of networks; none of it holds in training."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from sgbd.machine.compiled import HAS_NUMBA


def can_be_compiled(network: nn.Module, x: Tensor) -> bool:
    """Return whether compiled loops may replace a network's layers.

    Args:
        network: The network.
        x: float32 [N, F], its input.

    Returns:
        Whether Numba is installed, the network is in evaluation mode, and `can_be_overwritten` holds for its input.
    """
    return HAS_NUMBA and not network.training and can_be_overwritten(x)


def can_be_overwritten(x: Tensor) -> bool:
    """Return whether results computed from a tensor may be written into preallocated memory that is overwritten later.

    Args:
        x: The input of the computation.

    Returns:
        Whether gradients are off, nothing traces the operations or changes their type, and the tensor is float32 in CPU
        memory.
    """
    return (
        not torch.is_grad_enabled()
        and type(x) is Tensor
        and x.device.type == "cpu"
        and x.dtype == torch.float32
        and not torch.jit.is_tracing()
        and not torch.compiler.is_compiling()
        and not torch.is_autocast_enabled("cpu")
    )


def scale_and_shift(norm: nn.BatchNorm1d) -> tuple[Tensor, Tensor]:
    """Return what batch norm applies in evaluation: a factor, float32 [C], and then an offset, float32 [C]."""
    assert norm.running_mean is not None
    assert norm.running_var is not None
    scale = norm.weight * torch.rsqrt(norm.running_var + norm.eps)
    return scale, norm.bias - norm.running_mean * scale
