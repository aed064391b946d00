"""What networks may take for granted in evaluation, and nowhere else."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from sgbd.machine.compiled import HAS_NUMBA


def can_be_compiled(network: nn.Module, x: Tensor) -> bool:
    """Say whether compiled loops may do the work of a network's layers.

    Args:
        network: The network.
        x: float32 [N, F], its input.

    Returns:
        Whether Numba is there, the network is in evaluation mode, and `can_be_overwritten` holds for its input.
    """
    return HAS_NUMBA and not network.training and can_be_overwritten(x)


def can_be_overwritten(x: Tensor) -> bool:
    """Say whether what is computed from a tensor may go to memory of one's own choice, to be overwritten later.

    Args:
        x: What is computed from.

    Returns:
        Whether no gradient is asked for, nobody traces the operations or changes their type, and the numbers are
        float32 in the memory of the CPU.
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
    """Return what batch norm does in evaluation: a factor [C], and what is added then [C]."""
    assert norm.running_mean is not None
    assert norm.running_var is not None
    scale = norm.weight * torch.rsqrt(norm.running_var + norm.eps)
    return scale, norm.bias - norm.running_mean * scale
