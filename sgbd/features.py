"""Features of superpixels and of the edges between them, as named columns in one declared order.

Every column is computed and stored; an ablation selects columns of the same matrix by the names of their groups.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import Pairs
from sgbd.frame import Frame, Intrinsics
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

NODE_GROUPS: Mapping[str, tuple[str, ...]] = {
    # The paper's.
    "rgb": ("red", "green", "blue"),
    "position": ("centroid_x", "centroid_y"),
    "depth": ("depth",),
    "normal": ("normal_x", "normal_y", "normal_z"),
    # Beyond the paper.
    "xyz": ("scene_x", "scene_y", "scene_z"),
    "mean_normal": ("plane_normal_x", "plane_normal_y", "plane_normal_z"),
    "color_spread": ("red_spread", "green_spread", "blue_spread"),
    "shape": ("log_area", "missing_depth", "roughness"),
}
"""Columns of the node feature matrix by group, in their order.

- rgb: mean colour, 0 to 1.
- position: centroid, column / width and row / height.
- depth: mean depth, stretched to 0..1 between the nearest and the farthest valid pixel of the frame.
- normal: unit normal (-dz/dx, -dz/dy, 1) at the centroid pixel, slopes in metres per metre.
- xyz: mean position in camera coordinates relative to the frame's mean position, metres.
- mean_normal: unit normal of the plane fitted to all its points, facing the camera.
- color_spread: standard deviation of the colour, 0 to 1.
- shape: log of the area as a share of the frame; share of pixels without depth; log1p of the plane fit's root mean
  square residual in millimetres.
"""

EDGE_GROUPS: Mapping[str, tuple[str, ...]] = {
    "border": ("log_border_length",),
    "depth_step": ("mean_depth_step", "min_depth_step", "missing_depth_step"),
    "gradient": ("color_step",),
    "convexity": ("convexity", "normal_agreement", "plane_distance", "plane_distance_back"),
    "distance": ("centroid_distance", "color_distance"),
}
"""Columns of the edge feature matrix by group, in their order. An edge leads from superpixel i to superpixel j.

- border: log1p of the border's length in pixels.
- depth_step: mean and minimum depth step across the border, as log1p of it in units of 5 mm; share of the border's
  pixel pairs without depth on both sides.
- gradient: mean colour distance across the border, RGB 0 to 1.
- convexity: (n_j - n_i) . d with d the unit vector from centroid i to centroid j: positive where the surfaces meet in a
  convex edge (Stein et al., CVPR 2014, DOI 10.1109/CVPR.2014.46); n_i . n_j; and the signed distances of centroid j
  to the plane of i and of centroid i to the plane of j, as sign * log1p of it in units of 10 mm.
