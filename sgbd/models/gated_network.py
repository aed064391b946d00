"""Base classes of the gated graph convolutions, directed and symmetric."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

from torch import Tensor, nn
from torch.nn.functional import linear

from sgbd.models.edge_classifier import EdgeClassifier
from sgbd.models.in_evaluation import scale_and_shift
from sgbd.models.input_encoder import InputEncoder


class GatedLayer(nn.Module):
    """The weights of one gated graph convolution, with a fast update for evaluation.

    A subclass defines `forward`, and names the compiled loop over the edges that gives the same result.

    Args:
        channels: Width of node and edge states.
        node_maps: Number of linear maps of a node's state.
        dropout: Share of units dropped from each update in training.
    """

    def __init__(self, channels: int, node_maps: int, dropout: float = 0.0) -> None:
        super().__init__()
        # All node maps act on the same rows, so they share one matrix product.
        self.node_linear = nn.Linear(channels, node_maps * channels)
        self.edge_linear = nn.Linear(channels, channels, bias=False)
        self.node_norm = nn.BatchNorm1d(channels)
        self.edge_norm = nn.BatchNorm1d(channels)
        self.dropout = nn.Dropout(dropout)

    @property
    @abstractmethod
    def compiled_pass(self) -> Callable[..., None]:
        """The loop of `sgbd.models.gated_pass` that updates the states in place."""

    def update_in_place(self, nodes: Tensor, edges: Tensor, *ends: Tensor) -> None:
        """Update the states once, as `forward` does in evaluation.

        Args:
            nodes: float32 [N, C], changed.
            edges: float32 [number of edges, C], changed.
            *ends: int64, the ends of the edges, in the form that `compiled_pass` takes.
        """
        terms = [
            linear(nodes, self.node_linear.weight, self.node_linear.bias),
            linear(edges, self.edge_linear.weight),
            nodes,
            edges,
            *ends,
            *scale_and_shift(self.node_norm),
            *scale_and_shift(self.edge_norm),
        ]
        self.compiled_pass(*(tensor.detach().numpy() for tensor in terms))


class GatedNetwork(EdgeClassifier):
    """Encoders of node and edge features, followed by gated convolutions on the encoded states.

    Args:
        node_channels: Columns of `Data.x`.
        edge_channels: Columns of `Data.edge_attr`.
        edge_inputs: Input columns of the edge encoder.
        hidden_channels: Width of node and edge states.
        num_layers: Number of convolutions.
        layer: Creates a convolution.

    Raises:
        ValueError: If the width or the number of layers is not positive.
    """

    def __init__(
        self,
        node_channels: int,
        edge_channels: int,
        edge_inputs: int,
        hidden_channels: int,
        num_layers: int,
        layer: Callable[[], GatedLayer],
    ) -> None:
        super().__init__(node_channels, edge_channels)
        if hidden_channels < 1 or num_layers < 1:
            raise ValueError(
                f"{type(self).__name__} needs hidden_channels >= 1 and num_layers >= 1; got "
                f"hidden_channels={hidden_channels}, num_layers={num_layers}"
            )
        self.hidden_channels = hidden_channels
        self.node_encoder = InputEncoder(node_channels, hidden_channels)
        self.edge_encoder = InputEncoder(edge_inputs, hidden_channels)
        self.layers = nn.ModuleList(layer() for _ in range(num_layers))

    def pass_messages(self, x: Tensor, edge_attr: Tensor, edge_index: Tensor) -> tuple[Tensor, Tensor]:
        """Encode features and run all layers with PyTorch's operations.

        Args:
            x: float32 [N, F], standardised.
            edge_attr: float32 [number of edges, edge_inputs], standardised.
            edge_index: int64 [2, number of edges], in the form that the layers take.

        Returns:
            Node states [N, C] and edge states [number of edges, C].
        """
        nodes, edges = self.node_encoder(x), self.edge_encoder(edge_attr)
        for layer in self.layers:
            nodes, edges = layer(nodes, edges, edge_index)
        return nodes, edges

    def pass_messages_compiled(self, x: Tensor, edge_attr: Tensor, *ends: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the result of `pass_messages` in evaluation, in compiled loops.

        Args:
            x: float32 [N, F], standardised.
            edge_attr: float32 [number of edges, edge_inputs], standardised.
            *ends: The ends of the edges, as in `GatedLayer.update_in_place`.

        Returns:
            As `pass_messages`.
        """
        nodes, edges = self.node_encoder.in_own_memory(x), self.edge_encoder.in_own_memory(edge_attr)
        for layer in self.layers:
            assert isinstance(layer, GatedLayer)
            layer.update_in_place(nodes, edges, *ends)
        return nodes, edges
