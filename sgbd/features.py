"""Features of superpixels and of the edges between them, as named columns in a fixed order.

They are computed from the pixel sums of `sgbd.regions`, and `sgbd.graph_arrays` puts them into a graph. All columns are
always computed and stored. Ablations select columns by the names of their groups.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import accumulate

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import Pairs
from sgbd.frame import Frame, Intrinsics
from sgbd.machine.compiled import compiled
from sgbd.regions import (
    COLOR_STEP,
    COLUMN,
    DEPTH_STEP,
    DEPTH_STEP_MIN,
    PAIRS,
    PIXELS,
    RGB,
    RGB_SQUARED,
    ROW,
    VALID,
    VALID_PAIRS,
    XYZ,
    XYZ_SQUARED,
    Borders,
    Regions,
)

NODE_GROUPS: Mapping[str, tuple[str, ...]] = {
    # The features of the paper.
    "rgb": ("red", "green", "blue"),
    "position": ("centroid_x", "centroid_y"),
    "depth": ("depth",),
    "normal": ("normal_x", "normal_y", "normal_z"),
    # Additional features.
    "xyz": ("scene_x", "scene_y", "scene_z"),
    "mean_normal": ("plane_normal_x", "plane_normal_y", "plane_normal_z"),
    "color_spread": ("red_spread", "green_spread", "blue_spread"),
    "shape": ("log_area", "missing_depth", "roughness"),
}
"""Columns of the node feature matrix, in order, by group.

- rgb: mean colour, 0 to 1.
- position: centroid, column / width and row / height.
- depth: mean depth, scaled to 0..1 between the nearest and the farthest valid pixel of the frame.
- normal: unit normal (-dz/dx, -dz/dy, 1) at the centroid pixel, slopes in metres per metre.
- xyz: mean position in camera coordinates relative to the frame's mean position, metres.
- mean_normal: unit normal of the plane fitted to all points of the superpixel, facing the camera.
- color_spread: standard deviation of the colour, 0 to 1.
- shape: log of the area as a fraction of the frame; fraction of pixels without depth; log1p of the root mean square
  residual of the plane fit in millimetres.
"""

EDGE_GROUPS: Mapping[str, tuple[str, ...]] = {
    "border": ("log_border_length",),
    "depth_step": ("mean_depth_step", "min_depth_step", "missing_depth_step"),
    "gradient": ("color_step",),
    "convexity": ("convexity", "normal_agreement", "plane_distance", "plane_distance_back"),
    "distance": ("centroid_distance", "color_distance"),
}
"""Columns of the edge feature matrix, in order, by group. An edge points from superpixel i to superpixel j.

- border: log1p of the border length in pixels.
- depth_step: mean and minimum depth step across the border, each as log1p in units of 5 mm; fraction of the border's
  pixel pairs in which a pixel has no depth.
- gradient: mean colour distance across the border, RGB 0 to 1.
- convexity: (n_j - n_i) . d with d the unit vector from centroid i to centroid j, positive if the surfaces meet in a
  convex edge (Stein et al., CVPR 2014, DOI 10.1109/CVPR.2014.46); n_i . n_j; the signed distances of centroid j to the
  plane of i and of centroid i to the plane of j, each as sign * log1p in units of 10 mm.
