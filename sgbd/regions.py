"""Statistics of every superpixel and of every border between two superpixels, from one pass over the pixels.

The pass is implemented twice: as compiled loops, used if Numba is installed, and in NumPy, used otherwise and as the
reference in the tests.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap, Pairs
from sgbd.frame import Frame
from sgbd.machine.compiled import HAS_NUMBA, compiled
from sgbd.machine.side_by_side import bands, side_by_side, thread_count

# Columns of the sums over a region's pixels. Columns from VALID on only include pixels with depth.
PIXELS, RGB, RGB_SQUARED, ROW, COLUMN, VALID, XYZ, XYZ_SQUARED = 0, 1, 4, 7, 8, 9, 10, 13
SUMS = 19

# Columns of the sums over a border's pixel pairs. Columns from VALID_PAIRS on only include pairs with depth on both
# sides.
PAIRS, COLOR_STEP, VALID_PAIRS, DEPTH_STEP, DEPTH_STEP_MIN = range(5)
BORDER_SUMS = 5

MOMENT_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))

# A planar graph has fewer than three edges per node. Only disconnected regions can exceed this.
BORDERS_PER_REGION = 3


@dataclass(frozen=True)
class Regions:
    """Sums over the pixels of every superpixel.

    Attributes:
        sums: float64 [N, 19], columns named by the constants of this module: pixel count; sums of red, green and blue
            (0 to 255), of their squares, of rows and of columns; then, over the pixels with depth, their count, the
            sums of the camera coordinates X, Y, Z (metres) and of their six products XX, XY, XZ, YY, YZ, ZZ.
        nearest: Smallest depth of the frame, metres; 0 if no pixel has depth.
        farthest: Largest depth of the frame, metres; 0 if no pixel has depth.
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
        """Number of pixels with depth of every superpixel, float64 [N]."""
        return self.sums[:, VALID]


@dataclass(frozen=True)
class Borders:
    """Sums over the adjacent pixel pairs across every border.

    Attributes:
        pairs: int64 [2, E], the superpixels on both sides, i < j, sorted.
        sums: float64 [E, 5]: number of pixel pairs; sum of their colour distances (Euclidean, RGB 0 to 255); number of
            pairs with depth on both sides; sum and minimum of the depth steps of those pairs (metres, 0 if there are
            none).
    """

    pairs: Pairs
    sums: npt.NDArray[np.float64]


