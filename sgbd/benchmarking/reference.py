"""A straightforward implementation of the published algorithm, as reference for speed and memory measurements.

Örnek et al., "SupeRGB-D: Zero-shot instance segmentation in cluttered indoor environments", IEEE RA-L 8(6), 2023,
arXiv 2212.11922. The code was written from the description of the method and is used for benchmarks only. It keeps the
steps that dominate the cost and that `sgbd` does differently: a binary mask of the whole image for each patch (at one
byte per pixel, the smallest possible), features in a loop over patches, pairs in a double loop over bounding boxes,
NetworkX for connected components, and one more pass over the image to paint each patch.
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
"""The id of a patch is COMBINE times the id of its colour superpixel plus the id of its depth superpixel."""


def scikit_image_superpixels(frame: Frame, n_segments: int) -> tuple[npt.NDArray[np.integer], npt.NDArray[np.integer]]:
    """Run scikit-image's SLIC on colour and on depth, one after the other, with the paper's settings.

    Missing depth stays 0, so that only the two calls are timed.

    Args:
        frame: The frame.
        n_segments: Number of superpixels requested in each call.

    Returns:
        Label maps of colour and of depth, int [H, W] each, from 0.
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
    """Segments frames with the published algorithm.

    Attributes:
        n_segments: Number of superpixels requested for colour and for depth.
        score: Maps the features of both ends, float32 [P, 18], to merge logits [P]; logits above 0 merge.
    """

    n_segments: int
    score: Callable[[Tensor], Tensor]

    @classmethod
    def untrained(cls, n_segments: int) -> Reference:
        """Return a reference with the authors' MLP and random weights, on which run time does not depend."""
        model = SharedMLP(FEATURES, hidden_channels=(128, 256, 256), plain_last=False, bias=False).eval()

        def score(ends: Tensor) -> Tensor:
            return model.score(ends[:, :FEATURES], ends[:, FEATURES:], ends[:, :0])

        return cls(n_segments, score)

    def __call__(self, frame: Frame, stopwatch: Stopwatch | None = None) -> npt.NDArray[np.int32]:
        """Segment a frame.

        Args:
            frame: The frame.
            stopwatch: Records the time of each of `STAGES`, if given.

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
    """Find the pairs of patches whose bounding boxes touch or overlap, by comparing all pairs of boxes.

    Args:
        masks: Mask of each patch, bool [H, W].

    Returns:
        int64 [2, E], pairs i < j, sorted.
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
