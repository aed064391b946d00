"""Linear encoding of feature columns, including the case of no columns."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class InputEncoder(nn.Module):
    """A linear layer; with no input columns, only its bias: one learned state for all rows.

    `torch.nn.Linear` with no inputs warns when it is built and initialises the bias to exactly 0, where all gates are
    equal.

    Args:
        in_channels: Number of feature columns; may be 0.
        out_channels: Width of the states.
    """

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.linear = nn.Linear(in_channels, out_channels) if in_channels else None
        self.state = None if in_channels else nn.Parameter(torch.randn(out_channels) / out_channels**0.5)

    def forward(self, rows: Tensor) -> Tensor:
        """Encode rows.

        Args:
            rows: float32 [R, in_channels].

        Returns:
            float32 [R, out_channels].
        """
        if self.state is not None:
            return self.state.expand(rows.size(0), -1)
        assert self.linear is not None
        encoded: Tensor = self.linear(rows)
        return encoded

    def in_own_memory(self, rows: Tensor) -> Tensor:
        """Encode rows as `forward` does, into memory that may be changed because no parameter shares it."""
        encoded: Tensor = self(rows)
        return encoded if self.state is None else encoded.clone(memory_format=torch.contiguous_format)
