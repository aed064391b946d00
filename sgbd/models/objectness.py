"""Classification of superpixels as part of an object, or of the table, the floor or the walls."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from sgbd.frame import SUPPORT
from sgbd.models.neighborhood import mean_by
from sgbd.models.perceptron import Perceptron
from sgbd.models.standardize import Standardize

if TYPE_CHECKING:
    from torch_geometric.data import Data


class ObjectnessHead(nn.Module):
    """A small perceptron that gives every superpixel an object logit.

    Its input is the superpixel's own features, their mean over its neighbours and their mean over its graph, because an
    object differs from its surroundings. It shares no parameters with the edge model, so it does not change that
    model's parameter count.

    Args:
        node_channels: Columns F of `Data.x`.
        hidden_channels: Width of each hidden layer.
        dropout: Share of hidden units dropped in training.

    Raises:
        ValueError: If there are no feature columns or no hidden layers.
    """

    def __init__(self, node_channels: int, hidden_channels: Sequence[int] = (64, 32), dropout: float = 0.0) -> None:
        super().__init__()
        if node_channels < 1 or not hidden_channels:
            raise ValueError(
                "ObjectnessHead needs at least one node feature column and one hidden layer; got "
                f"node_channels={node_channels}, hidden_channels={list(hidden_channels)}. "
                "Choose objectness=none to do without it."
            )
        self.node_channels = node_channels
        self.standardize_nodes = Standardize(node_channels)
        self.mlp = Perceptron([3 * node_channels, *hidden_channels, 1], dropout=dropout)

    def forward(self, data: Data) -> Tensor:
        """Return the object logit of every superpixel.

        Args:
            data: A graph or a batch of graphs.

        Returns:
            float32 [N], object logits; the objectness is their sigmoid.

        Raises:
            ValueError: If `data.x` is not as wide as the head expects.
        """
        if data.x is None or data.x.dim() != 2 or data.x.size(1) != self.node_channels:
            given = "none" if data.x is None else f"shape {tuple(data.x.shape)}"
            raise ValueError(
                f"the objectness head was built for {self.node_channels} node feature columns; data.x has {given}. "
                "Select the same node features as in training."
            )
        x = self.standardize_nodes(data.x)
        neighbor, center = data.edge_index
        around = mean_by(center, x.index_select(0, neighbor), x.size(0))
        graph = getattr(data, "batch", None)
        if graph is None:
            whole = x.mean(0, keepdim=True).expand_as(x)
        else:
            whole = mean_by(graph, x, data.ptr.numel() - 1).index_select(0, graph)
        logits: Tensor = self.mlp(torch.cat([x, around, whole], dim=1))
        return logits.squeeze(1)


def object_targets(node_instance: Tensor) -> Tensor:
    """Return the training targets of the objectness head.

    Args:
        node_instance: int64 [N], ground-truth instance of each superpixel: -1 unknown, 0 background, 1 supporting
            surface, 2 and more objects.

    Returns:
        float32 [N]: 1 object, 0 not an object, -1 unknown (not trained on).
    """
    return torch.where(node_instance < 0, -1.0, (node_instance > SUPPORT).float())
