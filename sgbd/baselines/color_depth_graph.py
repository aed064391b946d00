"""The region adjacency graph that the classical merging methods cut, in scikit-image's format."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from skimage.color import rgb2lab
from skimage.graph import RAG

from sgbd.adjacency import LabelMap
from sgbd.frame import Frame
from sgbd.regions import DEPTH_STEP, VALID_PAIRS, region_and_border_sums

LAB_RANGE = 100.0
"""Lightness of white in Lab."""


class ColorDepthGraph:
    """Builds graphs of superpixels whose edges are weighted by how different their ends are.

    An edge's weight is the distance of the mean colours (in Lab, where black to white is 1) plus the weighted mean
    depth step across the border; a border without any depth counts as one without a step.

    Args:
        depth_weight: Weight of a depth step of one metre relative to a colour step from black to white.

    Raises:
        ValueError: If the weight is negative.
    """

    def __init__(self, depth_weight: float) -> None:
        if depth_weight < 0:
            raise ValueError(f"depth_weight must not be negative; got {depth_weight}")
        self.depth_weight = depth_weight

    def __call__(self, frame: Frame, label_map: LabelMap) -> RAG:
        """Build the graph of a frame.

        Args:
            frame: The frame.
            label_map: int32 [H, W], its superpixels, ids 0..N-1.

        Returns:
            A node for each superpixel with `labels` (itself), `pixels` and `color` (sum of Lab); an edge for each
            border with `weight`, `known` (pixel pairs with depth on both sides) and `step` (sum of their depth steps,
            metres).
        """
        graph = RAG()
        flat = label_map.ravel()
        count = int(flat.max()) + 1
        pixels = np.bincount(flat, minlength=count)
        lab = rgb2lab(frame.rgb).reshape(-1, 3) / LAB_RANGE
        color = np.stack([np.bincount(flat, lab[:, channel], count) for channel in range(3)], axis=1)
        graph.add_nodes_from(
            (node, {"labels": [node], "pixels": int(pixels[node]), "color": color[node]}) for node in range(count)
        )
        _, borders = region_and_border_sums(frame, label_map)
        known, step = borders.sums[:, VALID_PAIRS], borders.sums[:, DEPTH_STEP]
        for i, j, pairs_known, steps in zip(*borders.pairs.tolist(), known.tolist(), step.tolist(), strict=True):
            edge = {"known": pairs_known, "step": steps}
            graph.add_edge(i, j, **edge, weight=self.weight(graph.nodes[i], graph.nodes[j], edge))
        return graph

    def weight(self, first: Mapping[str, Any], second: Mapping[str, Any], edge: Mapping[str, float]) -> float:
        """Return the weight of an edge.

        Args:
            first: Attributes of one end.
            second: Attributes of the other end.
            edge: `known` and `step` of the edge.
        """
        color = math.dist(first["color"] / first["pixels"], second["color"] / second["pixels"])
        return color + self.depth_weight * edge["step"] / max(edge["known"], 1)
