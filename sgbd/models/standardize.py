"""Standardisation of input columns by the moments of the training set."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn


class ColumnMoments:
    """Mean and variance of the columns of a matrix that arrives in pieces.

    Updates run in float64 and around means, so that long data sets and columns far from zero lose no precision.

    Args:
        columns: Width of the matrix.
    """

    def __init__(self, columns: int) -> None:
        self.count = 0
        self.mean = torch.zeros(columns, dtype=torch.float64)
        self.deviation = torch.zeros(columns, dtype=torch.float64)

    def update(self, rows: Tensor) -> None:
        """Add rows to the moments (the pairwise update of Chan, Golub and LeVeque 1983).

        Args:
            rows: [R, columns], any float dtype, finite.
        """
        count = rows.size(0)
        if count == 0:
            return
        rows = rows.double()
        mean = rows.mean(0)
        deviation = (rows - mean).square().sum(0)
        shift = mean - self.mean
        total = self.count + count
        self.deviation += deviation + shift.square() * (self.count * count / total)
        self.mean += shift * (count / total)
        self.count = total

    @property
    def scale(self) -> Tensor:
        """Standard deviation of each column, float64 [columns]; 1 for a column that never varies."""
        deviation = (self.deviation / max(self.count, 1)).sqrt()
        # Dividing a column that varies only by rounding would turn it into noise of unit size.
        varies = deviation > 1e-6 * self.mean.abs().clamp(min=1e-6)
        return torch.where(varies, deviation, torch.ones_like(deviation))


class Standardize(nn.Module):
    """Shift and scale input columns to zero mean and unit variance over the training set.

    The moments are buffers: a checkpoint contains them, and no optimiser changes them. Until they are set, the module
    returns its input unchanged.

    Args:
        columns: Number of input columns; may be 0.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, columns: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(columns))
        self.register_buffer("scale", torch.ones(columns))

    def fit(self, moments: ColumnMoments | Sequence[Tensor]) -> None:
        """Set the moments from the training set.

        Args:
            moments: Accumulated moments, or the matrices [R, columns] from which to compute them.

        Raises:
            ValueError: If the number of columns differs.
        """
        if not isinstance(moments, ColumnMoments):
            pieces, moments = moments, ColumnMoments(self.mean.numel())
            for rows in pieces:
                moments.update(rows)
        if moments.mean.shape != self.mean.shape:
            raise ValueError(
                f"this model standardises {self.mean.numel()} columns; the data has {moments.mean.numel()}. "
                "Select the same features for the data and for the model."
            )
        self.mean.copy_(moments.mean)
        self.scale.copy_(moments.scale)

    def forward(self, rows: Tensor) -> Tensor:
        """Standardise rows.

        Args:
            rows: float [R, columns].

        Returns:
            float [R, columns].
        """
        return (rows - self.mean) / self.scale

    def extra_repr(self) -> str:
        """Return the number of columns, for `repr`."""
        return str(self.mean.numel())
