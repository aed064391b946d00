"""What networks may take for granted in evaluation, and nowhere else."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from sgbd.compiled import HAS_NUMBA


def can_be_compiled(network: nn.Module, x: Tensor) -> bool:
    """Say whether compiled loops may do the work of a network's layers.

    Args:
        network: The network.
        x: float32 [N, F], its input.

    Returns:
        Whether no gradient is asked for, nobody traces the operations, and the numbers lie where loops can reach them.
    """
    return (
        HAS_NUMBA
        and not network.training
        and not torch.is_grad_enabled()
        and type(x) is Tensor
        and x.device.type == "cpu"
        and x.dtype == torch.float32
        and not torch.jit.is_tracing()
        and not torch.compiler.is_compiling()
    )


def scale_and_shift(norm: nn.BatchNorm1d) -> tuple[Tensor, Tensor]:
    """Return what batch norm does in evaluation: a factor [C], and what is added then [C]."""
    assert norm.running_mean is not None
    assert norm.running_var is not None
    scale = norm.weight * torch.rsqrt(norm.running_var + norm.eps)
    return scale, norm.bias - norm.running_mean * scale
