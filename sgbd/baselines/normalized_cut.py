"""Normalised cuts of the graph of superpixels."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from skimage.graph import cut_normalized

from sgbd.adjacency import LabelMap
from sgbd.baselines.baseline import SuperpixelBaseline
from sgbd.baselines.color_depth_graph import ColorDepthGraph
from sgbd.frame import Frame
from sgbd.superpixels import Superpixels


class NormalizedCut(SuperpixelBaseline):
    """Divides the graph in two, recursively, as long as the cut is cheap, with scikit-image's `cut_normalized`.

    J. Shi, J. Malik, "Normalized cuts and image segmentation", IEEE TPAMI 22(8), 2000, doi:10.1109/34.868688.

    Args:
        superpixels: Frame to label map int32 [H, W], ids 0..N-1.
        threshold: Value of the normalised cut, 0 to 2, from which a part is not divided.
        scale: Difference of two superpixels (see `ColorDepthGraph`) at which their similarity, a Gaussian of it, has
            fallen to 1/e.
        depth_weight: Weight of a depth step of one metre relative to a colour step from black to white.
        seed: Fixes the start vectors of the eigenvalue solver.

    Raises:
        ValueError: If the scale is not positive.
    """

    def __init__(
        self,
        superpixels: Superpixels,
        threshold: float = 0.1,
        scale: float = 0.2,
        depth_weight: float = 10.0,
        seed: int = 0,
    ) -> None:
        if not scale > 0:
            raise ValueError(f"scale of NormalizedCut must be positive; got {scale}")
        super().__init__(superpixels)
        self.graph = ColorDepthGraph(depth_weight)
        self.threshold = threshold
        self.scale = scale
        self.seed = seed

    def merge(self, frame: Frame, label_map: LabelMap) -> npt.NDArray[np.int32]:
        """Merge superpixels."""
        graph = self.graph(frame, label_map)
        for _, _, edge in graph.edges(data=True):
            # Never 0: a node whose similarities are all 0 has degree 0, by which the cut is divided.
            edge["weight"] = max(math.exp(-((edge["weight"] / self.scale) ** 2)), 1e-6)
        return cut_normalized(label_map, graph, self.threshold, rng=self.seed).astype(np.int32) + 1
