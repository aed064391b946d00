"""Superpixels merged if two neighbours differ by less than a threshold."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from skimage.graph import cut_threshold

from sgbd.adjacency import LabelMap
from sgbd.baselines.baseline import SuperpixelBaseline
from sgbd.baselines.color_depth_graph import ColorDepthGraph
from sgbd.frame import Frame
from sgbd.superpixels import Superpixels


class ThresholdCut(SuperpixelBaseline):
    """Keeps the edges below a threshold; segments are the connected components, with scikit-image's `cut_threshold`.

    A. Trémeau, P. Colantoni, "Regions adjacency graph applied to color image segmentation", IEEE TIP 9(4), 2000,
    doi:10.1109/83.841950.

    Args:
        superpixels: Frame to label map int32 [H, W], ids 0..N-1.
        threshold: Edge weight from which two superpixels are kept apart; see `ColorDepthGraph`.
        depth_weight: Weight of a depth step of one metre relative to a colour step from black to white.
    """

    def __init__(self, superpixels: Superpixels, threshold: float = 0.1, depth_weight: float = 3.0) -> None:
        super().__init__(superpixels)
        self.graph = ColorDepthGraph(depth_weight)
        self.threshold = threshold

    def merge(self, frame: Frame, label_map: LabelMap) -> npt.NDArray[np.int32]:
        """Merge superpixels."""
        return cut_threshold(label_map, self.graph(frame, label_map), self.threshold).astype(np.int32) + 1
