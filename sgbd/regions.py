"""What one pass over the pixels tells of every superpixel, and of every border between two.

The pass exists twice: as compiled loops, which run wherever Numba is installed, and as NumPy expressions, which run
elsewhere and against which the tests hold the loops.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap, Pairs
from sgbd.compiled import HAS_NUMBA, compiled
from sgbd.frame import Frame
from sgbd.side_by_side import bands, side_by_side, thread_count

# Columns of the sums over a region's pixels. Those from VALID on count only pixels with depth.
PIXELS, RGB, RGB_SQUARED, ROW, COLUMN, VALID, XYZ, XYZ_SQUARED = 0, 1, 4, 7, 8, 9, 10, 13
SUMS = 19

# Columns of the sums over a border's pixel pairs. Those from VALID_PAIRS on count only pairs with depth on both sides.
PAIRS, COLOR_STEP, VALID_PAIRS, DEPTH_STEP, DEPTH_STEP_MIN = range(5)
BORDER_SUMS = 5

MOMENT_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))

# Connected regions in a plane have fewer than three borders each. Only ids that lie about in pieces have more.
BORDERS_PER_REGION = 3


@dataclass(frozen=True)
class Regions:
    """Sums over the pixels of every superpixel.

    Attributes:
        sums: float64 [N, 19], columns as named by the constants of this module: pixel count; sums of red, green, blue
            (0 to 255) and of their squares; of rows and columns; and over the pixels with depth: their count, sums of
            the camera coordinates X, Y, Z (metres) and of their six products XX, XY, XZ, YY, YZ, ZZ.
        nearest: Smallest depth of the frame, metres; 0 where no pixel has depth.
        farthest: Largest depth of the frame, metres.
    """

    sums: npt.NDArray[np.float64]
    nearest: float
    farthest: float

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


def region_and_border_sums(frame: Frame, label_map: LabelMap) -> tuple[Regions, Borders]:
    """Sum colours, positions and camera coordinates over every superpixel, and steps over every border between two.

    Args:
        frame: The frame.
        label_map: int32 [H, W], ids 0..N-1.

    Returns:
        The sums of each superpixel, and every pair of superpixels with a common border with its sums.
    """
    count = int(label_map.max()) + 1
    camera = np.array([frame.camera.fx, frame.camera.fy, frame.camera.cx, frame.camera.cy])
    regions, depth_range, keys, borders = _sums(label_map, frame.rgb, frame.depth, camera, count)
    order = np.argsort(keys)
    keys, borders = keys[order], borders[order]
    nearest, farthest = depth_range
    return Regions(regions, nearest, farthest), Borders(np.stack([keys // count, keys % count]), borders)


def _sums(
    label_map: LabelMap,
    rgb: npt.NDArray[np.uint8],
    depth: npt.NDArray[np.float32],
    camera: npt.NDArray[np.float64],
    count: int,
) -> Any:
    if not HAS_NUMBA:
        slow = sum_regions_numpy(label_map, rgb, depth, camera, count)
        return *slow, *sum_borders_numpy(label_map, rgb, depth, count)
    regions, others = np.zeros((count, SUMS)), np.zeros((count, VALID))
    upper, lower = bands(len(label_map), 2)
    # Every sum of depths is taken by one thread, in one order, in columns of its own. Those of colours are exact in any
    # order, so that they are done in two halves, which leaves two threads with as much to do.
    depth_range, borders, _, _ = side_by_side(
        [
            partial(_sum_depths, label_map, depth, camera, regions),
            partial(_borders, label_map, rgb, depth, count),
            partial(_sum_colors, label_map, rgb, regions, *upper),
            partial(_sum_colors, label_map, rgb, others, *lower),
        ],
        thread_count(),
    )
    regions[:, :VALID] += others
    return regions, depth_range, *borders


def _borders(
    label_map: LabelMap, rgb: npt.NDArray[np.uint8], depth: npt.NDArray[np.float32], count: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    limit = BORDERS_PER_REGION * count
    while True:
        keys, sums, used = _sum_borders(label_map, rgb, depth, count, limit)
        if used <= limit:
            return keys, sums
        limit *= 4


@compiled
def _find_borders(ids, ids_below, right, down):  # type: ignore[no-untyped-def]
    """Find where a step to the right, or down, leads into another superpixel, without a branch.

    Args:
        ids: int32 [W], a row of the label map.
        ids_below: int32 [W], the row below it; [0] for the last row.
        right: int64 [W], written: the columns before such a step to the right.
        down: int64 [W], written: the columns above such a step down.

    Returns:
        How many there are of both.
    """
    rights = downs = 0
    for column in range(len(ids) - 1):
        right[rights] = column
        rights += ids[column] != ids[column + 1]
    for column in range(len(ids_below)):
        down[downs] = column
        downs += ids[column] != ids_below[column]
    return rights, downs


@compiled(fastmath={"reassoc", "contract", "nsz"})
def _sum_colors(label_map, rgb, regions, top, bottom):  # type: ignore[no-untyped-def]
    """Sum up the columns of `Regions.sums` before VALID over the rows `top` to `bottom` - 1.

    They are whole numbers and halves, exact in any order.
    """
    width = label_map.shape[1]
    right, down = np.empty(width, np.int64), np.empty(1, np.int64)
    for row in range(top, bottom):
        rights, _ = _find_borders(label_map[row], label_map[row, :0], right, down)
        # Pixels of one superpixel come in runs: sum a run in registers, then add it once.
        first = 0
        for run in range(rights + 1):
            last = right[run] if run < rights else width - 1
            red = green = blue = red_squared = green_squared = blue_squared = 0
            for column in range(first, last + 1):
                r, g, b = int(rgb[row, column, 0]), int(rgb[row, column, 1]), int(rgb[row, column, 2])
                red += r
                green += g
                blue += b
                red_squared += r * r
                green_squared += g * g
                blue_squared += b * b
            length = last + 1 - first
            region = label_map[row, first]
            regions[region, PIXELS] += length
            regions[region, RGB] += red
            regions[region, RGB + 1] += green
            regions[region, RGB + 2] += blue
            regions[region, RGB_SQUARED] += red_squared
            regions[region, RGB_SQUARED + 1] += green_squared
            regions[region, RGB_SQUARED + 2] += blue_squared
            regions[region, ROW] += row * length
            regions[region, COLUMN] += length * (first + last) / 2
            first = last + 1


@compiled(fastmath={"reassoc", "contract", "nsz"})
def _sum_depths(label_map, depth, camera, regions):  # type: ignore[no-untyped-def]
    """Sum up the columns of `Regions.sums` from VALID on, and return the smallest and largest depth."""
    height, width = label_map.shape
    fx, fy, cx, cy = camera
    x_slopes = (np.arange(width) - cx) / fx
    nearest, farthest = np.inf, 0.0
    right, down = np.empty(width, np.int64), np.empty(1, np.int64)
    for row in range(height):
        rights, _ = _find_borders(label_map[row], label_map[row, :0], right, down)
        # Missing depth is 0 and adds nothing but to the count; Y is y_slope * Z throughout the row, so that its sums
        # need no loop.
        y_slope = (row - cy) / fy
        first = 0
        for run in range(rights + 1):
            last = right[run] if run < rights else width - 1
            valid = 0
            x_sum = z_sum = xx_sum = xz_sum = zz_sum = 0.0
            for column in range(first, last + 1):
                z = np.float64(depth[row, column])
                x = x_slopes[column] * z
                valid += int(z > 0)
                x_sum += x
                z_sum += z
                xx_sum += x * x
                xz_sum += x * z
                zz_sum += z * z
                farthest = max(farthest, z)
                nearest = min(nearest, z if z > 0 else np.inf)
            region = label_map[row, first]
            regions[region, VALID] += valid
            regions[region, XYZ] += x_sum
            regions[region, XYZ + 1] += y_slope * z_sum
            regions[region, XYZ + 2] += z_sum
            regions[region, XYZ_SQUARED] += xx_sum
            regions[region, XYZ_SQUARED + 1] += y_slope * xz_sum
            regions[region, XYZ_SQUARED + 2] += xz_sum
            regions[region, XYZ_SQUARED + 3] += y_slope * y_slope * zz_sum
            regions[region, XYZ_SQUARED + 4] += y_slope * zz_sum
            regions[region, XYZ_SQUARED + 5] += zz_sum
            first = last + 1
    return (nearest if farthest > 0 else 0.0), farthest


@compiled(fastmath={"reassoc", "contract", "nsz"})
def _sum_borders(label_map, rgb, depth, count, limit):  # type: ignore[no-untyped-def]
    """Sum over borders; a number of borders above `limit` says that they did not fit."""
    height, width = label_map.shape
    # An open-addressing hash table from the keys of borders to rows of their sums, at most half full.
    capacity = 16
    while capacity < 2 * limit:
        capacity *= 2
    table = np.full(capacity, -1)
    keys, borders = np.empty(limit, np.int64), np.zeros((limit, BORDER_SUMS))
    used = 0
    last_key, border = np.int64(-1), 0
    right, down = np.empty(width, np.int64), np.empty(width, np.int64)
    for row in range(height):
        below = label_map[row + 1] if row + 1 < height else label_map[row, :0]
        rights, downs = _find_borders(label_map[row], below, right, down)
        for step in range(rights + downs):
            is_down = step >= rights
            column = down[step - rights] if is_down else right[step]
            next_row, next_column = row + is_down, column + 1 - is_down
            a, b = label_map[row, column], label_map[next_row, next_column]
            key = np.int64(min(a, b)) * count + max(a, b)
            # Steps side by side mostly cross the same border.
            if key != last_key:
                last_key = key
                slot = (key * 0x9E3779B1 >> 7) & (capacity - 1)
                while table[slot] >= 0 and keys[table[slot]] != key:
                    slot = (slot + 1) & (capacity - 1)
                border = table[slot]
                if border < 0:
                    if used == limit:
                        return keys, borders, limit + 1
                    border = used
                    table[slot] = used
                    keys[used] = key
                    used += 1
            distance = 0
            for k in range(3):
                difference = int(rgb[row, column, k]) - int(rgb[next_row, next_column, k])
                distance += difference * difference
            borders[border, PAIRS] += 1
            borders[border, COLOR_STEP] += np.sqrt(np.float64(distance))
            z, next_z = np.float64(depth[row, column]), np.float64(depth[next_row, next_column])
            if z > 0 and next_z > 0:
                jump = abs(z - next_z)
                if borders[border, VALID_PAIRS] == 0 or jump < borders[border, DEPTH_STEP_MIN]:
                    borders[border, DEPTH_STEP_MIN] = jump
                borders[border, VALID_PAIRS] += 1
                borders[border, DEPTH_STEP] += jump
    return keys[:used].copy(), borders[:used].copy(), used


def sum_regions_numpy(
    label_map: LabelMap,
    rgb: npt.NDArray[np.uint8],
    depth: npt.NDArray[np.float32],
    camera: npt.NDArray[np.float64],
    count: int,
) -> tuple[npt.NDArray[np.float64], tuple[float, float]]:
    """Sum over regions with one `numpy.bincount` a column; see `Regions` for the sums, and the range of the depth."""
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
    columns_of_sums = [np.bincount(flat, weight.ravel(), count) for weight in weights]
    sums = np.stack(columns_of_sums, axis=1).astype(np.float64, copy=False)
    known = z[z > 0]
    return sums, (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)


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
