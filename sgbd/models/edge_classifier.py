"""The interface of all models that decide which neighbouring superpixels to merge."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

import torch
from torch import Tensor, nn

from sgbd.graph import edge_positions
from sgbd.models.standardize import Standardize

if TYPE_CHECKING:
    from torch_geometric.data import Data


class EdgeClassifier(nn.Module, ABC):
    r"""A network that gives every requested pair of superpixels a merge logit.

    The work is divided in two, so that a model implements only what is specific to it:

    * `embed` turns the features of the whole graph into node and edge states. Message passing happens here, and it
      always sees the whole graph, whatever pairs are requested. The default returns the standardised features.
    * `score` turns the states at the two ends of a directed pair, and of the edge between them, into a logit.

    Merging has no direction, but `score` may have one. In training, a pair is scored in its given direction (the
    sampler swaps the ends of a random half of the pairs). In evaluation, the logit is :math:`\tfrac12(s_{ij} +
    s_{ji})`, which is bit-identical when the two ends change places.

    Your own class needs to define only `score`, and is chosen with `model._target_=your_package.YourModel`. Its
    constructor receives `node_channels` and `edge_channels` besides the arguments in the configuration.

    Args:
        node_channels: Columns F of `Data.x`.
        edge_channels: Columns D of `Data.edge_attr`; may be 0.

    Raises:
        ValueError: If a number of columns is negative, or both are 0.
    """

    def __init__(self, node_channels: int, edge_channels: int = 0) -> None:
        super().__init__()
        if node_channels < 0 or edge_channels < 0 or node_channels + edge_channels == 0:
            raise ValueError(
                "a model needs at least one feature column; got "
                f"node_channels={node_channels}, edge_channels={edge_channels}"
            )
        self.node_channels = node_channels
        self.edge_channels = edge_channels
        self.standardize_nodes = Standardize(node_channels)
        self.standardize_edges = Standardize(edge_channels)

    def embed(self, x: Tensor, edge_index: Tensor, edge_attr: Tensor) -> tuple[Tensor, Tensor]:
        """Turn features into states.

        Args:
            x: float32 [N, F], standardised.
            edge_index: int64 [2, 2E], every adjacency in both directions.
            edge_attr: float32 [2E, D], standardised; row k belongs to the directed edge k.

        Returns:
            Node states [N, H] and edge states [2E, C], for `score`; the widths are the model's own.
        """
        return x, edge_attr

    @abstractmethod
    def score(self, source: Tensor, target: Tensor, edge: Tensor) -> Tensor:
        """Score directed pairs.

        Args:
            source: float32 [P, H], states of the start nodes of the pairs.
            target: float32 [P, H], states of their end nodes.
            edge: float32 [P, C], states of the directed edges between them.

        Returns:
            float32 [P], merge logits.
        """

    def score_pairs(self, nodes: Tensor, edges: Tensor, pairs: Tensor) -> Tensor:
        """Score directed pairs in evaluation; a model may override it with a faster way to the same result.

        Args:
            nodes: float32 [N, H], states of all nodes.
            edges: float32 [P, C], states of the directed edges of the pairs.
            pairs: int64 [2, P].

        Returns:
            float32 [P], the merge logits that `score` returns.
        """
        return self.score(nodes.index_select(0, pairs[0]), nodes.index_select(0, pairs[1]), edges)

    def forward(self, data: Data) -> Tensor:
        """Return the merge logit of every pair in `data.edge_label_index`.

        Args:
            data: A graph or a batch of graphs. `edge_label_index` int64 [2, P] may contain any of the graph's
                adjacencies, in any order and direction, with repetitions.

        Returns:
            float32 [P], merge logits; the merge probability is their sigmoid.

        Raises:
            ValueError: If the features are not as wide as the model expects, or a pair is not an edge of the graph.
        """
        self._check_width("x", data.x, self.node_channels, "node")
        self._check_width("edge_attr", data.edge_attr, self.edge_channels, "edge")
        pairs = data.edge_label_index
        nodes, edges = self.embed(
            self.standardize_nodes(data.x), data.edge_index, self.standardize_edges(data.edge_attr)
        )
        if self.training:
            states = self._edge_states(edges, data.edge_index, pairs, nodes.size(0))
            return self.score(nodes.index_select(0, pairs[0]), nodes.index_select(0, pairs[1]), states)
        # A fixed order of the two ends makes the result bit-identical for both directions of a pair: matrix products
        # may round a row differently at another position in the matrix.
        forth = torch.stack([torch.minimum(*pairs), torch.maximum(*pairs)])
        both = torch.cat([forth, forth.flip(0)], dim=1)
        return self._mean_of_directions(nodes, self._edge_states(edges, data.edge_index, both, nodes.size(0)), both)

    def pair_logits(self, x: Tensor, pairs: Tensor, edge_attr: Tensor) -> Tensor:
        """Return the merge logits of a whole graph in the layout of `sgbd.graph.build_graph`, as in evaluation.

        It looks up and checks nothing, so that the operations can be traced for graphs of any size. A class that
        overrides `forward` must override this method too.

        Args:
            x: float32 [N, F], as `Data.x`.
            pairs: int64 [2, E], every adjacency once, i < j.
            edge_attr: float32 [2E, D], edge features of the pairs, then of the same pairs reversed.

        Returns:
            float32 [E], merge logits.
        """
        both = torch.cat([pairs, pairs.flip(0)], dim=1)
        nodes, edges = self.embed(self.standardize_nodes(x), both, self.standardize_edges(edge_attr))
        return self._mean_of_directions(nodes, edges, both)

    def _mean_of_directions(self, nodes: Tensor, edges: Tensor, both: Tensor) -> Tensor:
        """Return the mean logit of pairs int64 [2, 2P] whose second half is the first half reversed."""
        forth, back = self.score_pairs(nodes, edges, both).view(2, -1)
        return (forth + back) / 2

    @staticmethod
    def _edge_states(edges: Tensor, edge_index: Tensor, pairs: Tensor, num_nodes: int) -> Tensor:
        """Return the states of the edges of directed pairs, looked up in `edge_index`."""
        if edges.size(1) == 0:
            return edges.new_empty(pairs.size(1), 0)
        if pairs.shape == edge_index.shape and torch.equal(pairs, edge_index):
            return edges  # all pairs of a graph from `sgbd.graph.build_graph`, in its order
        return edges.index_select(0, edge_positions(edge_index, pairs, num_nodes))

    @staticmethod
    def _check_width(field: str, rows: Tensor | None, expected: int, group: str) -> None:
        given = "none" if rows is None else f"shape {tuple(rows.shape)}"
        if rows is None or rows.dim() != 2 or rows.size(1) != expected:
            raise ValueError(
                f"the model was built for {expected} {group} feature columns; data.{field} has {given}. "
                f"Select the same {group} features as in training (a checkpoint lists them in its recipe)."
            )
