"""Gated graph convolution whose edges have a state of their own."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.functional import linear

from sgbd.models.edge_classifier import EdgeClassifier
from sgbd.models.gated_pass import gated_pass
from sgbd.models.in_evaluation import can_be_compiled, scale_and_shift
from sgbd.models.input_encoder import InputEncoder
from sgbd.models.neighbourhood import sum_by
from sgbd.models.perceptron import Perceptron


class GatedConvolution(nn.Module):
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
        super().__init__()
        # A, B, U and V act on the same rows: one matrix product instead of four.
        self.node_linear = nn.Linear(channels, 4 * channels)
        self.edge_linear = nn.Linear(channels, channels, bias=False)
        self.node_norm = nn.BatchNorm1d(channels)
        self.edge_norm = nn.BatchNorm1d(channels)
        self.dropout = nn.Dropout(dropout)

    def forward(self, nodes: Tensor, edges: Tensor, edge_index: Tensor) -> tuple[Tensor, Tensor]:
        """Update the states once.

        Args:
            nodes: float32 [N, C].
            edges: float32 [2E, C].
            edge_index: int64 [2, 2E]; messages flow from row 0 to row 1.

        Returns:
            New node states [N, C] and edge states [2E, C].
        """
        neighbour, centre = edge_index
        # index_select, because the gradient of plain indexing takes twice as long on a CPU.
        at_centre, at_neighbour, own, message = self.node_linear(nodes).chunk(4, dim=1)
        gate_logits = (
            at_centre.index_select(0, centre) + at_neighbour.index_select(0, neighbour) + self.edge_linear(edges)
        )
        gates = torch.sigmoid(gate_logits)
        gathered = sum_by(centre, torch.cat([gates * message.index_select(0, neighbour), gates], dim=1), nodes.size(0))
        weighted, total = gathered.chunk(2, dim=1)
        node_update = self.node_norm(own + weighted / (total + 1e-6))
        nodes = nodes + self.dropout(torch.relu(node_update))
        if edges.size(0) > 0:
            edges = edges + self.dropout(torch.relu(self.edge_norm(gate_logits)))
        return nodes, edges

    def update_in_place(self, nodes: Tensor, edges: Tensor, first: Tensor, neighbours: Tensor) -> None:
        """Update the states once, as `forward` does in evaluation; see `sgbd.models.gated_pass.gated_pass`."""
        terms = [
            linear(nodes, self.node_linear.weight, self.node_linear.bias),
            linear(edges, self.edge_linear.weight),
            nodes,
            edges,
            first,
            neighbours,
            *scale_and_shift(self.node_norm),
            *scale_and_shift(self.edge_norm),
        ]
        gated_pass(*(tensor.detach().numpy() for tensor in terms))


class GatedGCN(EdgeClassifier):
    """Gated graph convolutions; the logit is read from the two nodes' states and the state of their edge.

    About 100,000 parameters as configured by default, to be compared with `SharedMLP` at equal size.

    Args:
        node_channels: Columns of `Data.x`.
        edge_channels: Columns of `Data.edge_attr`. With 0 columns all edges start from one learned state.
        hidden_channels: Width of node and edge states.
        num_layers: Number of convolutions, the radius of what a pair sees.
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
        super().__init__(node_channels, edge_channels)
        if hidden_channels < 1 or num_layers < 1:
            raise ValueError(
                "GatedGCN needs hidden_channels >= 1 and num_layers >= 1; got "
                f"hidden_channels={hidden_channels}, num_layers={num_layers}"
            )
        self.hidden_channels = hidden_channels
        self.node_encoder = InputEncoder(node_channels, hidden_channels)
        self.edge_encoder = InputEncoder(edge_channels, hidden_channels)
        self.layers = nn.ModuleList(GatedConvolution(hidden_channels, dropout) for _ in range(num_layers))
        self.readout = Perceptron([3 * hidden_channels, hidden_channels, 1], norm=False)

    @property
    def state_channels(self) -> tuple[int, int]:
        """Width of the node states and of the edge states."""
        return self.hidden_channels, self.hidden_channels

    def embed(self, x: Tensor, edge_index: Tensor, edge_attr: Tensor) -> tuple[Tensor, Tensor]:
        """Pass messages over the whole graph; see `EdgeClassifier.embed`."""
        if can_be_compiled(self, x):
            return self._embed_compiled(x, edge_index, edge_attr)
        nodes, edges = self.node_encoder(x), self.edge_encoder(edge_attr)
        for layer in self.layers:
            nodes, edges = layer(nodes, edges, edge_index)
        return nodes, edges

    def _embed_compiled(self, x: Tensor, edge_index: Tensor, edge_attr: Tensor) -> tuple[Tensor, Tensor]:
        """Do in evaluation what `embed` does, with the edges in the order of the nodes that they lead to."""
        neighbour, centre = edge_index
        order = torch.argsort(centre, stable=True)
        first = torch.zeros(x.size(0) + 1, dtype=torch.int64)
        torch.cumsum(torch.bincount(centre, minlength=x.size(0)), 0, out=first[1:])
        nodes, edges = self.node_encoder(x), self.edge_encoder(edge_attr.index_select(0, order))
        if self.node_encoder.linear is None:
            nodes = nodes.clone(memory_format=torch.contiguous_format)  # a view of a parameter, which must not change
        if self.edge_encoder.linear is None:
            edges = edges.clone(memory_format=torch.contiguous_format)
        neighbours = neighbour.index_select(0, order)
        for layer in self.layers:
            assert isinstance(layer, GatedConvolution)
            layer.update_in_place(nodes, edges, first, neighbours)
        return nodes, torch.empty_like(edges).index_copy_(0, order, edges)

    def score(self, source: Tensor, target: Tensor, edge: Tensor) -> Tensor:
        """Score directed pairs; see `EdgeClassifier.score`."""
        logits: Tensor = self.readout(torch.cat([source, target, edge], dim=1))
        return logits.squeeze(1)

    def score_pairs(self, nodes: Tensor, edges: Tensor, pairs: Tensor) -> Tensor:
        """Score directed pairs in evaluation; see `EdgeClassifier.score_pairs`."""
        return self.readout.evaluate_pairs(nodes, edges, pairs).squeeze(1)
