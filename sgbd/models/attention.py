"""Graph attention with edge features."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch_geometric.nn import TransformerConv

from sgbd.models.edge_classifier import EdgeClassifier
from sgbd.models.input_encoder import InputEncoder
from sgbd.models.perceptron import Perceptron


class EdgeTransformer(EdgeClassifier):
    """Multi-head attention over neighbours, with the edge features in keys and values.

    Layers are PyG's `TransformerConv`: Shi et al., "Masked label prediction: unified message passing model for
    semi-supervised classification", IJCAI 2021, https://doi.org/10.24963/ijcai.2021/214, eq. 3-5. They are residual,
    with layer norm before each attention. The logit is computed from the two nodes' states and the encoded edge
    features.

    Args:
        node_channels: Columns of `Data.x`.
        edge_channels: Columns of `Data.edge_attr`; with 0 columns attention has no edge bias.
        hidden_channels: Width of node states; a multiple of `heads`.
        num_layers: Number of attention layers; a pair sees neighbours up to this many edges away.
        heads: Number of attention heads.
        dropout: Share of attention weights dropped in training.

    Raises:
        ValueError: If a size is not positive or the width is not a multiple of the number of heads.
    """

    def __init__(
        self,
        node_channels: int,
        edge_channels: int = 0,
        hidden_channels: int = 72,
        num_layers: int = 4,
        heads: int = 4,
        dropout: float = 0.0,
    ) -> None:
        super().__init__(node_channels, edge_channels)
        if hidden_channels < 1 or num_layers < 1 or heads < 1 or hidden_channels % heads:
            raise ValueError(
                "EdgeTransformer needs positive sizes and hidden_channels a multiple of heads; got "
                f"hidden_channels={hidden_channels}, num_layers={num_layers}, heads={heads}"
            )
        self.hidden_channels = hidden_channels
        self.node_encoder = InputEncoder(node_channels, hidden_channels)
        self.edge_encoder = InputEncoder(edge_channels, hidden_channels)
        self.norms = nn.ModuleList(nn.LayerNorm(hidden_channels) for _ in range(num_layers))
        self.layers = nn.ModuleList(
            TransformerConv(
                hidden_channels,
                hidden_channels // heads,
                heads=heads,
                dropout=dropout,
                edge_dim=edge_channels or None,
            )
            for _ in range(num_layers)
        )
        self.readout = Perceptron([3 * hidden_channels, hidden_channels, 1], norm=False)

    def embed(self, x: Tensor, edge_index: Tensor, edge_attr: Tensor) -> tuple[Tensor, Tensor]:
        """Attend over the whole graph; see `EdgeClassifier.embed`."""
        nodes = self.node_encoder(x)
        bias = edge_attr if self.edge_channels else None
        for norm, layer in zip(self.norms, self.layers, strict=True):
            nodes = nodes + torch.relu(layer(norm(nodes), edge_index, bias))
        return nodes, self.edge_encoder(edge_attr)

    def score(self, source: Tensor, target: Tensor, edge: Tensor) -> Tensor:
        """Score directed pairs; see `EdgeClassifier.score`."""
        logits: Tensor = self.readout(torch.cat([source, target, edge], dim=1))
        return logits.squeeze(1)

    def score_pairs(self, nodes: Tensor, edges: Tensor, pairs: Tensor) -> Tensor:
        """Score directed pairs in evaluation; see `EdgeClassifier.score_pairs`."""
        return self.readout.evaluate_pairs(nodes, edges, pairs).squeeze(1)
