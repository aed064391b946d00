"""The features in plain NumPy, column by column: the oracle for the compiled loops."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import Pairs
from sgbd.features import DEPTH_STEP_UNIT, DISTANCE_UNIT, EDGE_NAMES, Geometry, sums_of_pairs
from sgbd.frame import Frame
from sgbd.regions import (
    COLOR_STEP,
    COLUMN,
    DEPTH_STEP,
    DEPTH_STEP_MIN,
    MOMENT_PAIRS,
    PAIRS,
    RGB,
    RGB_SQUARED,
    ROW,
    VALID_PAIRS,
    XYZ,
    XYZ_SQUARED,
    Borders,
    Regions,
)


def covariances(regions: Regions) -> npt.NDArray[np.float64]:
    """Return the covariance of the points of each superpixel, [N, 3, 3]; 0 for superpixels without depth."""
    points = np.maximum(regions.valid, 1)[:, None]
    mean = regions.sums[:, XYZ : XYZ + 3] / points
    moments = regions.sums[:, XYZ_SQUARED : XYZ_SQUARED + 6] / points
    covariance = np.empty((len(points), 3, 3))
    for column, (a, b) in enumerate(MOMENT_PAIRS):
        covariance[:, a, b] = covariance[:, b, a] = moments[:, column] - mean[:, a] * mean[:, b]
    return covariance


def node_features(frame: Frame, regions: Regions, geometry: Geometry) -> npt.NDArray[np.float32]:
    """Compute the same as `sgbd.features.node_features`."""
    pixels = regions.pixels
    color = regions.sums[:, RGB : RGB + 3] / pixels[:, None]
    color_variance = regions.sums[:, RGB_SQUARED : RGB_SQUARED + 3] / pixels[:, None] - color**2
    row, column = regions.sums[:, ROW] / pixels, regions.sums[:, COLUMN] / pixels
    valid_depth = frame.depth[frame.depth > 0]
    near, far = float(valid_depth.min()), float(valid_depth.max())
    scene = (geometry.centroid * pixels[:, None]).sum(0) / pixels.sum()
    columns = [
        *(color / 255).T,
        column / frame.width,
        row / frame.height,
        (geometry.centroid[:, 2] - near) / max(far - near, 1e-9),
        *_normals_at(frame, row, column).T,
        *(geometry.centroid - scene).T,
        *geometry.normal.T,
        *(np.sqrt(np.maximum(color_variance, 0)) / 255).T,
        np.log(pixels / frame.depth.size),
        1 - regions.valid / pixels,
        np.log1p(geometry.residual * 1000),
    ]
    return np.stack(columns, axis=1).astype(np.float32)


def _normals_at(frame: Frame, row: npt.NDArray[np.float64], column: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return unit normals from central differences of the depth at single pixels; slope 0 if depth is missing."""
    r, c = np.rint(row).astype(int), np.rint(column).astype(int)
    z = frame.depth[r, c].astype(np.float64)

    def slope(
        before: tuple[npt.NDArray, npt.NDArray], after: tuple[npt.NDArray, npt.NDArray], focal: float
    ) -> npt.NDArray[np.float64]:
        low, high = frame.depth[before].astype(np.float64), frame.depth[after].astype(np.float64)
        steps = (after[0] - before[0]) + (after[1] - before[1])
        known = (low > 0) & (high > 0) & (z > 0) & (steps > 0)
        # One pixel spans z / focal metres.
        return np.where(known, (high - low) / np.maximum(steps, 1) * focal / np.maximum(z, 1e-9), 0.0)

    height, width = frame.depth.shape
    dz_dx = slope((r, np.maximum(c - 1, 0)), (r, np.minimum(c + 1, width - 1)), frame.camera.fx)
    dz_dy = slope((np.maximum(r - 1, 0), c), (np.minimum(r + 1, height - 1), c), frame.camera.fy)
    normal = np.stack([-dz_dx, -dz_dy, np.ones(len(z))], axis=1)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def edge_features(
    pairs: Pairs, borders: Borders, regions: Regions, geometry: Geometry
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Compute the same as `sgbd.features.edge_features`."""
    i, j = pairs
    sums = sums_of_pairs(pairs, borders)
    length, known = sums[:, PAIRS], sums[:, VALID_PAIRS]
    color = regions.sums[:, RGB : RGB + 3] / regions.pixels[:, None] / 255
    between = geometry.centroid[j] - geometry.centroid[i]
    distance = np.linalg.norm(between, axis=1)
    direction = between / np.maximum(distance, 1e-9)[:, None]
    normal_i, normal_j = geometry.normal[i], geometry.normal[j]
    to_plane_of_i = _signed_log((between * normal_i).sum(1) / DISTANCE_UNIT)
    to_plane_of_j = _signed_log(-(between * normal_j).sum(1) / DISTANCE_UNIT)
    forward = np.stack(
        [
            np.log1p(length),
            np.log1p(sums[:, DEPTH_STEP] / np.maximum(known, 1) / DEPTH_STEP_UNIT),
            np.log1p(sums[:, DEPTH_STEP_MIN] / DEPTH_STEP_UNIT),
            1 - known / np.maximum(length, 1),
            sums[:, COLOR_STEP] / np.maximum(length, 1) / 255,
            ((normal_j - normal_i) * direction).sum(1),
            (normal_i * normal_j).sum(1),
            to_plane_of_i,
            to_plane_of_j,
            np.log1p(distance / DISTANCE_UNIT),
            np.linalg.norm(color[i] - color[j], axis=1),
        ],
        axis=1,
    ).astype(np.float32)
    backward = forward.copy()
    ahead, back = EDGE_NAMES.index("plane_distance"), EDGE_NAMES.index("plane_distance_back")
    backward[:, [ahead, back]] = forward[:, [back, ahead]]
    return forward, backward


def _signed_log(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.sign(values) * np.log1p(np.abs(values))
