"""A multilayer perceptron, with faster computation of the same results in evaluation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import batch_norm, dropout, linear

from sgbd.machine.reused_memory import reused
from sgbd.machine.side_by_side import bands, side_by_side, thread_count
from sgbd.models.in_evaluation import can_be_overwritten, scale_and_shift
from sgbd.models.linear_layer import ROW_STEP, linear_layer

ROWS_AT_ONCE = 512
"""Maximum number of rows that go through all layers together: their states fit into the caches of common processors."""

TOO_FEW_TO_SHARE = 128
"""Up to this many rows are computed in less time than a second thread needs to start."""


def normalized_rows(norm: nn.BatchNorm1d, rows: Tensor) -> Tensor:
    """Normalise rows [R, channels] by the moments of the batch, or, in training on a single row, the running ones."""
    if not norm.training or rows.size(0) > 1:
        normalized: Tensor = norm(rows)
        return normalized
    return batch_norm(rows, norm.running_mean, norm.running_var, norm.weight, norm.bias, False, 0.0, norm.eps)


class RowNorm(nn.Module):
    """Batch normalisation that uses the running moments for a batch of a single row, which has no variance.

    Args:
        channels: Width of the rows.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.module = nn.BatchNorm1d(channels)

    def forward(self, rows: Tensor) -> Tensor:
        """Normalise rows [R, channels]."""
        return normalized_rows(self.module, rows)

    def fold(self, weight: Tensor, bias: Tensor) -> tuple[Tensor, Tensor]:
        """Fold the fixed scale and shift per column, as in evaluation, into the linear layer before this one."""
        scale, shift = scale_and_shift(self.module)
        return weight * scale[:, None], bias * scale + shift


