"""Reduce the frames of a dataset, for example those of a camera of higher resolution than the frames of training."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from sgbd.frame import Frame
from sgbd.reduction import check_factor, reduced
from sgbd.sources.derived import Derived
from sgbd.sources.source import FrameSource


class Reduced(Derived):
    """The frames of a dataset, with ground truth, at a fraction of their width and height.

    Args:
        source: Factory of the dataset, called as ``source(split=...)``.
        split: Name of the split.
        factor: By which width and height are reduced, see `sgbd.reduction.reduced`.

    Raises:
        ValueError: If the factor is not a positive integer.
    """

    def __init__(self, source: Callable[..., FrameSource], split: str = "test", factor: int = 2) -> None:
        check_factor("factor", factor)
        super().__init__(source(split=split))
        self.factor = factor

    def read(self, index: int) -> Frame:
        """Read a frame and reduce it; raises the errors of the underlying dataset's `read`."""
        return reduced(self.source.read(index), self.factor)

    def options(self) -> Mapping[str, Any]:
        """Return the factor, with class and options of the underlying dataset."""
        return {"factor": self.factor, **super().options()}
