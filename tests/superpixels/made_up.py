"""A made-up tabletop frame that is difficult for superpixels, and quality measures on it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.frame import Frame
from sgbd.metrics.contingency import ContingencyTable
from sgbd.metrics.superpixel import (
    achievable_segmentation_accuracy,
    boundary_recall,
    explained_variation,
    undersegmentation_error,
)


def made_up_frame(seed: int) -> Frame:
    """Return a table with tilted, overlapping, coloured discs and boxes, with noise in colour and depth, and holes."""
    rng = np.random.default_rng(seed)
    height, width = 150, 201
    row, column = np.mgrid[:height, :width].astype(float)
    depth = 1.6 - 0.004 * row
    rgb = np.stack([120 + 0.3 * row, 100 + 0.2 * column, 90 + 0 * row], axis=-1)
    instances = np.ones((height, width), np.int32)
    for k in range(9):
        y, x = rng.uniform(15, height - 15), rng.uniform(15, width - 15)
        a, b = rng.uniform(8, 30, 2)
        inside = ((row - y) / a) ** 2 + ((column - x) / b) ** 2 < 1
        if k % 2:
            inside = (abs(row - y) < 0.8 * a) & (abs(column - x) < 0.8 * b)
        surface = 1.6 - 0.004 * y - rng.uniform(0.05, 0.3) + rng.normal(0, 1e-3) * (column - x)
        depth = np.where(inside, surface, depth)
        rgb = np.where(inside[..., None], rng.uniform(20, 235, 3) * (0.8 + 0.002 * row[..., None]), rgb)
        instances[inside] = k + 2
    depth = depth + rng.normal(0, 0.003, depth.shape)
    for _ in range(6):
        y, x = rng.integers(0, height), rng.integers(0, width)
        depth[y : y + 12, x : x + 5] = 0
    rgb = np.clip(rgb + rng.normal(0, 5, rgb.shape), 0, 255).astype(np.uint8)
    return Frame(rgb, depth.astype(np.float32), instances=instances)


def quality(label_map: LabelMap, frame: Frame) -> npt.NDArray[np.float64]:
    """Return the number of superpixels, followed by measures for which higher is better."""
    assert frame.instances is not None
    table = ContingencyTable.from_label_maps(label_map, frame.instances)
    valid = frame.depth > 0
    clipped = np.minimum(frame.depth, np.percentile(frame.depth[valid], 98))
    return np.array(
        [
            label_map.max() + 1,
            explained_variation(label_map, frame.rgb),
            explained_variation(label_map, clipped, valid),
            boundary_recall(label_map, frame.instances),
            1 - undersegmentation_error(table),
            achievable_segmentation_accuracy(table),
        ]
    )
