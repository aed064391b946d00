"""A multilayer perceptron, and the short ways to its results that there are in evaluation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import batch_norm, dropout, linear

from sgbd.models.in_evaluation import scale_and_shift
from sgbd.side_by_side import side_by_side, thread_count

EVALUATED_AT_ONCE = 512
"""Rows whose hidden states fit into the second-level cache of common processors."""


class RowNorm(nn.Module):
    """Batch normalisation that takes a batch of a single row, which has no variance, by the running moments.

    Args:
        channels: Width of the rows.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.module = nn.BatchNorm1d(channels)

    def forward(self, rows: Tensor) -> Tensor:
        """Normalise rows [R, channels]."""
        norm = self.module
        if not self.training or rows.size(0) > 1:
            normalized: Tensor = norm(rows)
            return normalized
        return batch_norm(rows, norm.running_mean, norm.running_var, norm.weight, norm.bias, False, 0.0, norm.eps)

    def fold(self, weight: Tensor, bias: Tensor) -> tuple[Tensor, Tensor]:
        """Put what this does in evaluation, a fixed scale and shift of each column, into the linear layer before it."""
        scale, shift = scale_and_shift(self.module)
        return weight * scale[:, None], bias * scale + shift


class Perceptron(nn.Module):
    """Linear layers with batch norm, ReLU and dropout in between.

    It has the parameters, their names and the results of `torch_geometric.nn.MLP`, for what that class is used for
    here, without the seconds and the hundreds of MiB that it takes to import PyG.

    Args:
        channels: Width of the input, of each hidden layer, and of the output.
        norm: Whether batch norm stands before each ReLU.
        plain_last: Whether the last layer is linear only. Otherwise batch norm, ReLU and dropout follow it too.
        bias: Whether the linear layers have a bias.
        dropout: Share of hidden units dropped in training.
    """

    def __init__(
        self,
        channels: Sequence[int],
        *,
        norm: bool = True,
        plain_last: bool = True,
        bias: bool = True,
        dropout: float = 0.0,
    ) -> None:
        super().__init__()
        self.out_channels = channels[-1]
        self.dropout = dropout
        self.lins = nn.ModuleList(nn.Linear(before, after, bias) for before, after in pairwise(channels))
        normed = channels[1:-1] if plain_last else channels[1:]
        self.norms = nn.ModuleList(RowNorm(width) if norm else nn.Identity() for width in normed)

    def forward(self, rows: Tensor) -> Tensor:
        """Give the output of rows [R, channels[0]]: [R, channels[-1]]."""
        for place, layer in enumerate(self.lins):
            rows = layer(rows)
            if place < len(self.norms):
                rows = dropout(self.norms[place](rows).relu_(), self.dropout, self.training)
        return rows

    def folded(self) -> list[tuple[Tensor, Tensor, bool]]:
        """Return weight [out, in], bias [out] and whether a ReLU follows, of each layer in evaluation."""
        layers = []
        for place, layer in enumerate(self.lins):
            assert isinstance(layer, nn.Linear)
            weight = layer.weight
            bias = weight.new_zeros(weight.size(0)) if layer.bias is None else layer.bias
            hidden = place < len(self.norms)
            norm = self.norms[place] if hidden else None
            layers.append((*(norm.fold(weight, bias) if isinstance(norm, RowNorm) else (weight, bias)), hidden))
        return layers

    def evaluate(self, rows: Tensor) -> Tensor:
        """Compute what `forward` gives in evaluation, with less to do.

        Norms are part of the linear layers, and a block of rows at a time stays in the processor's cache through all
        layers.
        """
        layers = self.folded()
        return _in_blocks(rows.size(0), lambda block: _through(layers, rows[block]))

    def evaluate_pairs(self, nodes: Tensor, edges: Tensor, pairs: Tensor) -> Tensor:
        """Compute what `evaluate` gives for the rows ``[nodes[pairs[0]], nodes[pairs[1]], edges]``.

        The first layer is a sum of one term for each node, as source and as target, and one for each edge: a node's is
        computed once for all its pairs.

        Args:
            nodes: float32 [N, H].
            edges: float32 [P, C].
            pairs: int64 [2, P].

        Returns:
            [P, channels[-1]].
        """
        (weight, bias, hidden), *layers = self.folded()
        width = nodes.size(1)
        of_source = linear(nodes, weight[:, :width])
        of_target = linear(nodes, weight[:, width : 2 * width], bias)
        of_edge = weight[:, 2 * width :].t()

        def evaluate(block: slice) -> Tensor:
            rows = of_source.index_select(0, pairs[0, block])
            rows += of_target.index_select(0, pairs[1, block])
            if edges.size(1):
                rows.addmm_(edges[block], of_edge)
            return _through(layers, rows.relu_() if hidden else rows)

        return _in_blocks(pairs.size(1), evaluate)


def _in_blocks(count: int, evaluate: Callable[[slice], Tensor]) -> Tensor:
    """Evaluate rows block by block, several at a time; as one block where operations are traced for any number of rows.

    Threads share the blocks out where each operation runs in a single one; the blocks, and with them the rounding, stay
    the same.
    """
    if torch.compiler.is_compiling():
        return evaluate(slice(None))
    inference = torch.is_inference_mode_enabled()

    def in_mode(block: slice) -> Tensor:
        # Modes are a matter of the thread.
        with torch.inference_mode(inference), torch.no_grad():
            return evaluate(block)

    blocks = [slice(start, start + EVALUATED_AT_ONCE) for start in range(0, max(count, 1), EVALUATED_AT_ONCE)]
    if torch.is_grad_enabled() or torch.get_num_threads() > 1:
        return torch.cat([evaluate(block) for block in blocks])
    return torch.cat(side_by_side([partial(in_mode, block) for block in blocks], thread_count()))


def _through(layers: Sequence[tuple[Tensor, Tensor, bool]], rows: Tensor) -> Tensor:
    for weight, bias, hidden in layers:
        rows = linear(rows, weight, bias)
        if hidden:
            rows = rows.relu_()
    return rows
