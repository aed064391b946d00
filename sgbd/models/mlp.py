"""The shared multilayer perceptron: every pair of superpixels on its own."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import linear
from torch_geometric.nn import MLP

from sgbd.models.edge_classifier import EdgeClassifier

EVALUATED_AT_ONCE = 512
"""Pairs whose hidden states fit into the second-level cache of common processors."""


class SharedMLP(EdgeClassifier):
    """One perceptron, shared by all pairs, on the features of the two ends and of the edge between them.

    It computes nothing but the pairs that are asked for. The model of Örnek et al., "SupeRGB-D: Zero-shot instance
    segmentation in cluttered indoor environments", IEEE RA-L 8(6), 2023, https://doi.org/10.1109/LRA.2023.3271527.
    Three forms are shipped as configurations:

    ================== ============= ========== ====== ==========================================================
    `model=`           hidden layers last layer bias   what it is
    ================== ============= ========== ====== ==========================================================
    `mlp`              128-256-256   plain      yes    the default: logits of either sign
    `mlp_reference`    128-256-256   norm, ReLU no     as trained by the authors; 103,682 parameters on 30 inputs.
                                                       Its logits are never negative: merge iff above 0
    `mlp_paper_text`   256-1024-256  plain      yes    the widths that the paper's text gives
    ================== ============= ========== ====== ==========================================================

    Args:
        node_channels: Columns of `Data.x`.
        edge_channels: Columns of `Data.edge_attr`; may be 0.
        hidden_channels: Width of each hidden layer.
        plain_last: Whether the last layer is linear only. Otherwise batch norm and ReLU follow it, as all others.
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
        self.mlp = MLP(
            [2 * node_channels + edge_channels, *hidden_channels, 1],
            dropout=dropout,
            norm="batch_norm",
            # A batch of a single pair has no variance; then the running moments stand in.
            norm_kwargs={"allow_single_element": True},
            plain_last=plain_last,
            bias=bias,
        )

    def score(self, source: Tensor, target: Tensor, edge: Tensor) -> Tensor:
        """Score directed pairs; see `EdgeClassifier.score`."""
        pairs = torch.cat([source, target, edge], dim=1)
        logits: Tensor = self.mlp(pairs) if self.training else self._evaluated(pairs)
        return logits.squeeze(1)

    def _evaluated(self, pairs: Tensor) -> Tensor:
        """Compute what the perceptron gives in evaluation, with less to do.

        There batch norm is a fixed scale and shift of each column, and goes into the linear layer before it; and a
        block of pairs at a time stays in the processor's cache through all layers.
        """
        layers = []
        for place, layer in enumerate(self.mlp.lins):
            weight = layer.weight
            bias = weight.new_zeros(weight.size(0)) if layer.bias is None else layer.bias
            plain = self.mlp.plain_last and place == len(self.mlp.lins) - 1
            if not plain:
                norm = self.mlp.norms[place].module
                scale = norm.weight * torch.rsqrt(norm.running_var + norm.eps)
                weight, bias = weight * scale[:, None], (bias - norm.running_mean) * scale + norm.bias
            layers.append((weight, bias, plain))
        scored = []
        for block in pairs.split(EVALUATED_AT_ONCE):
            for weight, bias, plain in layers:
                block = linear(block, weight, bias)
                if not plain:
                    block = block.relu()
            scored.append(block)
        return torch.cat(scored)