- distance: distance of the centroids in space, as log1p in units of 10 mm; distance of the mean colours, 0 to 1.
"""

NODE_NAMES: tuple[str, ...] = tuple(name for names in NODE_GROUPS.values() for name in names)
EDGE_NAMES: tuple[str, ...] = tuple(name for names in EDGE_GROUPS.values() for name in names)

# First column of each node feature group, in the order of `NODE_GROUPS`, then the number of columns.
AT_RGB, AT_POSITION, AT_DEPTH, AT_NORMAL, AT_XYZ, AT_MEAN_NORMAL, AT_COLOR_SPREAD, AT_SHAPE, NODE_WIDTH = accumulate(
    map(len, NODE_GROUPS.values()), initial=0
)
# The same for the edge feature groups, in the order of `EDGE_GROUPS`.
AT_BORDER, AT_DEPTH_STEP, AT_GRADIENT, AT_CONVEXITY, AT_DISTANCE, EDGE_WIDTH = accumulate(
    map(len, EDGE_GROUPS.values()), initial=0
)

DEPTH_STEP_UNIT = 0.005
DISTANCE_UNIT = 0.01

SWEEPS = 12
"""Maximum number of Jacobi sweeps; a 3 x 3 matrix is diagonal after four or five."""


def node_columns(groups: Iterable[str] | None = None) -> list[int]:
    """Return the columns of `x` that belong to the given groups.

    Args:
        groups: Names of `NODE_GROUPS`; None for all.

    Returns:
        Column numbers in ascending order, regardless of the order of `groups`.

    Raises:
        ValueError: For an unknown group; the message lists the choices.
    """
    return _columns(NODE_GROUPS, groups, "node")


def edge_columns(groups: Iterable[str] | None = None) -> list[int]:
    """Return the columns of `edge_attr` that belong to the given `EDGE_GROUPS`; see `node_columns`."""
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

    Superpixels without any depth get the border-weighted mean depth of their neighbours, so that a zero is not mistaken
    for a distance. The column `missing_depth` identifies them.

    Attributes:
        centroid: float64 [N, 3], mean of the points, metres (X right, Y down, Z forward).
        normal: float64 [N, 3], unit normal of the plane fitted to the points, facing the camera.
        residual: float64 [N], root mean square distance of the points to that plane, metres.
    """

    def __init__(self, regions: Regions, borders: Borders, camera: Intrinsics) -> None:
        valid = regions.valid
        depth = _depth_from_neighbors(regions.sums[:, XYZ + 2] / np.maximum(valid, 1), valid > 0, borders)
        intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        self.centroid, self.normal = np.empty((2, len(depth), 3))
        self.residual = np.zeros(len(depth))
        turned, space = np.empty((2, 3, 3))
        _centroids_and_planes(regions.sums, depth, intrinsics, turned, space, self.centroid, self.normal, self.residual)


@compiled
def _centroids_and_planes(  # type: ignore[no-untyped-def]
    sums, depth, camera, matrix, axes, centroids, normals, residuals
):
    """Compute the attributes of `Geometry`.

    Args:
        sums: float64 [N, 19], see `sgbd.regions.Regions`.
        depth: float64 [N], metres; used for superpixels without any depth.
        camera: float64 [4], fx, fy, cx, cy.
        matrix: float64 [3, 3], workspace.
        axes: float64 [3, 3], workspace.
        centroids: float64 [N, 3], output.
        normals: float64 [N, 3], output.
        residuals: float64 [N] of zeros, output.
    """
    for region in range(len(sums)):
        total, centroid, normal = sums[region], centroids[region], normals[region]
        valid, pixels = total[VALID], total[PIXELS]
        if valid > 0:
            x, y, z = total[XYZ] / valid, total[XYZ + 1] / valid, total[XYZ + 2] / valid
        else:
            z = depth[region]
            x = (total[COLUMN] / pixels - camera[2]) / camera[0] * z
            y = (total[ROW] / pixels - camera[3]) / camera[1] * z
        centroid[0], centroid[1], centroid[2] = x, y, z
        # A plane needs three points. With fewer, assume that the superpixel faces the camera.
        if valid < 3:
            distance = np.sqrt(x * x + y * y + z * z)
            distance = 1e-9 if distance < 1e-9 else distance
            for axis in range(3):
                normal[axis] = -centroid[axis] / distance
            continue
        moment = XYZ_SQUARED
        for row in range(3):
            for column in range(row, 3):
                covariance = total[moment] / valid - centroid[row] * centroid[column]
                matrix[row, column] = matrix[column, row] = covariance
                moment += 1
        _diagonalize(matrix, axes)
        flattest = 0
        for axis in range(1, 3):
            if matrix[axis, axis] < matrix[flattest, flattest]:
                flattest = axis
        towards = -(x * axes[0, flattest] + y * axes[1, flattest] + z * axes[2, flattest])
        for axis in range(3):
            normal[axis] = -axes[axis, flattest] if towards < 0 else axes[axis, flattest]
        smallest = matrix[flattest, flattest]
        residuals[region] = np.sqrt(0.0 if smallest < 0 else smallest)


