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
    x_slopes = (np.arange(width) - cx) / fx
    for row in range(height):
        y_slope = (row - cy) / fy
        column = 0
        while column < width:
            # Pixels of one superpixel come in runs: sum a run in registers, then add it once. Missing depth is 0 and
            # adds nothing but to the count; Y is y_slope * Z throughout the row, so that its sums need no loop.
            region = label_map[row, column]
            first = column
            red = green = blue = red_squared = green_squared = blue_squared = valid = 0
            x_sum = z_sum = xx_sum = xz_sum = zz_sum = 0.0
            while column < width and label_map[row, column] == region:
                r, g, b = int(rgb[row, column, 0]), int(rgb[row, column, 1]), int(rgb[row, column, 2])
                red += r
                green += g
                blue += b
                red_squared += r * r
                green_squared += g * g
                blue_squared += b * b
                z = np.float64(depth[row, column])
                x = x_slopes[column] * z
                valid += int(z > 0)
                x_sum += x
                z_sum += z
                xx_sum += x * x
                xz_sum += x * z
                zz_sum += z * z
                column += 1
            length = column - first
            sums[region, PIXELS] += length
            sums[region, RGB] += red
            sums[region, RGB + 1] += green
            sums[region, RGB + 2] += blue
            sums[region, RGB_SQUARED] += red_squared
            sums[region, RGB_SQUARED + 1] += green_squared
            sums[region, RGB_SQUARED + 2] += blue_squared
            sums[region, ROW] += row * length
            sums[region, COLUMN] += length * (first + column - 1) / 2
            sums[region, VALID] += valid
            sums[region, XYZ] += x_sum
            sums[region, XYZ + 1] += y_slope * z_sum
            sums[region, XYZ + 2] += z_sum
            sums[region, XYZ_SQUARED] += xx_sum
            sums[region, XYZ_SQUARED + 1] += y_slope * xz_sum
            sums[region, XYZ_SQUARED + 2] += xz_sum
            sums[region, XYZ_SQUARED + 3] += y_slope * y_slope * zz_sum
            sums[region, XYZ_SQUARED + 4] += y_slope * zz_sum
            sums[region, XYZ_SQUARED + 5] += zz_sum
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
    width = label_map.shape[1]
    steps = _steps_across_borders(label_map)
    # An open-addressing hash table from border keys to rows of sums. There are no more borders than steps across them,
    # so that it is never more than half full and no array changes in the loop, which compilers reward.
    capacity = 16
    while capacity < 2 * len(steps):
        capacity *= 2
    table = np.full(capacity, -1)
    keys, sums = np.empty(len(steps), np.int64), np.zeros((len(steps), BORDER_SUMS))
    used = 0
    for step in steps:
        pixel, down = step >> 1, step & 1
        row, column = pixel // width, pixel % width
        next_row, next_column = row + down, column + 1 - down
        a, b = label_map[row, column], label_map[next_row, next_column]
        key = np.int64(min(a, b)) * count + max(a, b)
        slot = (key * 0x9E3779B1 >> 7) & (capacity - 1)
        while table[slot] >= 0 and keys[table[slot]] != key:
            slot = (slot + 1) & (capacity - 1)
        border = table[slot]
        if border < 0:
            border = used
            table[slot] = used
            keys[used] = key
            used += 1
        distance = 0
        for k in range(3):
            difference = int(rgb[row, column, k]) - int(rgb[next_row, next_column, k])
            distance += difference * difference
        sums[border, PAIRS] += 1
        sums[border, COLOR_STEP] += np.sqrt(np.float64(distance))
        z, next_z = np.float64(depth[row, column]), np.float64(depth[next_row, next_column])
        if z > 0 and next_z > 0:
            jump = abs(z - next_z)
            if sums[border, VALID_PAIRS] == 0 or jump < sums[border, DEPTH_STEP_MIN]:
                sums[border, DEPTH_STEP_MIN] = jump
            sums[border, VALID_PAIRS] += 1
            sums[border, DEPTH_STEP] += jump
    return keys[:used].copy(), sums[:used].copy()


@compiled
def _steps_across_borders(label_map):  # type: ignore[no-untyped-def]
    """Find the steps that lead into another superpixel: twice the pixel's index, plus 1 for down instead of right."""
    height, width = label_map.shape
    # Memory that is never written to costs nothing.
    steps = np.empty(2 * height * width, np.int64)
    count = 0
    for row in range(height):
        for column in range(width - 1):
            if label_map[row, column] != label_map[row, column + 1]:
                steps[count] = 2 * (row * width + column)
                count += 1
        if row + 1 < height:
            for column in range(width):
                if label_map[row, column] != label_map[row + 1, column]:
                    steps[count] = 2 * (row * width + column) + 1
                    count += 1
    return steps[:count]


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
