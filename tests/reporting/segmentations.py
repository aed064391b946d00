"""Hand-made segmentations."""

from __future__ import annotations

import numpy as np

from sgbd.adjacency import border_pairs
from sgbd.frame import Frame
from sgbd.segmentation import Segmentation


def halves(frame: Frame, probability: float) -> Segmentation:
    """Return two superpixels side by side with one edge between them, and no predicted object."""
    superpixels = np.zeros(frame.depth.shape, np.int32)
    superpixels[:, frame.width // 2 :] = 1
    return Segmentation(
        instances=np.zeros_like(superpixels),
        scores=np.zeros(0, np.float32),
        objectness=np.zeros(0, np.float32),
        superpixels=superpixels,
        edge_index=border_pairs(superpixels),
        edge_probability=np.array([probability], np.float32),
    )
