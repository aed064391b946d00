"""Gated graph convolutions in evaluation as one pass over the edges, whose data stays in a processor's caches."""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from sgbd.machine.compiled import compiled
from sgbd.machine.side_by_side import bands, side_by_side, thread_count

Floats = npt.NDArray[np.float32]

# Coefficients of the Taylor series of 2 ** f for f from -1/2 to 1/2, exact to the rounding of float32.
_C1, _C2, _C3, _C4, _C5, _C6 = (
    np.float32(np.log(2.0) ** k / f) for k, f in ((1, 1), (2, 2), (3, 6), (4, 24), (5, 120), (6, 720))
)
_ONE, _HALF, _ZERO = np.float32(1), np.float32(0.5), np.float32(0)
_LOG2_E = np.float32(np.log2(np.e))
_LARGEST = np.float32(80)  # logits are clipped here, where a gate is as good as 0 or 1
_EPSILON = np.float32(1e-6)
_BIAS, _MANTISSA = np.int32(127), np.int32(23)  # layout of a float32


def gated_pass(
    projected: Floats,
    edge_terms: Floats,
    nodes: Floats,
    edges: Floats,
    first: npt.NDArray[np.int64],
    neighbors: npt.NDArray[np.int64],
    node_scale: Floats,
    node_shift: Floats,
    edge_scale: Floats,
    edge_shift: Floats,
) -> None:
    """Update the states of nodes and edges in place, as `sgbd.models.gated_gcn.GatedConvolution` does in evaluation.

    Args:
        projected: float32 [N, 4C], A h + bias, B h + bias, U h + bias and V h + bias of every node.
        edge_terms: float32 [2E, C], C e of every edge.
        nodes: float32 [N, C], states of the nodes.
        edges: float32 [2E, C], states of the edges, sorted by the node where they end.
        first: int64 [N + 1], index of the first edge that ends at each node; the last entry is 2E.
        neighbors: int64 [2E], the node where each edge starts.
        node_scale: float32 [C], factor of the nodes' batch norm.
        node_shift: float32 [C], its offset, added after scaling.
        edge_scale: float32 [C], factor of the edges' batch norm.
        edge_shift: float32 [C], its offset.
    """
    arrays = (
        projected, edge_terms, nodes, edges, first, neighbors, node_scale, node_shift, edge_scale, edge_shift
    )  # fmt: skip
    threads = thread_count()
    side_by_side(
        [partial(_update_nodes, *arrays, *work_space(nodes.shape[1]), *band) for band in bands(len(nodes), threads)],
        threads,
    )


def work_space(channels: int) -> tuple[Floats, Floats, npt.NDArray[np.int32], Floats]:
    """Allocate the work space of one thread for `_update_nodes`.

    Args:
        channels: Width C of the states.

    Returns:
        Sums float32 [2, C], gates float32 [C], and one array viewed as int32 [C] and as float32 [C], for `_sigmoid`.
    """
    bits = np.empty(channels, np.int32)
    return np.empty((2, channels), np.float32), np.empty(channels, np.float32), bits, bits.view(np.float32)


@compiled(fastmath=True)
def _update_nodes(  # type: ignore[no-untyped-def]
    projected, edge_terms, nodes, edges, first, neighbors, node_scale, node_shift, edge_scale, edge_shift,
    sums, gates, bits, power, begin, end
):  # fmt: skip
    """Update the nodes `begin` to `end` - 1, and the edges that end at them.

    `sums` to `power` come from `work_space`; the other arguments are those of `gated_pass`.
    """
    channels = nodes.shape[1]
    weighted, total = sums[0], sums[1]
    for center in range(begin, end):
        for c in range(channels):
            weighted[c] = _ZERO
            total[c] = _ZERO
        for edge in range(first[center], first[center + 1]):
            neighbor = neighbors[edge]
            for c in range(channels):
                logit = projected[center, c] + projected[neighbor, channels + c] + edge_terms[edge, c]
                edges[edge, c] += max(logit * edge_scale[c] + edge_shift[c], _ZERO)
                gates[c] = logit
            _sigmoid(gates, bits, power)
            for c in range(channels):
                weighted[c] += gates[c] * projected[neighbor, 3 * channels + c]
                total[c] += gates[c]
        for c in range(channels):
            update = projected[center, 2 * channels + c] + weighted[c] / (total[c] + _EPSILON)
            nodes[center, c] += max(update * node_scale[c] + node_shift[c], _ZERO)


@compiled(fastmath=True)
def symmetric_pass(  # type: ignore[no-untyped-def]
    projected, edge_terms, nodes, edges, pairs, node_scale, node_shift, edge_scale, edge_shift
):
    """Update the states of nodes and undirected edges in place, as `SymmetricConvolution` does in evaluation.

    Args:
        projected: float32 [N, 3C], A h + bias, U h + bias and V h + bias of every node.
        edge_terms: float32 [E, C], C e of every edge.
        nodes: float32 [N, C], states of the nodes.
        edges: float32 [E, C], states of the edges.
        pairs: int64 [2, E], both ends of each edge.
        node_scale: float32 [C]; this and the following as in `gated_pass`.
        node_shift: float32 [C].
        edge_scale: float32 [C].
        edge_shift: float32 [C].
    """
    count, channels = nodes.shape
    weighted, total = np.zeros((count, channels), np.float32), np.zeros((count, channels), np.float32)
    gates, bits = np.empty(channels, np.float32), np.empty(channels, np.int32)
    power = bits.view(np.float32)
    for edge in range(pairs.shape[1]):
        i, j = pairs[0, edge], pairs[1, edge]
        for c in range(channels):
            logit = projected[i, c] + projected[j, c] + edge_terms[edge, c]
            edges[edge, c] += max(logit * edge_scale[c] + edge_shift[c], _ZERO)
            gates[c] = logit
        _sigmoid(gates, bits, power)
        for end, other in ((i, j), (j, i)):
            for c in range(channels):
                weighted[end, c] += gates[c] * projected[other, 2 * channels + c]
                total[end, c] += gates[c]
    for node in range(count):
        for c in range(channels):
            update = projected[node, channels + c] + weighted[node, c] / (total[node, c] + _EPSILON)
            nodes[node, c] += max(update * node_scale[c] + node_shift[c], _ZERO)


@compiled(fastmath=True)
def _sigmoid(values, bits, power):  # type: ignore[no-untyped-def]
    """Replace values with their sigmoid, in loops without calls or branches, which compilers vectorise.

    exp(-value) is computed as 2 ** whole · 2 ** fraction; the first factor is written directly as the bits of a float.

    Args:
        values: float32 [C].
        bits: int32 [C], work space.
        power: float32 [C], the same memory as `bits`.
    """
    for c in range(len(values)):
        exponent = min(max(-values[c], -_LARGEST), _LARGEST) * _LOG2_E
        whole = np.floor(exponent + _HALF)
        f = exponent - whole
        values[c] = _ONE + f * (_C1 + f * (_C2 + f * (_C3 + f * (_C4 + f * (_C5 + f * _C6)))))
        bits[c] = np.int32(np.int32(whole) + _BIAS) << _MANTISSA
    for c in range(len(values)):
        values[c] = _ONE / (_ONE + values[c] * power[c])