@compiled
def _diagonalize(matrix, axes):  # type: ignore[no-untyped-def]
    """Diagonalise a symmetric 3 x 3 matrix in place, and write its unit eigenvectors to the columns of `axes`.

    Uses Jacobi rotations (Golub and Van Loan, "Matrix computations", section 8.5). For matrices this small they are
    faster than one LAPACK call per matrix, and as accurate.
    """
    for row in range(3):
        for column in range(3):
            axes[row, column] = 1.0 if row == column else 0.0
    for _ in range(SWEEPS):
        off = abs(matrix[0, 1]) + abs(matrix[0, 2]) + abs(matrix[1, 2])
        if off <= 1e-15 * (abs(matrix[0, 0]) + abs(matrix[1, 1]) + abs(matrix[2, 2])):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if matrix[p, q] == 0:
                    continue
                slope = (matrix[q, q] - matrix[p, p]) / (2 * matrix[p, q])
                tangent = (1.0 if slope >= 0 else -1.0) / (abs(slope) + np.sqrt(slope * slope + 1))
                cosine = 1 / np.sqrt(tangent * tangent + 1)
                sine = tangent * cosine
                other = 3 - p - q
                shift = tangent * matrix[p, q]
                matrix[p, p] -= shift
                matrix[q, q] += shift
                matrix[p, q] = matrix[q, p] = 0.0
                to_p, to_q = matrix[other, p], matrix[other, q]
                matrix[other, p] = matrix[p, other] = cosine * to_p - sine * to_q
                matrix[other, q] = matrix[q, other] = sine * to_p + cosine * to_q
                for row in range(3):
                    along_p, along_q = axes[row, p], axes[row, q]
                    axes[row, p] = cosine * along_p - sine * along_q
                    axes[row, q] = sine * along_p + cosine * along_q


def _depth_from_neighbors(
    depth: npt.NDArray[np.float64], known: npt.NDArray[np.bool_], borders: Borders
) -> npt.NDArray[np.float64]:
    depth = np.where(known, depth, 0.0)
    if known.all():
        return depth
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
        float32 [N, F], columns as in `NODE_NAMES`.
    """
    camera = frame.camera
    features = np.empty((len(regions.sums), NODE_WIDTH), np.float32)
    _node_features(
        regions.sums,
        geometry.centroid,
        geometry.normal,
        geometry.residual,
        frame.depth,
        camera.fx,
        camera.fy,
        regions.nearest,
        regions.farthest,
        features,
    )
    return features


@compiled
def _node_features(  # type: ignore[no-untyped-def]
    sums, centroids, normals, residuals, depth, focal_x, focal_y, nearest, farthest, features
):
    """Fill in the columns of `features`, float32 [N, 21], in the order of `NODE_GROUPS`."""
    height, width = depth.shape
    scene_x = scene_y = scene_z = whole = 0.0
    for region in range(len(sums)):
        pixels = sums[region, PIXELS]
        scene_x += centroids[region, 0] * pixels
        scene_y += centroids[region, 1] * pixels
        scene_z += centroids[region, 2] * pixels
        whole += pixels
    scene_x, scene_y, scene_z = scene_x / whole, scene_y / whole, scene_z / whole
    depth_range = farthest - nearest
    depth_range = 1e-9 if depth_range < 1e-9 else depth_range
    for region in range(len(sums)):
        total, place, feature = sums[region], centroids[region], features[region]
        pixels = total[PIXELS]
        row, column = total[ROW] / pixels, total[COLUMN] / pixels
        feature[AT_POSITION] = column / width
        feature[AT_POSITION + 1] = row / height
        feature[AT_DEPTH] = (place[2] - nearest) / depth_range
        r, c = np.int64(np.rint(row)), np.int64(np.rint(column))
        x = -_slope(depth, r, c, np.int64(0), np.int64(1), focal_x)
        y = -_slope(depth, r, c, np.int64(1), np.int64(0), focal_y)
        length = np.sqrt(x * x + y * y + 1)
        feature[AT_NORMAL] = x / length
        feature[AT_NORMAL + 1] = y / length
        feature[AT_NORMAL + 2] = 1 / length
        feature[AT_XYZ] = place[0] - scene_x
        feature[AT_XYZ + 1] = place[1] - scene_y
        feature[AT_XYZ + 2] = place[2] - scene_z
        for k in range(3):
            color = total[RGB + k] / pixels
            variance = total[RGB_SQUARED + k] / pixels - color * color
            feature[AT_RGB + k] = color / 255
            feature[AT_MEAN_NORMAL + k] = normals[region, k]
            feature[AT_COLOR_SPREAD + k] = np.sqrt(0.0 if variance < 0 else variance) / 255
        feature[AT_SHAPE] = np.log(pixels / (height * width))
        feature[AT_SHAPE + 1] = 1 - total[VALID] / pixels
        feature[AT_SHAPE + 2] = np.log1p(residuals[region] * 1000)


@compiled
def _slope(depth, row, column, down, right, focal):  # type: ignore[no-untyped-def]
    """Return the slope of the depth at a pixel, metres per metre, by central differences; 0 if depth is missing."""
    height, width = depth.shape
    first_row, last_row = row if row < down else row - down, row if row + down >= height else row + down
    first_column, last_column = (
        column if column < right else column - right,
        column if column + right >= width else column + right,
    )
    steps = last_row - first_row + last_column - first_column
    here, low = np.float64(depth[row, column]), np.float64(depth[first_row, first_column])
    high = np.float64(depth[last_row, last_column])
    if steps == 0 or here <= 0 or low <= 0 or high <= 0:
        return 0.0
    # One pixel spans z / focal metres.
    return (high - low) / steps * focal / here


def edge_features(
    pairs: Pairs, borders: Borders, regions: Regions, geometry: Geometry
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Compute all edge features in both directions.

    Args:
        pairs: int64 [2, E], i < j; pairs without a common border have border length 0.
        borders: Sums over the borders.
        regions: Sums over the superpixels.
        geometry: Positions and planes of the superpixels.

    Returns:
        float32 [E, D] for the edges i to j and float32 [E, D] for the edges j to i; columns as in `EDGE_NAMES`.
    """
    sums = sums_of_pairs(pairs, borders)
    forward, backward = np.empty((2, pairs.shape[1], EDGE_WIDTH), np.float32)
    _edge_features(
        np.ascontiguousarray(pairs), sums, regions.sums, geometry.centroid, geometry.normal, forward, backward
    )
    return forward, backward


