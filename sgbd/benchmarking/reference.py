"""The published algorithm, re-stated in the plain way that determines its cost, as what to measure against.

Örnek et al., "SupeRGB-D: Zero-shot instance segmentation in cluttered indoor environments", IEEE RA-L 8(6), 2023,
arXiv 2212.11922. This is code of our own from the method's description, and nothing else in the package uses it. What
makes its cost, and what `sgbd` does differently, is kept: a binary mask of the whole image for each patch (at one byte
a pixel, the leanest there is), features by a loop over the patches, pairs by a double loop over bounding boxes,
NetworkX for the components, and one more pass over the image for each patch that is painted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import networkx as nx
import numpy as np
import numpy.typing as npt
import torch
from skimage.segmentation import slic
from torch import Tensor

from sgbd.benchmarking.timing import Stopwatch
from sgbd.frame import Frame
from sgbd.models import SharedMLP

Masks = list[npt.NDArray[np.bool_]]

STAGES = ("superpixels", "masks", "features", "pairs", "model", "partition", "painting")
FEATURES = 9
"""Mean red, green, blue; centroid x, y; mean depth; normal at the centroid."""

COMBINE = 1000
"""The id of a patch is that of its colour superpixel times this, plus that of its depth superpixel."""


def scikit_image_superpixels(frame: Frame, n_segments: int) -> tuple[npt.NDArray[np.integer], npt.NDArray[np.integer]]:
    """Call scikit-image's SLIC twice, one call after the other, with the paper's settings.

    Missing depth stays 0: nothing but the calls shall cost time.

    Args:
        frame: The frame.
        n_segments: Superpixels asked for in each call.

    Returns:
        Labels of the colours and of the depth, int [H, W] each, from 0.
    """
    rgb = slic(frame.rgb, n_segments=n_segments, compactness=10, sigma=1, start_label=0)
    depth = slic(
        frame.depth / frame.depth.max(),
        n_segments=n_segments,
        compactness=0.08,
        sigma=0.01,
        start_label=0,
        channel_axis=None,
    )
    return rgb, depth


@dataclass(frozen=True)
class Reference:
    """Segments frames in the published way.

    Attributes:
        n_segments: Superpixels asked for on colour and on depth.
        score: Features of both ends, float32 [P, 18], to merge logits [P]; a pair merges if its logit is above 0.
    """

    n_segments: int
    score: Callable[[Tensor], Tensor]

    @classmethod
    def untrained(cls, n_segments: int) -> Reference:
        """Return one with the authors' form of the perceptron and random weights, on which time does not depend."""
        model = SharedMLP(FEATURES, hidden_channels=(128, 256, 256), plain_last=False, bias=False).eval()

        def score(ends: Tensor) -> Tensor:
            return model.score(ends[:, :FEATURES], ends[:, FEATURES:], ends[:, :0])

        return cls(n_segments, score)

    def __call__(self, frame: Frame, stopwatch: Stopwatch | None = None) -> npt.NDArray[np.int32]:
        """Segment a frame.

        Args:
            frame: The frame.
            stopwatch: Takes the time of each of `STAGES`, if it is given.

        Returns:
            int32 [H, W], segments from 1.
        """
        stopwatch = stopwatch or Stopwatch()
        with stopwatch.step("superpixels"):
            rgb, depth = scikit_image_superpixels(frame, self.n_segments)
            combined = rgb.astype(np.int64) * COMBINE + depth
        with stopwatch.step("masks"):
            masks = [combined == patch for patch in np.unique(combined)]
        with stopwatch.step("features"):
            features = patch_features(frame, masks)
        with stopwatch.step("pairs"):
            pairs = touching_boxes(masks)
        with stopwatch.step("model"), torch.no_grad():
            x = torch.from_numpy(features)
            ends = torch.cat([x[pairs[0]], x[pairs[1]]], dim=1)
            merge = self.score(ends).numpy() > 0 if pairs.size else np.zeros(0, bool)
        with stopwatch.step("partition"):
            graph: nx.Graph = nx.Graph()
            graph.add_nodes_from(range(len(masks)))
            graph.add_edges_from(pairs.T[merge].tolist())
            segments = list(nx.connected_components(graph))
        with stopwatch.step("painting"):
            painted = np.zeros(frame.depth.shape, np.int32)
            for number, patches in enumerate(segments, start=1):
                for patch in patches:
                    painted[masks[patch]] = number
        return painted


def touching_boxes(masks: Masks) -> npt.NDArray[np.int64]:
    """Pair the patches whose bounding boxes touch or overlap, by comparing every box with every other.

    Args:
        masks: Mask of each patch, bool [H, W].

    Returns:
        int64 [2, E], i < j, sorted.
    """
    boxes = []
    for mask in masks:
        rows, columns = np.nonzero(mask)
        boxes.append((int(rows.min()), int(columns.min()), int(rows.max()), int(columns.max())))
    pairs = []
    for i, (top, left, bottom, right) in enumerate(boxes):
        for j in range(i + 1, len(boxes)):
            other_top, other_left, other_bottom, other_right = boxes[j]
            if (
                top <= other_bottom + 1
                and other_top <= bottom + 1
                and left <= other_right + 1
                and other_left <= right + 1
            ):
                pairs.append((i, j))
    return np.array(pairs, np.int64).reshape(-1, 2).T


def patch_features(frame: Frame, masks: Masks) -> npt.NDArray[np.float32]:
    """Compute the paper's explicit features patch by patch.

    Args:
        frame: The frame.
        masks: Mask of each patch, bool [H, W].

    Returns:
        float32 [N, 9], see `FEATURES`.
    """
    height, width = frame.depth.shape
    low, high = float(frame.depth.min()), float(frame.depth.max())
    stretched = (frame.depth - low) / max(high - low, 1e-9)
    slope_y = np.gradient(frame.depth, axis=0) if height > 1 else np.zeros_like(frame.depth)
    slope_x = np.gradient(frame.depth, axis=1) if width > 1 else np.zeros_like(frame.depth)
    features = np.empty((len(masks), FEATURES), np.float32)
    for patch, mask in enumerate(masks):
        rows, columns = np.nonzero(mask)
        row, column = rows.mean(), columns.mean()
        at = round(row), round(column)
        normal = np.array([-slope_x[at], -slope_y[at], 1.0])
        features[patch, 0:3] = frame.rgb[mask].mean(axis=0) / 255
        features[patch, 3:5] = column / width, row / height
        features[patch, 5] = stretched[mask].mean()
        features[patch, 6:9] = normal / np.linalg.norm(normal)
    return features