- distance: distance of the centroids in space, as log1p of it in units of 10 mm; distance of the mean colours, 0 to 1.
"""

NODE_NAMES: tuple[str, ...] = tuple(name for names in NODE_GROUPS.values() for name in names)
EDGE_NAMES: tuple[str, ...] = tuple(name for names in EDGE_GROUPS.values() for name in names)

DEPTH_STEP_UNIT = 0.005
DISTANCE_UNIT = 0.01


def node_columns(groups: Iterable[str] | None = None) -> list[int]:
    """Return the columns of `x` that belong to some groups.

    Args:
        groups: Names of `NODE_GROUPS`; None for all.

    Returns:
        Column numbers in the declared order, whatever the order of `groups`.

    Raises:
        ValueError: For an unknown group; the message lists the choices.
    """
    return _columns(NODE_GROUPS, groups, "node")


def edge_columns(groups: Iterable[str] | None = None) -> list[int]:
    """Return the columns of `edge_attr` that belong to some groups; as `node_columns`, for `EDGE_GROUPS`."""
    return _columns(EDGE_GROUPS, groups, "edge")


def _columns(table: Mapping[str, tuple[str, ...]], groups: Iterable[str] | None, kind: str) -> list[int]:
    wanted = set(table if groups is None else groups)
    unknown = sorted(wanted - set(table))
    if unknown:
        raise ValueError(f"unknown {kind} feature group {', '.join(unknown)}; choose from {', '.join(table)}")
    owners = [group for group, names in table.items() for _ in names]
    return [column for column, group in enumerate(owners) if group in wanted]


class Geometry:
    """Position and plane of every superpixel in camera coordinates.

    Superpixels without any depth take the border-weighted mean depth of their neighbours, so that no zero poses as a
    distance; the column `missing_depth` tells them apart.

    Attributes:
        centroid: float64 [N, 3], mean of the points, metres (X right, Y down, Z forward).
        normal: float64 [N, 3], unit normal of the plane fitted to the points, facing the camera.
        residual: float64 [N], root mean square distance of the points to that plane, metres.
    """

    def __init__(self, regions: Regions, borders: Borders, camera: Intrinsics) -> None:
        valid = regions.valid
        points = np.maximum(valid, 1)[:, None]
        mean = regions.sums[:, XYZ : XYZ + 3] / points
        depth = _depth_from_neighbours(mean[:, 2], valid > 0, borders)
        pixels = regions.pixels
        ray = np.stack(
            [
                (regions.sums[:, COLUMN] / pixels - camera.cx) / camera.fx,
                (regions.sums[:, ROW] / pixels - camera.cy) / camera.fy,
                np.ones(len(pixels)),
            ],
            axis=1,
        )
        self.centroid = np.where(valid[:, None] > 0, mean, ray * depth[:, None])

        moments = regions.sums[:, XYZ_SQUARED : XYZ_SQUARED + 6] / points
        covariance = np.empty((len(valid), 3, 3))
        for column, (a, b) in enumerate(MOMENT_PAIRS):
            covariance[:, a, b] = covariance[:, b, a] = moments[:, column] - mean[:, a] * mean[:, b]
        variances, axes = np.linalg.eigh(covariance)
        # A plane needs three points; with fewer the superpixel is taken to face the camera.
        view = -self.centroid / np.maximum(np.linalg.norm(self.centroid, axis=1, keepdims=True), 1e-9)
        normal = np.where(valid[:, None] >= 3, axes[:, :, 0], view)
        self.normal = np.where((normal * view).sum(1, keepdims=True) < 0, -normal, normal)
        self.residual = np.sqrt(np.maximum(np.where(valid >= 3, variances[:, 0], 0), 0))


def _depth_from_neighbours(
    depth: npt.NDArray[np.float64], known: npt.NDArray[np.bool_], borders: Borders
) -> npt.NDArray[np.float64]:
    depth = np.where(known, depth, 0.0)
    i, j = borders.pairs
    length = borders.sums[:, PAIRS]
    while not known.all():
        weight_i, weight_j = length * known[i], length * known[j]
        weight = np.bincount(i, weight_j, len(depth)) + np.bincount(j, weight_i, len(depth))
        total = np.bincount(i, weight_j * depth[j], len(depth)) + np.bincount(j, weight_i * depth[i], len(depth))
        reached = ~known & (weight > 0)
        if not reached.any():
            break
        depth[reached] = total[reached] / weight[reached]
        known = known | reached
    return depth


def node_features(frame: Frame, regions: Regions, geometry: Geometry) -> npt.NDArray[np.float32]:
    """Compute all node features.

    Args:
        frame: The frame.
        regions: Sums over its superpixels.
        geometry: Positions and planes of its superpixels.

    Returns:
        float32 [N, F], columns as `NODE_NAMES`.
    """
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
    """Unit normals from central differences of the depth at single pixels; slope 0 where depth is missing."""
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
    """Compute all edge features, both ways.

    Args:
        pairs: int64 [2, E], i < j; pairs without a common border have a border of length 0.
        borders: Sums over the borders.
        regions: Sums over the superpixels.
        geometry: Positions and planes of the superpixels.

    Returns:
        float32 [E, D] of the edges i to j, and float32 [E, D] of the edges j to i; columns as `EDGE_NAMES`.
    """
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


def sums_of_pairs(pairs: Pairs, borders: Borders) -> npt.NDArray[np.float64]:
    """Look up the border sums of pairs; zeros for pairs without a common border.

    Args:
        pairs: int64 [2, E], i < j.
        borders: Sums over the borders.

    Returns:
        float64 [E, 5], as `Borders.sums`.
    """
    if pairs.shape == borders.pairs.shape and (pairs == borders.pairs).all():
        return borders.sums
    sums = np.zeros((pairs.shape[1], borders.sums.shape[1]))
    if borders.pairs.shape[1]:
        count = int(max(pairs.max(initial=0), borders.pairs.max(initial=0))) + 1
        wanted, present = pairs[0] * count + pairs[1], borders.pairs[0] * count + borders.pairs[1]
        position = np.minimum(np.searchsorted(present, wanted), len(present) - 1)
        found = present[position] == wanted
        sums[found] = borders.sums[position[found]]
    return sums


def _signed_log(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.sign(values) * np.log1p(np.abs(values))
