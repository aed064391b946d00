"""Several networks of one architecture as a single wider network that gives the mean of their logits.

Trainings that differ only in their seed make different mistakes, and the mean of their logits makes fewer. The members
stand side by side in the channels of the wide network: its weights hold theirs as blocks, with zeros between members.
So it takes hardly more time than one small network.

Some layers have channels of several kinds, such as the states of the source, of the target and of the edge. The wide
network keeps this order: first the states of the source of all members, then those of the target, and so on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

import torch
from torch import Tensor, nn

from sgbd.models.edge_classifier import EdgeClassifier
from sgbd.models.gated_gcn import GatedGCN
from sgbd.models.objectness import ObjectnessHead

Join = Callable[[Sequence[Tensor]], Tensor]
"""Joins a tensor of all members to that of the wide network."""

Network = TypeVar("Network", bound=nn.Module)


def average_models(models: Sequence[EdgeClassifier]) -> GatedGCN:
    """Return a network whose merge logits in evaluation are the mean of those of several networks.

    Args:
        models: Gated graph convolutions of equal size, trained on the same graphs.

    Returns:
        A network with the channels of all of them, in evaluation mode.

    Raises:
        ValueError: If there are none, or they are not alike.
    """
    gated = [model for model in models if type(model) is GatedGCN]
    if not gated or len(gated) < len(models):
        raise ValueError(f"only GatedGCN can be averaged; got {[type(model).__name__ for model in models]}")
    first, layers = gated[0], len(gated[0].layers)
    wide = GatedGCN(first.node_channels, first.edge_channels, len(gated) * first.hidden_channels, layers)
    rules: dict[str, Join] = {
        "standardize_nodes": _same,
        "standardize_edges": _same,
        "node_encoder": _beside,
        "edge_encoder": _beside,
        "readout.lins.0.weight": partial(_blocks, inputs=3),  # source, target and edge
        "readout.lins.0.bias": _beside,
        "readout.lins.1": _mean,
    }
    for layer in range(layers):
        rules |= {
            f"layers.{layer}.node_linear.weight": partial(_blocks, outputs=4),  # A, B, U and V
            f"layers.{layer}.node_linear.bias": partial(_beside, kinds=4),
            f"layers.{layer}.edge_linear": _blocks,
            f"layers.{layer}.node_norm": _beside,
            f"layers.{layer}.edge_norm": _beside,
        }
    return _filled(wide, gated, rules)


def average_heads(heads: Sequence[ObjectnessHead]) -> ObjectnessHead:
    """Return a head whose object logits in evaluation are the mean of those of several heads; see `average_models`."""
    if not heads or any(type(head) is not ObjectnessHead for head in heads):
        raise ValueError(f"only ObjectnessHead can be averaged; got {[type(head).__name__ for head in heads]}")
    hidden = [layer.out_features for layer in heads[0].mlp.lins if isinstance(layer, nn.Linear)][:-1]
    wide = ObjectnessHead(heads[0].node_channels, [len(heads) * width for width in hidden])
    rules: dict[str, Join] = {"standardize_nodes": _same, "mlp.norms": _beside, f"mlp.lins.{len(hidden)}": _mean}
    for layer in range(len(hidden)):
        # All members see the same input.
        rules |= {f"mlp.lins.{layer}.weight": _blocks if layer else _beside, f"mlp.lins.{layer}.bias": _beside}
    return _filled(wide, heads, rules)


def _filled(wide: Network, members: Sequence[nn.Module], rules: Mapping[str, Join]) -> Network:
    """Fill a wide network with the tensors of its members.

    Args:
        wide: The network.
        members: The members.
        rules: How to join the tensors whose names start with each key.

    Returns:
        The network, in evaluation mode.
    """
    states = [member.state_dict() for member in members]
    shapes = [{name: value.shape for name, value in state.items()} for state in states]
    if any(other != shapes[0] for other in shapes[1:]):
        raise ValueError("networks can only be averaged if they have the same layers and the same features")
    joined = {}
    for name in states[0]:
        join = (
            _first
            if name.endswith("num_batches_tracked")
            else next(rule for start, rule in rules.items() if name.startswith(start))
        )
        joined[name] = join([state[name] for state in states])
    wide.load_state_dict(joined)
    return wide.eval()


def _first(pieces: Sequence[Tensor]) -> Tensor:
    return pieces[0]


def _same(pieces: Sequence[Tensor]) -> Tensor:
    if any(not torch.equal(piece, pieces[0]) for piece in pieces[1:]):
        raise ValueError("networks can only be averaged if they were trained on the same graphs")
    return pieces[0]


def _beside(pieces: Sequence[Tensor], kinds: int = 1) -> Tensor:
    """Join vectors [channels], or matrices [channels, inputs] with the same input, whose channels are of some kinds."""
    by_kind = torch.stack([piece.unflatten(0, (kinds, -1)) for piece in pieces], dim=1)
    return by_kind.flatten(0, 2)


def _blocks(pieces: Sequence[Tensor], outputs: int = 1, inputs: int = 1) -> Tensor:
    """Join matrices [channels, inputs] as blocks, given the number of kinds of channels of output and input."""
    matrices = [piece.unflatten(1, (inputs, -1)).unflatten(0, (outputs, -1)) for piece in pieces]
    high, wide = matrices[0].size(1), matrices[0].size(3)
    blocks = matrices[0].new_zeros(outputs, len(pieces), high, inputs, len(pieces), wide)
    for member, matrix in enumerate(matrices):
        blocks[:, member, :, :, member] = matrix
    return blocks.flatten(3, 5).flatten(0, 2)


def _mean(pieces: Sequence[Tensor]) -> Tensor:
    """Join weights [1, inputs] or biases [1] of layers whose outputs are averaged."""
    if pieces[0].dim() == 1:
        return torch.stack([*pieces]).mean(0)
    return torch.cat([*pieces], dim=1) / len(pieces)
