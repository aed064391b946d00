"""The messages of the gated graph convolution in training, with their gradient, as loops over the edges."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from sgbd.machine.compiled import HAS_NUMBA, compiled


def has_messages_compiled(*states: Tensor) -> bool:
    """Say whether `gated_messages` can take these states: numbers where loops reach them, and nobody traces."""
    return (
        HAS_NUMBA
        and all(type(x) is Tensor and x.device.type == "cpu" and x.dtype == torch.float32 for x in states)
        and not torch.jit.is_tracing()
        and not torch.compiler.is_compiling()
    )


def gated_messages(
    projected: Tensor, edge_terms: Tensor, neighbor: Tensor, center: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Compute the gates and sum up what passes them, as `sgbd.models.gated_gcn.GatedConvolution` does by operations.

    The same sums in the same order, so that results and gradients are the same, on common processors to the last bit;
    without the matrices of a row for each edge that the operations leave behind, which take most of their time.

    Args:
        projected: float32 [N, 4C], A h, B h, U h and V h of every node.
        edge_terms: float32 [E, C], C e of every edge.
        neighbor: int64 [E], where each edge comes from.
        center: int64 [E], where it leads to.

    Returns:
        Gate logits [E, C]; U h [N, C]; the sums [N, C] of gated messages and of gates at each node.
    """
    results: tuple[Tensor, Tensor, Tensor, Tensor] = _GatedMessages.apply(projected, edge_terms, neighbor, center)
    return results


class _GatedMessages(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, projected: Tensor, edge_terms: Tensor, neighbor: Tensor, center: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        projected, (neighbor, center) = projected.contiguous(), (neighbor.contiguous(), center.contiguous())
        channels = edge_terms.size(1)
        logits = torch.empty_like(edge_terms, memory_format=torch.contiguous_format)
        _sum_logits(
            projected.numpy(), edge_terms.contiguous().numpy(), neighbor.numpy(), center.numpy(), logits.numpy()
        )
        gates = torch.sigmoid(logits)
        weighted, total = projected.new_zeros(2, projected.size(0), channels)
        _sum_messages(
            projected.numpy(), gates.numpy(), neighbor.numpy(), center.numpy(), weighted.numpy(), total.numpy()
        )
        ctx.save_for_backward(projected, gates, neighbor, center)
        return logits, projected[:, 2 * channels : 3 * channels].clone(), weighted, total

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, None, None]:
        projected, gates, neighbor, center = ctx.saved_tensors
        of_logits, of_own, of_weighted, of_total = (gradient.contiguous() for gradient in gradients)
        channels = gates.size(1)
        of_projected = torch.zeros_like(projected)
        of_projected[:, 2 * channels : 3 * channels] = of_own
        of_edge_terms = torch.empty_like(gates)
        _distribute(
            projected.numpy(),
            gates.numpy(),
            neighbor.numpy(),
            center.numpy(),
            of_logits.numpy(),
            of_weighted.numpy(),
            of_total.numpy(),
            of_projected.numpy(),
            of_edge_terms.numpy(),
        )
        return of_projected, of_edge_terms, None, None


@compiled
def _sum_logits(projected, edge_terms, neighbors, centers, logits):  # type: ignore[no-untyped-def]
    channels = logits.shape[1]
    for edge in range(len(centers)):
        center, neighbor = centers[edge], neighbors[edge]
        for c in range(channels):
            logits[edge, c] = projected[center, c] + projected[neighbor, channels + c] + edge_terms[edge, c]


@compiled
def _sum_messages(projected, gates, neighbors, centers, weighted, total):  # type: ignore[no-untyped-def]
    channels = gates.shape[1]
    for edge in range(len(centers)):
        center, neighbor = centers[edge], neighbors[edge]
        for c in range(channels):
            weighted[center, c] += gates[edge, c] * projected[neighbor, 3 * channels + c]
            total[center, c] += gates[edge, c]


@compiled
def _distribute(  # type: ignore[no-untyped-def]
    projected, gates, neighbors, centers, of_logits, of_weighted, of_total, of_projected, of_edge_terms
):
    """Lead the gradient of the four results back; the order of operations is that of PyTorch's own gradients."""
    channels = gates.shape[1]
    one = np.float32(1)
    for edge in range(len(centers)):
        center, neighbor = centers[edge], neighbors[edge]
        for c in range(channels):
            gate = gates[edge, c]
            of_gate = of_weighted[center, c] * projected[neighbor, 3 * channels + c] + of_total[center, c]
            of_edge_terms[edge, c] = of_gate * (one - gate) * gate + of_logits[edge, c]
            of_projected[neighbor, 3 * channels + c] += of_weighted[center, c] * gate
        for c in range(channels):
            of_projected[center, c] += of_edge_terms[edge, c]
            of_projected[neighbor, channels + c] += of_edge_terms[edge, c]
