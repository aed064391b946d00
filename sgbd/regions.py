"""What one pass over the pixels tells of every superpixel, and of every border between two.

Both passes exist twice: as compiled loops, which run wherever Numba is installed, and as NumPy expressions, which run
elsewhere and against which the tests hold the loops.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap, Pairs
from sgbd.compiled import HAS_NUMBA, compiled
from sgbd.frame import Frame

# Columns of the sums over a region's pixels. Those from VALID on count only pixels with depth.
PIXELS, RGB, RGB_SQUARED, ROW, COLUMN, VALID, XYZ, XYZ_SQUARED = 0, 1, 4, 7, 8, 9, 10, 13
SUMS = 19

# Columns of the sums over a border's pixel pairs. Those from VALID_PAIRS on count only pairs with depth on both sides.
PAIRS, COLOR_STEP, VALID_PAIRS, DEPTH_STEP, DEPTH_STEP_MIN = range(5)
BORDER_SUMS = 5

MOMENT_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True)
class Regions:
    """Sums over the pixels of every superpixel.

    Attributes:
        sums: float64 [N, 19], columns as named by the constants of this module: pixel count; sums of red, green, blue
            (0 to 255) and of their squares; of rows and columns; and over the pixels with depth: their count, sums of
            the camera coordinates X, Y, Z (metres) and of their six products XX, XY, XZ, YY, YZ, ZZ.
    """

    sums: npt.NDArray[np.float64]

    @property
    def pixels(self) -> npt.NDArray[np.float64]:
        """Area of every superpixel, float64 [N]."""
        return self.sums[:, PIXELS]

    @property
    def valid(self) -> npt.NDArray[np.float64]:
        """Pixels with depth of every superpixel, float64 [N]."""
        return self.sums[:, VALID]


@dataclass(frozen=True)
class Borders:
    """Sums over the pixel pairs on both sides of every border.

    Attributes:
        pairs: int64 [2, E], the superpixels on both sides, i < j, sorted.
        sums: float64 [E, 5]: number of pixel pairs; sum of their colour distances (Euclidean, RGB 0 to 255); number of
            pairs with depth on both sides; over those, sum and minimum of the depth steps (metres, 0 where none).
    """

    pairs: Pairs
    sums: npt.NDArray[np.float64]


def region_sums(frame: Frame, label_map: LabelMap) -> Regions:
    """Sum colours, positions and camera coordinates over every superpixel.

    Args:
        frame: The frame.
        label_map: int32 [H, W], ids 0..N-1.

    Returns:
        The sums of each superpixel.
    """
    count = int(label_map.max()) + 1
    camera = np.array([frame.camera.fx, frame.camera.fy, frame.camera.cx, frame.camera.cy])
    pass_over_pixels: Any = _sum_regions_compiled if HAS_NUMBA else sum_regions_numpy
    return Regions(pass_over_pixels(label_map, frame.rgb, frame.depth, camera, count))


def border_sums(frame: Frame, label_map: LabelMap) -> Borders:
    """Sum colour and depth steps over every border between two superpixels.

    Args:
        frame: The frame.
        label_map: int32 [H, W], ids 0..N-1.

    Returns:
        Every pair of superpixels with a common border, and its sums.
    """
    count = int(label_map.max()) + 1
    pass_over_pixels: Any = _sum_borders_compiled if HAS_NUMBA else sum_borders_numpy
    keys, sums = pass_over_pixels(label_map, frame.rgb, frame.depth, count)
    order = np.argsort(keys)
    keys, sums = keys[order], sums[order]
    return Borders(np.stack([keys // count, keys % count]), sums)


@compiled
def _sum_regions_compiled(label_map, rgb, depth, camera, count):  # type: ignore[no-untyped-def]
    height, width = label_map.shape
    sums = np.zeros((count, SUMS))
    fx, fy, cx, cy = camera
    run = np.zeros(SUMS)
    for row in range(height):
        y_slope = (row - cy) / fy
        column = 0
        while column < width:
            # Pixels of one superpixel come in runs: sum a run in registers, then add it once.
            region = label_map[row, column]
            run[:] = 0.0
            first = column
            red = green = blue = red_squared = green_squared = blue_squared = 0
            while column < width and label_map[row, column] == region:
                r, g, b = int(rgb[row, column, 0]), int(rgb[row, column, 1]), int(rgb[row, column, 2])
                red += r
                green += g
                blue += b
                red_squared += r * r
                green_squared += g * g
                blue_squared += b * b
                z = np.float64(depth[row, column])
                if z > 0:
                    x = (column - cx) / fx * z
                    y = y_slope * z
                    run[VALID] += 1
                    run[XYZ] += x
                    run[XYZ + 1] += y
                    run[XYZ + 2] += z
                    run[XYZ_SQUARED] += x * x
                    run[XYZ_SQUARED + 1] += x * y
                    run[XYZ_SQUARED + 2] += x * z
                    run[XYZ_SQUARED + 3] += y * y
                    run[XYZ_SQUARED + 4] += y * z
                    run[XYZ_SQUARED + 5] += z * z
                column += 1
            length = column - first
            run[PIXELS] = length
            run[RGB], run[RGB + 1], run[RGB + 2] = red, green, blue
            run[RGB_SQUARED], run[RGB_SQUARED + 1], run[RGB_SQUARED + 2] = red_squared, green_squared, blue_squared
            run[ROW] = row * length
            run[COLUMN] = length * (first + column - 1) / 2
            for k in range(SUMS):
                sums[region, k] += run[k]
    return sums


def sum_regions_numpy(
    label_map: LabelMap,
    rgb: npt.NDArray[np.uint8],
    depth: npt.NDArray[np.float32],
    camera: npt.NDArray[np.float64],
    count: int,
) -> npt.NDArray[np.float64]:
    """Sum over regions with one `numpy.bincount` a column; see `Regions` for the result."""
    fx, fy, cx, cy = camera
    rows, columns = np.indices(label_map.shape, dtype=np.float64)
    z = depth.astype(np.float64)
    xyz = [(columns - cx) / fx * z, (rows - cy) / fy * z, z]
    colors = [rgb[..., k].astype(np.float64) for k in range(3)]
    weights = [
        np.ones(label_map.shape),
        *colors,
        *(color * color for color in colors),
        rows,
        columns,
        (z > 0).astype(np.float64),
        *xyz,
        *(xyz[a] * xyz[b] for a, b in MOMENT_PAIRS),
    ]
    flat = label_map.ravel()
    return np.stack([np.bincount(flat, weight.ravel(), count) for weight in weights], axis=1)


@compiled
def _sum_borders_compiled(label_map, rgb, depth, count):  # type: ignore[no-untyped-def]
    height, width = label_map.shape
    # Connected regions in a plane have fewer than three borders each; the table grows for maps that break that rule.
    capacity = 16
    while capacity < 8 * count:
        capacity *= 2
    table, keys, sums, used = _empty_table(capacity)
    for row in range(height):
        for column in range(width):
            a = label_map[row, column]
            for direction in range(2):
                next_row, next_column = (row, column + 1) if direction == 0 else (row + 1, column)
                if next_row == height or next_column == width:
                    continue
                b = label_map[next_row, next_column]
                if a == b:
                    continue
                if 2 * used >= len(table):
                    table, keys, sums = _grown_table(table, keys, sums, used)
                key = np.int64(min(a, b)) * count + max(a, b)
                slot = _slot(table, keys, key)
                border = table[slot]
                if border < 0:
                    border = used
                    table[slot] = used
                    keys[used] = key
                    used += 1
                distance = 0.0
                for k in range(3):
                    step = np.float64(rgb[row, column, k]) - np.float64(rgb[next_row, next_column, k])
                    distance += step * step
                sums[border, PAIRS] += 1
                sums[border, COLOR_STEP] += np.sqrt(distance)
                z, next_z = depth[row, column], depth[next_row, next_column]
                if z > 0 and next_z > 0:
                    jump = abs(np.float64(z) - np.float64(next_z))
                    if sums[border, VALID_PAIRS] == 0 or jump < sums[border, DEPTH_STEP_MIN]:
                        sums[border, DEPTH_STEP_MIN] = jump
                    sums[border, VALID_PAIRS] += 1
                    sums[border, DEPTH_STEP] += jump
    return keys[:used], sums[:used]


@compiled
def _empty_table(capacity):  # type: ignore[no-untyped-def]
    """An open-addressing hash table from border keys to rows of sums; it is kept at most half full."""
    half = capacity // 2 + 1
    return np.full(capacity, -1), np.empty(half, np.int64), np.zeros((half, BORDER_SUMS)), 0


@compiled
def _slot(table, keys, key):  # type: ignore[no-untyped-def]
    slot = (key * 0x9E3779B1 >> 7) & (len(table) - 1)
    while table[slot] >= 0 and keys[table[slot]] != key:
        slot = (slot + 1) & (len(table) - 1)
    return slot


@compiled
def _grown_table(table, keys, sums, used):  # type: ignore[no-untyped-def]
    grown, grown_keys, grown_sums, _ = _empty_table(2 * len(table))
    for border in range(used):
        grown[_slot(grown, keys, keys[border])] = border
        grown_keys[border] = keys[border]
        grown_sums[border] = sums[border]
    return grown, grown_keys, grown_sums


def sum_borders_numpy(
    label_map: LabelMap,
    rgb: npt.NDArray[np.uint8],
    depth: npt.NDArray[np.float32],
    count: int,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """Sum over borders with shifted comparison; keys i * N + j [E] and sums as of `Borders`, in order of the keys."""
    keys, color_steps, depths = [], [], []
    for first, second in (
        (np.s_[:, :-1], np.s_[:, 1:]),
        (np.s_[:-1, :], np.s_[1:, :]),
    ):
        a, b = label_map[first], label_map[second]
        border = a != b
        a, b = a[border].astype(np.int64), b[border].astype(np.int64)
        keys.append(np.minimum(a, b) * count + np.maximum(a, b))
        step = rgb[first][border].astype(np.float64) - rgb[second][border]
        color_steps.append(np.sqrt((step * step).sum(axis=1)))
        depths.append(np.stack([depth[first][border], depth[second][border]]).astype(np.float64))
    unique, index, lengths = np.unique(np.concatenate(keys), return_inverse=True, return_counts=True)
    z, next_z = np.concatenate(depths, axis=1)
    valid = (z > 0) & (next_z > 0)
    jump = np.abs(z - next_z)
    smallest = np.full(len(unique), np.inf)
    np.minimum.at(smallest, index[valid], jump[valid])
    sums = np.stack(
        [
            lengths.astype(np.float64),
            np.bincount(index, np.concatenate(color_steps), len(unique)),
            np.bincount(index, valid, len(unique)),
            np.bincount(index, np.where(valid, jump, 0.0), len(unique)),
            np.where(np.isfinite(smallest), smallest, 0.0),
        ],
        axis=1,
    )
    return unique, sums