class Perceptron(nn.Module):
    """Linear layers with batch norm, ReLU and dropout in between.

    It has the parameters, parameter names and results of `torch_geometric.nn.MLP`, as far as that class is used here,
    without the seconds and the hundreds of MiB that importing PyG takes.

    Args:
        channels: Width of the input, of each hidden layer, and of the output.
        norm: Whether batch norm precedes each ReLU.
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
        self._widest = max(channels[1:])
        self.dropout = dropout
        self.lins = nn.ModuleList(nn.Linear(before, after, bias) for before, after in pairwise(channels))
        normed = channels[1:-1] if plain_last else channels[1:]
        self.norms = nn.ModuleList(RowNorm(width) if norm else nn.Identity() for width in normed)

    def forward(self, rows: Tensor) -> Tensor:
        """Map rows [R, channels[0]] to outputs [R, channels[-1]]."""
        for place, layer in enumerate(self.lins):
            rows = layer(rows)
            if place < len(self.norms):
                rows = dropout(self.norms[place](rows).relu_(), self.dropout, self.training)
        return rows

    def folded(self) -> list[tuple[Tensor, Tensor, bool]]:
        """Return, for each layer in evaluation, its weight [out, in], its bias [out] and whether a ReLU follows."""
        layers = []
        for place, layer in enumerate(self.lins):
            assert isinstance(layer, nn.Linear)
            weight: Tensor = layer.weight
            bias: Tensor = weight.new_zeros(weight.size(0)) if layer.bias is None else layer.bias
            hidden = place < len(self.norms)
            norm = self.norms[place] if hidden else None
            if isinstance(norm, RowNorm):
                weight, bias = norm.fold(weight, bias)
            layers.append((weight, bias, hidden))
        return layers

    def evaluate(self, rows: Tensor) -> Tensor:
        """Compute what `forward` returns in evaluation, faster.

        Norms are folded into the linear layers, and one block of rows at a time goes through all layers, so that it
        stays in the processor's caches.
        """
        return self._in_blocks(rows.size(0), rows, self.folded(), lambda block, memory: rows[block])

    def evaluate_pairs(self, nodes: Tensor, edges: Tensor, pairs: Tensor) -> Tensor:
        """Compute what `evaluate` returns for the rows ``[nodes[pairs[0]], nodes[pairs[1]], edges]``.

        The first layer is a sum of three terms: of the source node, the target node and the edge. The two terms of a
        node are computed once for all its pairs.

        Args:
            nodes: float32 [N, H].
            edges: float32 [P, C].
            pairs: int64 [2, P].

        Returns:
            [P, channels[-1]].
        """
        (weight, bias, hidden), *layers = self.folded()
        width = nodes.size(1)
        for_source, for_target, for_edge = weight[:, :width], weight[:, width : 2 * width], weight[:, 2 * width :]
        of_source, of_target = linear(nodes, for_source), linear(nodes, for_target, bias)

        def first_layer(block: slice, memory: TurnedMemory) -> Tensor:
            source, target = pairs[0, block], pairs[1, block]
            size = source.size(0), bias.size(0)
            added = torch.index_select(of_target, 0, target, out=memory.take(*size))
            rows = torch.index_select(of_source, 0, source, out=memory.take(*size))
            rows += added
            if edges.size(1):
                rows.addmm_(edges[block], for_edge.t())
            return rows.relu_() if hidden else rows

        return self._in_blocks(pairs.size(1), nodes, layers, first_layer)

    def _in_blocks(
        self,
        count: int,
        given: Tensor,
        layers: Sequence[tuple[Tensor, Tensor, bool]],
        start: Callable[[slice, TurnedMemory], Tensor],
    ) -> Tensor:
        """Run rows through layers block by block; if PyTorch works in a single thread, several blocks run in parallel.

        Args:
            count: Number of rows.
            given: The tensor that the rows are computed from.
            layers: As returned by `folded`.
            start: Returns the rows of a block; if it computes them, in the memory that it is given.

        Returns:
            [count, channels[-1]].
        """
        if torch.compiler.is_compiling():  # the code must hold for any number of rows; blocks would fix that number
            return _through(layers, start(slice(None), TurnedMemory(0)), TurnedMemory(0))
        blocks = equal_blocks(count)
        if not (layers and can_be_overwritten(given)):
            memory = TurnedMemory(0)
            return torch.cat([_through(layers, start(rows, memory), memory)[known:] for rows, known in blocks])
        scores = given.new_empty(count, self.out_channels)
        inference = torch.is_inference_mode_enabled()

        def evaluate(rows: slice, known: int) -> None:
            # Gradient and inference modes are per thread, and so is the reused memory.
            with torch.inference_mode(inference), torch.no_grad():
                memory = TurnedMemory(self._widest)
                scores[rows][known:] = _through(layers, start(rows, memory), memory)[known:]

        threads = thread_count() if torch.get_num_threads() == 1 else 1
        side_by_side([partial(evaluate, *block) for block in blocks], threads)
        return scores


class TurnedMemory:
    """Memory for the states of a block of rows in two alternating parts: a layer reads one part and writes the other.

    Args:
        width: Maximum number of columns; 0 to provide no memory, so that operations allocate their own.
    """

    def __init__(self, width: int) -> None:
        # Reused from call to call: allocating fresh memory takes as long as the computation itself.
        names = ("perceptron_0", "perceptron_1") if width else ()
        self._parts = [torch.from_numpy(reused(name, (ROWS_AT_ONCE * width,), np.float32)) for name in names]

    def take(self, rows: int, columns: int) -> Tensor | None:
        """Return the part that was not taken last, float32 [rows, columns], uninitialised; None if there is none."""
        if not self._parts:
            return None
        self._parts.reverse()
        return self._parts[0][: rows * columns].view(rows, columns)


def equal_blocks(count: int) -> list[tuple[slice, int]]:
    """Cut rows into blocks of about equal size, as few as `ROWS_AT_ONCE` allows, but an even number for two threads.

    Unless there are few rows, sizes are multiples of `ROW_STEP`, and the last block may therefore begin with rows of
    the block before. The blocks do not depend on the number of threads, because their limits may affect rounding.

    Args:
        count: Number of rows.

    Returns:
        For each block, its rows, and how many of them the block before it contains.
    """
    if count <= TOO_FEW_TO_SHARE:
        return [(slice(0, count), 0)]
    if count <= 2 * ROW_STEP:
        return [(slice(*band), 0) for band in bands(count, 2)]
    steps = -(-count // ROW_STEP)
    number = 2 * -(-steps * ROW_STEP // (2 * ROWS_AT_ONCE))
    blocks = []
    for first, last in bands(steps, number):
        stop = min(last * ROW_STEP, count)
        start = stop - (last - first) * ROW_STEP
        blocks.append((slice(start, stop), first * ROW_STEP - start))
    return blocks


def _through(layers: Sequence[tuple[Tensor, Tensor, bool]], rows: Tensor, memory: TurnedMemory) -> Tensor:
    """Run rows through layers."""
    for weight, bias, hidden in layers:
        rows = linear_layer(rows, weight, bias, hidden, out=memory.take(rows.size(0), weight.size(0)))
    return rows
