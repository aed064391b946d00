"""The interface of the baselines, the methods used for comparison."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.frame import Frame
from sgbd.superpixels import Superpixels


class Baseline(ABC):
    """Segments frames without learning.

    Attributes:
        decides_objects: Whether the method decides what is an object. If not, every pixel belongs to a segment, and
            only protocols that take this decision from the ground truth can score it.
    """

    decides_objects: bool = False

    @abstractmethod
    def __call__(self, frame: Frame) -> npt.NDArray[np.int32]:
        """Segment a frame without using its ground truth.

        Args:
            frame: The frame.

        Returns:
            int32 [H, W]: segments from 1; 0 is what the method considers no object, which occurs only if
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
        """Over-segment a frame and merge its superpixels."""
        return self.merge(frame, self.superpixels(frame))

    @abstractmethod
    def merge(self, frame: Frame, label_map: LabelMap) -> npt.NDArray[np.int32]:
        """Merge superpixels into segments.

        Args:
            frame: The frame.
            label_map: int32 [H, W], its superpixels, ids 0..N-1.

        Returns:
            int32 [H, W], segments from 1.
        """