@compiled
def _edge_features(pairs, borders, sums, centroids, normals, forward, backward):  # type: ignore[no-untyped-def]
    """Fill in the columns of `forward` and `backward`, float32 [E, 11], in the order of `EDGE_GROUPS`."""
    for edge in range(len(forward)):
        i, j = pairs[0, edge], pairs[1, edge]
        border, there, back = borders[edge], forward[edge], backward[edge]
        length, known = border[PAIRS], border[VALID_PAIRS]
        distance = agreement = color_distance = above_i = above_j = bend = 0.0
        for axis in range(3):
            between = centroids[j, axis] - centroids[i, axis]
            normal_i, normal_j = normals[i, axis], normals[j, axis]
            distance += between * between
            agreement += normal_i * normal_j
            above_i += between * normal_i
            above_j -= between * normal_j
            bend += (normal_j - normal_i) * between
            color = (sums[i, RGB + axis] / sums[i, PIXELS] - sums[j, RGB + axis] / sums[j, PIXELS]) / 255
            color_distance += color * color
        distance = np.sqrt(distance)
        pixels = 1.0 if length < 1 else length
        there[AT_BORDER] = np.log1p(length)
        there[AT_DEPTH_STEP] = np.log1p(border[DEPTH_STEP] / (1.0 if known < 1 else known) / DEPTH_STEP_UNIT)
        there[AT_DEPTH_STEP + 1] = np.log1p(border[DEPTH_STEP_MIN] / DEPTH_STEP_UNIT)
        there[AT_DEPTH_STEP + 2] = 1 - known / pixels
        there[AT_GRADIENT] = border[COLOR_STEP] / pixels / 255
        there[AT_CONVEXITY] = bend / (1e-9 if distance < 1e-9 else distance)
        there[AT_CONVEXITY + 1] = agreement
        # Signed logarithms of the signed distances.
        above_i, above_j = above_i / DISTANCE_UNIT, above_j / DISTANCE_UNIT
        there[AT_CONVEXITY + 2] = np.sign(above_i) * np.log1p(abs(above_i))
        there[AT_CONVEXITY + 3] = np.sign(above_j) * np.log1p(abs(above_j))
        there[AT_DISTANCE] = np.log1p(distance / DISTANCE_UNIT)
        there[AT_DISTANCE + 1] = np.sqrt(color_distance)
        for column in range(EDGE_WIDTH):
            back[column] = there[column]
        # In the reverse direction, the two plane distances are swapped.
        back[AT_CONVEXITY + 2], back[AT_CONVEXITY + 3] = there[AT_CONVEXITY + 3], there[AT_CONVEXITY + 2]


def sums_of_pairs(pairs: Pairs, borders: Borders) -> npt.NDArray[np.float64]:
    """Look up the border sums of pairs, with zeros for pairs without a common border.

    Args:
        pairs: int64 [2, E], i < j.
        borders: Sums over the borders.

    Returns:
        float64 [E, 5], columns as in `Borders.sums`.
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
