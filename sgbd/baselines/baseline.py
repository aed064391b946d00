"""The interface of the methods that are compared with."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.frame import Frame
from sgbd.superpixels import Superpixels


class Baseline(ABC):
    """Segments frames without having learned anything.

    Attributes:
        decides_objects: Whether the method itself says what an object is. If not, every pixel belongs to a segment, and
            only protocols that take this from the truth can judge it.
    """

    decides_objects: bool = False

    @abstractmethod
    def __call__(self, frame: Frame) -> npt.NDArray[np.int32]:
        """Segment a frame; its truth, if it has any, is not looked at.

        Args:
            frame: The frame.

        Returns:
            int32 [H, W]: segments from 1; 0 is what the method takes for no object, which occurs only with
            `decides_objects`.
        """


class SuperpixelBaseline(Baseline):
    """A baseline that merges superpixels.

    Args:
        superpixels: Frame to label map int32 [H, W], ids 0..N-1.
    """

    def __init__(self, superpixels: Superpixels) -> None:
        self.superpixels = superpixels

    def __call__(self, frame: Frame) -> npt.NDArray[np.int32]:
        """Over-segment a frame, and merge."""
        return self.merge(frame, self.superpixels(frame))

    @abstractmethod
    def merge(self, frame: Frame, label_map: LabelMap) -> npt.NDArray[np.int32]:
        """Merge superpixels to segments.

        Args:
            frame: The frame.
            label_map: int32 [H, W], its superpixels, ids 0..N-1.

        Returns:
            int32 [H, W], segments from 1.
        """
