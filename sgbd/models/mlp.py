"""The shared multilayer perceptron: classify every pair of superpixels separately."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from sgbd.models.edge_classifier import EdgeClassifier
from sgbd.models.perceptron import Perceptron


class SharedMLP(EdgeClassifier):
    """One perceptron, shared by all pairs, on the features of the two ends and of the edge between them.

    It computes only the requested pairs. The model of Örnek et al., "SupeRGB-D: Zero-shot instance segmentation in
    cluttered indoor environments", IEEE RA-L 8(6), 2023, https://doi.org/10.1109/LRA.2023.3271527. Three variants are
    shipped as configurations:

    ================== ============= ========== ====== ==========================================================
    `model=`           hidden layers last layer bias   description
    ================== ============= ========== ====== ==========================================================
    `mlp`              128-256-256   plain      yes    the default: logits of either sign
    `mlp_reference`    128-256-256   norm, ReLU no     as trained by the authors; 103,682 parameters on 30 inputs.
                                                       Its logits are never negative: merge if above 0
    `mlp_paper_text`   256-1024-256  plain      yes    the widths given in the paper's text
    ================== ============= ========== ====== ==========================================================

    Args:
        node_channels: Columns of `Data.x`.
        edge_channels: Columns of `Data.edge_attr`; may be 0.
        hidden_channels: Width of each hidden layer.
        plain_last: Whether the last layer is linear only. Otherwise batch norm and ReLU follow it, as after all others.
        bias: Whether the linear layers have a bias.
        dropout: Share of hidden units dropped in training.

    Raises:
        ValueError: If there is no hidden layer.
    """

    def __init__(
        self,
        node_channels: int,
        edge_channels: int = 0,
        hidden_channels: Sequence[int] = (128, 256, 256),
        plain_last: bool = True,
        bias: bool = True,
        dropout: float = 0.0,
    ) -> None:
        super().__init__(node_channels, edge_channels)
        if not hidden_channels:
            raise ValueError("SharedMLP needs at least one hidden layer, for example hidden_channels=[128, 256, 256]")
        self.mlp = Perceptron(
            [2 * node_channels + edge_channels, *hidden_channels, 1],
            plain_last=plain_last,
            bias=bias,
            dropout=dropout,
        )

    def score(self, source: Tensor, target: Tensor, edge: Tensor) -> Tensor:
        """Score directed pairs; see `EdgeClassifier.score`."""
        rows = torch.cat([source, target, edge], dim=1)
        logits: Tensor = self.mlp(rows) if self.training else self.mlp.evaluate(rows)
        return logits.squeeze(1)

    def score_pairs(self, nodes: Tensor, edges: Tensor, pairs: Tensor) -> Tensor:
        """Score directed pairs in evaluation; see `EdgeClassifier.score_pairs`."""
        return self.mlp.evaluate_pairs(nodes, edges, pairs).squeeze(1)
