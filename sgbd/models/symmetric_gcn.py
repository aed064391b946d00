"""Gated graph convolution on undirected edges: symmetric by construction, at half the cost of the directed one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from sgbd.graph import edge_positions
from sgbd.models.gated_network import GatedLayer, GatedNetwork
from sgbd.models.gated_pass import symmetric_pass
from sgbd.models.in_evaluation import can_be_compiled
from sgbd.models.perceptron import normalized_rows

if TYPE_CHECKING:
    from torch_geometric.data import Data


class SymmetricConvolution(GatedLayer):
    r"""One layer of the gated graph convolution, with one state for the two directions of an edge.

    .. math::
        e_{ij} &\leftarrow e_{ij} + \mathrm{ReLU}(\mathrm{BN}(\hat e_{ij})), \quad
        \hat e_{ij} = A (h_i + h_j) + C e_{ij} \\
        h_i &\leftarrow h_i + \mathrm{ReLU}\Big(\mathrm{BN}\Big(U h_i +
        \frac{\sum_j \sigma(\hat e_{ij}) \odot V h_j}{\sum_j \sigma(\hat e_{ij}) + \epsilon}\Big)\Big)

    This is `GatedConvolution` with :math:`A = B`, so that :math:`e_{ij} = e_{ji}` in every layer.

    Args:
        channels: Width of node and edge states.
        dropout: Share of units dropped from each update in training.
    """

    def __init__(self, channels: int, dropout: float = 0.0) -> None:
        super().__init__(channels, node_maps=3, dropout=dropout)  # A, U and V

    def forward(self, nodes: Tensor, edges: Tensor, pairs: Tensor) -> tuple[Tensor, Tensor]:
        """Update the states once.

        Args:
            nodes: float32 [N, C].
            edges: float32 [E, C].
            pairs: int64 [2, E], each edge once.

        Returns:
            New node states [N, C] and edge states [E, C].
        """
        if edges.size(0) == 0:
            own = self.node_linear(nodes).chunk(3, dim=1)[1]
            return nodes + self.dropout(torch.relu(self.node_norm(own))), edges
        i, j = pairs
        at_end, own, message = self.node_linear(nodes).chunk(3, dim=1)
        # index_select: the gradient of plain indexing takes twice as long on a CPU.
        gate_logits = at_end.index_select(0, i) + at_end.index_select(0, j) + self.edge_linear(edges)
        gates = torch.sigmoid(gate_logits)
        zeros = torch.zeros_like(own)
        weighted = zeros.index_add(0, i, gates * message.index_select(0, j)).index_add(
            0, j, gates * message.index_select(0, i)
        )
        total = zeros.index_add(0, i, gates).index_add(0, j, gates)
        nodes = nodes + self.dropout(torch.relu(self.node_norm(own + weighted / (total + 1e-6))))
        # Two segments of a first stage may be a whole batch, with a single edge.
        edges = edges + self.dropout(torch.relu(normalized_rows(self.edge_norm, gate_logits)))
        return nodes, edges

    @property
    def compiled_pass(self) -> Callable[..., None]:
        """The compiled loop `symmetric_pass`."""
        return symmetric_pass


class SymmetricGCN(GatedNetwork):
    """Gated graph convolutions on undirected edges; the logit does not depend on the order of a pair's ends.

    Edge features that differ between the two directions (such as the distance of one end to the other's plane) enter as
    their mean and half their absolute difference.

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
            edge_inputs=2 * edge_channels,
            hidden_channels=hidden_channels,
            num_layers=num_layers,
            layer=lambda: SymmetricConvolution(hidden_channels, dropout),
        )
        self.readout = nn.Sequential(
            nn.Linear(3 * hidden_channels, hidden_channels), nn.ReLU(), nn.Linear(hidden_channels, 1)
        )

    def forward(self, data: Data) -> Tensor:
        """Return the merge logit of every pair in `data.edge_label_index`; see `EdgeClassifier.forward`."""
        self._check_width("x", data.x, self.node_channels, "node")
        self._check_width("edge_attr", data.edge_attr, self.edge_channels, "edge")
        pairs, attributes = undirected(data.edge_index, self.standardize_edges(data.edge_attr), data.x.size(0))
        x, pairs = self.standardize_nodes(data.x), pairs.contiguous()
        run = self.pass_messages_compiled if can_be_compiled(self, data.x) else self.pass_messages
        nodes, edges = run(x, attributes, pairs)
        asked = data.edge_label_index
        if asked.shape != pairs.shape or not torch.equal(asked, pairs):
            ordered = torch.stack([torch.minimum(*asked), torch.maximum(*asked)])
            edges = edges.index_select(0, edge_positions(pairs, ordered, nodes.size(0)))
        return self.score(nodes.index_select(0, asked[0]), nodes.index_select(0, asked[1]), edges)

    def pair_logits(self, x: Tensor, pairs: Tensor, edge_attr: Tensor) -> Tensor:
        """Return the merge logits of a whole graph; see `EdgeClassifier.pair_logits`."""
        attributes, count = self.standardize_edges(edge_attr), pairs.size(1)
        attributes = mean_and_difference(attributes[:count], attributes[count:])
        nodes, edges = self.pass_messages(self.standardize_nodes(x), attributes, pairs)
        return self.score(nodes.index_select(0, pairs[0]), nodes.index_select(0, pairs[1]), edges)

    def score(self, source: Tensor, target: Tensor, edge: Tensor) -> Tensor:
        """Score pairs, independent of their direction; see `EdgeClassifier.score`."""
        logits: Tensor = self.readout(torch.cat([source + target, (source - target).abs(), edge], dim=1))
        return logits.squeeze(1)


def undirected(edge_index: Tensor, edge_attr: Tensor, num_nodes: int) -> tuple[Tensor, Tensor]:
    """Combine the two directions of each edge into one undirected edge.

    Args:
        edge_index: int64 [2, 2E], every adjacency in both directions, without loops.
        edge_attr: float32 [2E, D].
        num_nodes: Number of nodes.

    Returns:
        Pairs int64 [2, E], i < j, in the order of their edges i to j, and their attributes float32 [E, 2 D] from
        `mean_and_difference`.

    Raises:
        ValueError: If the opposite of an edge is missing.
    """
    ahead = edge_index[0] < edge_index[1]
    forth, back = ahead.nonzero().squeeze(1), (~ahead).nonzero().squeeze(1)
    pairs, opposite = edge_index.index_select(1, forth), edge_index.index_select(1, back).flip(0)
    if pairs.shape != opposite.shape or not torch.equal(pairs, opposite):
        keys, opposite_keys = (ends[0] * num_nodes + ends[1] for ends in (pairs, opposite))
        alone = torch.cat([forth[~torch.isin(keys, opposite_keys)], back[~torch.isin(opposite_keys, keys)]])
        if alone.numel():
            edge = tuple(edge_index[:, alone[0]].tolist())
            raise ValueError(f"every edge needs its opposite in edge_index; the edge {edge} has none")
        back = back.index_select(0, edge_positions(opposite, pairs, num_nodes))
    return pairs, mean_and_difference(edge_attr.index_select(0, forth), edge_attr.index_select(0, back))


def mean_and_difference(forth: Tensor, back: Tensor) -> Tensor:
    """Combine the attributes of the two directions of an edge.

    Args:
        forth: float32 [E, D], from i to j.
        back: float32 [E, D], from j to i.

    Returns:
        float32 [E, 2 D], their mean and half their absolute difference.
    """
    return torch.cat([(forth + back) / 2, (forth - back).abs() / 2], dim=1)