def region_and_border_sums(frame: Frame, label_map: LabelMap) -> tuple[Regions, Borders]:
    """Sum colours, positions and camera coordinates over superpixels, and colour and depth steps over borders.

    Args:
        frame: The frame.
        label_map: int32 [H, W], ids 0..N-1.

    Returns:
        The sums of each superpixel; the pairs of superpixels that share a border, and the sums of each border.
    """
    count = int(label_map.max()) + 1
    camera = np.array([frame.camera.fx, frame.camera.fy, frame.camera.cx, frame.camera.cy])
    regions, depth_range, keys, borders = _sums(label_map, frame.rgb, frame.depth, camera, count)
    order = np.argsort(keys)
    keys, borders = keys[order], borders[order]
    nearest, farthest = depth_range
    return Regions(regions, nearest, farthest), Borders(np.stack([keys // count, keys % count]), borders)


def merged_sums(sums: tuple[Regions, Borders], segment: npt.NDArray[np.int64]) -> tuple[Regions, Borders]:
    """Return the sums of segments of superpixels, without another pass over the pixels.

    Args:
        sums: The sums of the superpixels, from `region_and_border_sums`.
        segment: int64 [N], the segment of each superpixel, 0..S-1, each present.

    Returns:
        What `region_and_border_sums` returns for the map of the segments, up to rounding.
    """
    regions, borders = sums
    count = int(segment.max()) + 1
    columns = [np.bincount(segment, column, count).astype(np.float64) for column in regions.sums.T]
    ends = np.sort(segment[borders.pairs], axis=0)
    between = ends[0] != ends[1]
    keys, place = np.unique(ends[0, between] * count + ends[1, between], return_inverse=True)
    apart = borders.sums[between]
    merged = np.stack([np.bincount(place, column, len(keys)).astype(np.float64) for column in apart.T], axis=1)
    smallest = np.full(len(keys), np.inf)
    np.minimum.at(smallest, place, np.where(apart[:, VALID_PAIRS] > 0, apart[:, DEPTH_STEP_MIN], np.inf))
    merged[:, DEPTH_STEP_MIN] = np.where(np.isfinite(smallest), smallest, 0.0)
    of_segments = Regions(np.stack(columns, axis=1), regions.nearest, regions.farthest)
    return of_segments, Borders(np.stack(np.divmod(keys, count)), merged)


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
    width = label_map.shape[1]
    slopes = (np.arange(width) - camera[2]) / camera[0]
    # Depth sums depend on the order of summation, so a single thread computes them, in its own columns. Colour sums are
    # exact in any order, so they are split into two halves, which balances the load of two threads.
    depth_range, borders, _, _ = side_by_side(
        [
            partial(_sum_depths, label_map, depth, camera, slopes, np.empty(width, np.int64), regions),
            partial(_borders, label_map, rgb, depth, count),
            partial(_sum_colors, label_map, rgb, np.empty(width, np.int64), regions, *upper),
            partial(_sum_colors, label_map, rgb, np.empty(width, np.int64), others, *lower),
        ],
        thread_count(),
    )
    regions[:, :VALID] += others
    return regions, depth_range, *borders


def _borders(
    label_map: LabelMap, rgb: npt.NDArray[np.uint8], depth: npt.NDArray[np.float32], count: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    limit = BORDERS_PER_REGION * count
    right, down = np.empty((2, label_map.shape[1]), np.int64)
    while True:
        # Keep the hash table at most half full.
        table = np.full(max(16, 1 << (2 * limit - 1).bit_length()), -1)
        keys, sums = np.empty(limit, np.int64), np.zeros((limit, BORDER_SUMS))
        used = _sum_borders(label_map, rgb, depth, count, right, down, table, keys, sums)
        if used <= limit:
            return keys[:used].copy(), sums[:used].copy()
        limit *= 4


@compiled
def _find_steps(ids, others, count, steps):  # type: ignore[no-untyped-def]
    """Find the pixels of a row whose right or lower neighbour belongs to another superpixel, without branching.

    Args:
        ids: int32 [W], a row of the label map.
        others: int32 [at least count], the neighbour of each pixel: the same row from its second pixel on, or the row
            below.
        count: Number of pixels to check.
        steps: int64 [W], output: the columns of these pixels.

    Returns:
        The number of these pixels.
    """
    found = np.int64(0)
    for column in range(count):
        steps[found] = column
        found += ids[column] != others[column]
    return found


@compiled(fastmath={"reassoc", "contract", "nsz"})
def _sum_colors(label_map, rgb, right, regions, top, bottom):  # type: ignore[no-untyped-def]
    """Add rows `top` to `bottom` - 1 to the columns of `Regions.sums` before VALID.

    All terms are multiples of 1/2, so the sums are exact in any order.
    """
    width = label_map.shape[1]
    for row in range(top, bottom):
        ids, colors = label_map[row], rgb[row]
        rights = _find_steps(ids, ids[1:], width - 1, right)
        # Sum each run of pixels of one superpixel in registers, then add it once.
        first = 0
        for run in range(rights + 1):
            last = right[run] if run < rights else width - 1
            red = green = blue = red_squared = green_squared = blue_squared = np.int64(0)
            for column in range(first, last + 1):
                r, g, b = np.int64(colors[column, 0]), np.int64(colors[column, 1]), np.int64(colors[column, 2])
                red += r
                green += g
                blue += b
                red_squared += r * r
                green_squared += g * g
                blue_squared += b * b
            length = last + 1 - first
            total = regions[ids[first]]
            total[PIXELS] += length
            total[RGB] += red
            total[RGB + 1] += green
            total[RGB + 2] += blue
            total[RGB_SQUARED] += red_squared
            total[RGB_SQUARED + 1] += green_squared
            total[RGB_SQUARED + 2] += blue_squared
            total[ROW] += row * length
            total[COLUMN] += length * (first + last) / 2
            first = last + 1


@compiled(fastmath={"reassoc", "contract", "nsz"})
def _sum_depths(label_map, depth, camera, x_slopes, right, regions):  # type: ignore[no-untyped-def]
    """Fill the columns of `Regions.sums` from VALID on, and return the smallest and the largest depth."""
    height, width = label_map.shape
    nearest, farthest = np.inf, 0.0
    for row in range(height):
        ids, line = label_map[row], depth[row]
        rights = _find_steps(ids, ids[1:], width - 1, right)
        # Missing depth is 0 and adds nothing to the sums. Y is y_slope * Z throughout a row, so the sums of Y follow
        # from those of Z.
        y_slope = (row - camera[3]) / camera[1]
        first = 0
        for run in range(rights + 1):
            last = right[run] if run < rights else width - 1
            valid = np.int64(0)
            x_sum = z_sum = xx_sum = xz_sum = zz_sum = 0.0
            for column in range(first, last + 1):
                z = np.float64(line[column])
                x = x_slopes[column] * z
                valid += z > 0
                x_sum += x
                z_sum += z
                xx_sum += x * x
                xz_sum += x * z
                zz_sum += z * z
                farthest = max(farthest, z)
                nearest = min(nearest, z if z > 0 else np.inf)
            total = regions[ids[first]]
            total[VALID] += valid
            total[XYZ] += x_sum
            total[XYZ + 1] += y_slope * z_sum
            total[XYZ + 2] += z_sum
            total[XYZ_SQUARED] += xx_sum
            total[XYZ_SQUARED + 1] += y_slope * xz_sum
            total[XYZ_SQUARED + 2] += xz_sum
            total[XYZ_SQUARED + 3] += y_slope * y_slope * zz_sum
            total[XYZ_SQUARED + 4] += y_slope * zz_sum
            total[XYZ_SQUARED + 5] += zz_sum
            first = last + 1
    return (nearest if farthest > 0 else 0.0), farthest


@compiled(fastmath={"reassoc", "contract", "nsz"})
def _sum_borders(label_map, rgb, depth, count, right, down, table, keys, borders):  # type: ignore[no-untyped-def]
    """Compute the sums of `Borders` with a hash table.

    Args:
        label_map: int32 [H, W].
        rgb: uint8 [H, W, 3].
        depth: float32 [H, W].
        count: Number of superpixels.
        right: int64 [W], workspace.
        down: int64 [W], workspace.
        table: int64 [a power of two] of -1, workspace: hash table from border keys to rows of `borders`.
        keys: int64 [limit], output: i * count + j of each border.
        borders: float64 [limit, 5] of zeros, output: the sums of each border.

    Returns:
        The number of borders, or limit + 1 if there are more than `limit`.
    """
    height, width = label_map.shape
    limit, slots = len(keys), len(table) - 1
    used = np.int64(0)
    last_key, border = np.int64(-1), np.int64(0)
    for row in range(height):
        ids = label_map[row]
        rights = _find_steps(ids, ids[1:], width - 1, right)
        downs = _find_steps(ids, label_map[row + 1], width, down) if row + 1 < height else np.int64(0)
        for step in range(rights + downs):
            is_down = step >= rights
            column = down[step - rights] if is_down else right[step]
            next_row, next_column = row + is_down, column + 1 - is_down
            a, b = np.int64(ids[column]), np.int64(label_map[next_row, next_column])
            key = a * count + b if a < b else b * count + a
            # Consecutive steps mostly cross the same border.
            if key != last_key:
                last_key = key
                slot = (key * 0x9E3779B1 >> 7) & slots
                while table[slot] >= 0 and keys[table[slot]] != key:
                    slot = (slot + 1) & slots
                border = table[slot]
                if border < 0:
                    if used == limit:
                        return limit + 1
                    border = used
                    table[slot] = used
                    keys[used] = key
                    used += 1
            distance, color, next_color = np.int64(0), rgb[row, column], rgb[next_row, next_column]
            for k in range(3):
                difference = np.int64(color[k]) - np.int64(next_color[k])
                distance += difference * difference
            total = borders[border]
            total[PAIRS] += 1
            total[COLOR_STEP] += np.sqrt(np.float64(distance))
            z, next_z = np.float64(depth[row, column]), np.float64(depth[next_row, next_column])
            if z > 0 and next_z > 0:
                jump = abs(z - next_z)
                if total[VALID_PAIRS] == 0 or jump < total[DEPTH_STEP_MIN]:
                    total[DEPTH_STEP_MIN] = jump
                total[VALID_PAIRS] += 1
                total[DEPTH_STEP] += jump
    return used


def sum_regions_numpy(
    label_map: LabelMap,
    rgb: npt.NDArray[np.uint8],
    depth: npt.NDArray[np.float32],
    camera: npt.NDArray[np.float64],
    count: int,
) -> tuple[npt.NDArray[np.float64], tuple[float, float]]:
    """Compute `Regions.sums` with one `numpy.bincount` per column, and the smallest and the largest depth."""
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
    """Compare shifted label maps; return keys i * N + j [E], sorted, and `Borders.sums` in the same order."""
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
