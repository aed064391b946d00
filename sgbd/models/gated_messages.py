"""The messages of the gated graph convolution in training, with their gradient, as loops over the edges."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from sgbd.machine.compiled import HAS_NUMBA, compiled


def has_messages_compiled(*states: Tensor) -> bool:
    """Return whether `gated_messages` supports these states: float32 in CPU memory, and nothing is tracing."""
    return (
        HAS_NUMBA
        and all(type(x) is Tensor and x.device.type == "cpu" and x.dtype == torch.float32 for x in states)
        and not torch.jit.is_tracing()
        and not torch.compiler.is_compiling()
    )


def gated_messages(
    projected: Tensor, edge_terms: Tensor, neighbor: Tensor, center: Tensor
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Compute the gates and sum the gated messages, as `sgbd.models.gated_gcn.GatedConvolution` does with operations.

    The sums are the same in the same order, so results and gradients are the same, on common processors bit-identical.
    This avoids the matrices of one row per edge that the operations create, which take most of their time.

    Args:
        projected: float32 [N, 4C], A h, B h, U h and V h of every node.
        edge_terms: float32 [E, C], C e of every edge.
        neighbor: int64 [E], the node where each edge starts.
        center: int64 [E], the node where it ends.

    Returns:
        Gate logits [E, C]; U h [N, C]; the sums [N, C] of gated messages and of gates at each node.
    """
    results: tuple[Tensor, Tensor, Tensor, Tensor] = _GatedMessages.apply(projected, edge_terms, neighbor, center)
    return results


class _GatedMessages(torch.autograd.Function):
    """The autograd function of `gated_messages`."""

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
    """Write the gate logits of every edge, A h_center + B h_neighbor + C e, float32 [E, C]."""
    channels = logits.shape[1]
    for edge in range(len(centers)):
        center, neighbor = centers[edge], neighbors[edge]
        for c in range(channels):
            logits[edge, c] = projected[center, c] + projected[neighbor, channels + c] + edge_terms[edge, c]


@compiled
def _sum_messages(projected, gates, neighbors, centers, weighted, total):  # type: ignore[no-untyped-def]
    """Add the gated messages, gate · V h_neighbor, and the gates of all edges to the sums at their centres."""
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
    """Propagate the gradients of the four results back, in the order of operations of PyTorch's own gradients.

    Args:
        projected: float32 [N, 4C], as in `gated_messages`.
        gates: float32 [E, C], the sigmoids of the gate logits.
        neighbors: int64 [E].
        centers: int64 [E].
        of_logits: float32 [E, C], gradient of the gate logits.
        of_weighted: float32 [N, C], gradient of the sums of gated messages.
        of_total: float32 [N, C], gradient of the sums of gates.
        of_projected: float32 [N, 4C], with the gradient of U h in place and zeros elsewhere; the gradients of A h, B h
            and V h are added.
        of_edge_terms: float32 [E, C], written: gradient of the edge terms.
    """
    channels = gates.shape[1]
    one = np.float32(1)
    for edge in range(len(centers)):
        center, neighbor = centers[edge], neighbors[edge]
        for c in range(channels):
            # sigmoid' = gate (1 - gate). The logit is a sum, so its gradient is that of A h, B h and C e.
            gate = gates[edge, c]
            of_gate = of_weighted[center, c] * projected[neighbor, 3 * channels + c] + of_total[center, c]
            of_edge_terms[edge, c] = of_gate * (one - gate) * gate + of_logits[edge, c]
            of_projected[neighbor, 3 * channels + c] += of_weighted[center, c] * gate
        for c in range(channels):
            of_projected[center, c] += of_edge_terms[edge, c]
            of_projected[neighbor, channels + c] += of_edge_terms[edge, c]
