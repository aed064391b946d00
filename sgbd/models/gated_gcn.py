"""Gated graph convolution with a state for every edge."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from sgbd.models.gated_messages import gated_messages, has_messages_compiled
from sgbd.models.gated_network import GatedLayer, GatedNetwork
from sgbd.models.gated_pass import gated_pass
from sgbd.models.in_evaluation import can_be_compiled
from sgbd.models.neighborhood import sum_by
from sgbd.models.perceptron import Perceptron


class GatedConvolution(GatedLayer):
    r"""One layer of the residual gated graph convolution.

    .. math::
        e_{ij} &\leftarrow e_{ij} + \mathrm{ReLU}(\mathrm{BN}(\hat e_{ij})), \quad
        \hat e_{ij} = A h_i + B h_j + C e_{ij} \\
        h_i &\leftarrow h_i + \mathrm{ReLU}\Big(\mathrm{BN}\Big(U h_i +
        \frac{\sum_j \sigma(\hat e_{ij}) \odot V h_j}{\sum_j \sigma(\hat e_{ij}) + \epsilon}\Big)\Big)

    Bresson and Laurent, "Residual gated graph ConvNets", https://arxiv.org/abs/1711.07553, eq. 11, with the
    normalised gates and the edge state of Dwivedi et al., "Benchmarking graph neural networks", JMLR 24(43), 2023,
    https://arxiv.org/abs/2003.00982.

    Args:
        channels: Width of node and edge states.
        dropout: Share of units dropped from each update in training.
    """

    def __init__(self, channels: int, dropout: float = 0.0) -> None:
        super().__init__(channels, node_maps=4, dropout=dropout)  # A, B, U and V

    def forward(self, nodes: Tensor, edges: Tensor, edge_index: Tensor) -> tuple[Tensor, Tensor]:
        """Update the states once.

        Args:
            nodes: float32 [N, C].
            edges: float32 [2E, C].
            edge_index: int64 [2, 2E]; messages flow from row 0 to row 1.

        Returns:
            New node states [N, C] and edge states [2E, C].
        """
        neighbor, center = edge_index
        projected, edge_terms = self.node_linear(nodes), self.edge_linear(edges)
        if has_messages_compiled(projected, edge_terms):
            gate_logits, own, weighted, total = gated_messages(projected, edge_terms, neighbor, center)
        else:
            at_center, at_neighbor, own, message = projected.chunk(4, dim=1)
            # index_select: the gradient of plain indexing takes twice as long on a CPU.
            gate_logits = at_center.index_select(0, center) + at_neighbor.index_select(0, neighbor) + edge_terms
            gates = torch.sigmoid(gate_logits)
            gathered = sum_by(
                center, torch.cat([gates * message.index_select(0, neighbor), gates], dim=1), nodes.size(0)
            )
            weighted, total = gathered.chunk(2, dim=1)
        node_update = self.node_norm(own + weighted / (total + 1e-6))
        nodes = nodes + self.dropout(torch.relu(node_update))
        if edges.size(0) > 0:
            edges = edges + self.dropout(torch.relu(self.edge_norm(gate_logits)))
        return nodes, edges

    @property
    def compiled_pass(self) -> Callable[..., None]:
        """The compiled loop `gated_pass`."""
        return gated_pass


class GatedGCN(GatedNetwork):
    """Gated graph convolutions; the logit is computed from the two nodes' states and the state of their edge.

    With the default configuration it has about 100,000 parameters, for comparison with `SharedMLP` at equal size.

    Args:
        node_channels: Columns of `Data.x`.
        edge_channels: Columns of `Data.edge_attr`. With 0 columns all edges start from one learned state.
        hidden_channels: Width of node and edge states.
        num_layers: Number of convolutions; a pair sees neighbours up to this many edges away.
        dropout: Share of units dropped from each update in training.

    Raises:
        ValueError: If the width or the number of layers is not positive.
    """

    def __init__(
        self,
        node_channels: int,
        edge_channels: int = 0,
        hidden_channels: int = 64,
        num_layers: int = 4,
        dropout: float = 0.0,
    ) -> None:
        super().__init__(
            node_channels,
            edge_channels,
            edge_inputs=edge_channels,
            hidden_channels=hidden_channels,
            num_layers=num_layers,
            layer=lambda: GatedConvolution(hidden_channels, dropout),
        )
        self.readout = Perceptron([3 * hidden_channels, hidden_channels, 1], norm=False)

    def embed(self, x: Tensor, edge_index: Tensor, edge_attr: Tensor) -> tuple[Tensor, Tensor]:
        """Pass messages over the whole graph; see `EdgeClassifier.embed`."""
        if not can_be_compiled(self, x):
            return self.pass_messages(x, edge_attr, edge_index)
        # The compiled loop needs the edges sorted by the node where they end.
        neighbor, center = edge_index
        order = torch.argsort(center, stable=True)
        first = center.new_zeros(x.size(0) + 1)
        torch.cumsum(torch.bincount(center, minlength=x.size(0)), 0, out=first[1:])
        nodes, edges = self.pass_messages_compiled(
            x, edge_attr.index_select(0, order), first, neighbor.index_select(0, order)
        )
        return nodes, torch.empty_like(edges).index_copy_(0, order, edges)

    def score(self, source: Tensor, target: Tensor, edge: Tensor) -> Tensor:
        """Score directed pairs; see `EdgeClassifier.score`."""
        logits: Tensor = self.readout(torch.cat([source, target, edge], dim=1))
        return logits.squeeze(1)

    def score_pairs(self, nodes: Tensor, edges: Tensor, pairs: Tensor) -> Tensor:
        """Score directed pairs in evaluation; see `EdgeClassifier.score_pairs`."""
        return self.readout.evaluate_pairs(nodes, edges, pairs).squeeze(1)
