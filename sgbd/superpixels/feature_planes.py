"""The planes in which SLIC compares pixels: smoothed Lab colours and scaled depth, computed by compiled loops.

Source of the conversion: IEC 61966-2-1 (sRGB) and CIE 15 (L*a*b*, D65), as `skimage.color.rgb2lab` has them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from sgbd.machine.compiled import compiled
from sgbd.machine.reused_memory import reused
from sgbd.superpixels.local_k_means import Planes

# Linear sRGB to XYZ, relative to the white point D65 (2 degrees).
_XYZ = np.array([[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]])
TO_XYZ = (_XYZ / np.array([[0.95047], [1.0], [1.08883]])).astype(np.float32)

TRUNCATE = 3.0
"""The Gaussian is cut off at this many standard deviations."""

FARTHEST = 65535
"""Depth is clipped here, millimetres: the largest value of a 16-bit depth image."""


def linear_intensities(rgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
    """Tabulate the linear intensity of the 256 values of a channel, after stretching the image to its full range.

    Args:
        rgb: uint8 [H, W, 3].

    Returns:
        float32 [256], in [0, 1] for values that occur in the image.
    """
    low, high = int(rgb.min()), int(rgb.max())
    value = np.clip((np.arange(256) - low) / max(high - low, 1), 0, 1)
    return np.where(value > 0.04045, ((value + 0.055) / 1.055) ** 2.4, value / 12.92).astype(np.float32)


def gaussian_weights(sigma: float) -> npt.NDArray[np.float32]:
    """Return one half of a Gaussian, float32 [radius + 1], from its centre outwards; the whole kernel sums to 1."""
    radius = int(TRUNCATE * sigma + 0.5)
    weights = np.exp(-0.5 * (np.arange(radius + 1) / max(sigma, 1e-6)) ** 2)
    return (weights / (weights[0] + 2 * weights[1:].sum())).astype(np.float32)


def color_memory(shape: tuple[int, int]) -> Planes:
    """Return memory for the colours of an image of this height and width before smoothing, float32 [3, H, W]."""
    planes: Planes = reused("lab", (3, *shape), np.float32)
    return planes


def label_memory(shape: tuple[int, int], count: int, used: Planes) -> list[npt.NDArray[np.int32]]:
    """Return memory for label maps: that of the colours before smoothing, unless they are still used.

    Args:
        shape: Height and width of the image, pixels.
        count: Number of label maps, at most 3.
        used: The planes that are still used.

    Returns:
        int32 [H, W], uninitialised, for each label map; the next call returns the same memory.
    """
    free = color_memory(shape)
    if np.may_share_memory(free, used):
        free = reused("labels", free.shape, np.float32)
    return list(free.view(np.int32)[:count])


def lab_jobs(
    rgb: npt.NDArray[np.uint8], compactness: float, planes: Planes, rows: Sequence[tuple[int, int]]
) -> list[Callable[[], None]]:
    """Return jobs that convert an image to Lab, one for each band of rows.

    Args:
        rgb: uint8 [H, W, 3].
        compactness: L, a and b are divided by this.
        planes: float32 [3, H, W], written by the jobs.
        rows: First row of each band, and the row after its last.
    """
    intensities, scale = linear_intensities(rgb), np.float32(1 / compactness)
    jobs: list[Callable[[], None]] = []
    for band in rows:
        scratch = np.empty((4, rgb.shape[1]), np.float32)
        views = scratch, scratch[3].view(np.int32), planes, planes.view(np.int32)
        jobs.append(partial(_write_lab, rgb, intensities, TO_XYZ, scale, *views, *band))
    return jobs


# Division by zero gives infinity, as in NumPy: checking for it would prevent vectorisation of the loops.
@compiled(error_model="numpy")
def _write_lab(  # type: ignore[no-untyped-def]
    rgb, intensities, to_xyz, scale, scratch, bits, planes, guesses, first, last
):
    """Convert a band of rows to Lab.

    Args:
        rgb: uint8 [H, W, 3].
        intensities: float32 [256], from `linear_intensities`.
        to_xyz: float32 [3, 3], `TO_XYZ`.
        scale: float32, factor by which L, a and b are multiplied.
        scratch: float32 [4, W], work space.
        bits: int32 [W], the memory of the last row of `scratch`.
        planes: float32 [3, H, W], written in the rows `first` to `last` - 1.
        guesses: int32 [3, H, W], the memory of `planes`.
        first: First row of the band.
        last: Row after the band.
    """
    width = rgb.shape[1]
    red, green, blue, tristimulus = scratch[0], scratch[1], scratch[2], scratch[3]
    third, toe = np.float32(1 / 3), np.float32(0.008856)
    for row in range(first, last):
        colors = rgb[row]
        for column in range(width):
            red[column] = intensities[colors[column, 0]]
            green[column] = intensities[colors[column, 1]]
            blue[column] = intensities[colors[column, 2]]
        for axis in range(3):
            from_red, from_green, from_blue = to_xyz[axis, 0], to_xyz[axis, 1], to_xyz[axis, 2]
            for k in range(width):
                tristimulus[k] = from_red * red[k] + from_green * green[k] + from_blue * blue[k]
            # Cube root: the bits of a float, read as an integer and divided by 3, give a guess within 6 %. One step of
            # Halley's method brings it within 2e-4. The two steps are separate loops so that both are vectorised.
            roots, guess = planes[axis, row], guesses[axis, row]
            for k in range(width):
                guess[k] = np.int32(np.float32(bits[k]) * third) + np.int32(0x2A5137A0)
            for k in range(width):
                root, value = roots[k], tristimulus[k]
                cube = root * root * root
                root *= (cube + value + value) / (cube + cube + value)
                roots[k] = root if value > toe else np.float32(7.787) * value + np.float32(16 / 116)
        x, y, z = planes[0, row], planes[1, row], planes[2, row]
        for k in range(width):
            fx, fy, fz = x[k], y[k], z[k]
            x[k] = (np.float32(116) * fy - np.float32(16)) * scale
            y[k] = (fx - fy) * (np.float32(500) * scale)
            z[k] = (fy - fz) * (np.float32(200) * scale)


@compiled
def write_depth(depth, percentile, scale, histogram, planes):  # type: ignore[no-untyped-def]
    """Clip depth at a percentile and stretch it to [0, 1] over its valid pixels.

    The percentile is exact to the millimetre. It comes from a histogram, which needs no sorting.

    Args:
        depth: float32 [H, W], metres, 0 = missing.
        percentile: Percentile of the valid pixels, 0 to 100.
        scale: float32, factor by which the stretched depth z is multiplied.
        histogram: int32 [FARTHEST + 1] of zeros, work space.
        planes: float32 [3, H, W], written: w z, w and 0, where w is 1 for valid pixels and 0 for missing ones.
    """
    height, width = depth.shape
    nearest, farthest = np.float32(np.inf), np.float32(FARTHEST * 0.001)
    for row in range(height):
        for column in range(width):
            meters = depth[row, column]
            millimeters = np.int64(meters * np.float32(1000) + np.float32(0.5)) if meters < farthest else FARTHEST
            histogram[millimeters] += 1
            if 0 < meters < nearest:
                nearest = meters
    # Bin 0 holds the missing pixels, and any that are so near that a 16-bit image would round them to 0.
    rank = percentile / 100 * (height * width - histogram[0])
    passed, millimeters = 0, 0
    while passed < rank:
        millimeters += 1
        passed += histogram[millimeters]
    ceiling = np.float32(millimeters * 0.001)
    stretch = scale / (ceiling - nearest) if ceiling > nearest else np.float32(0)
    for row in range(height):
        for column in range(width):
            meters = depth[row, column]
            valid = np.float32(1) if meters > 0 else np.float32(0)
            clipped = meters if meters < ceiling else ceiling
            planes[0, row, column] = valid * (clipped - nearest) * stretch
            planes[1, row, column] = valid
            planes[2, row, column] = np.float32(0)


def smoothing_jobs(
    planes: Planes, weights: npt.NDArray[np.float32], smoothed: Planes, rows: Sequence[tuple[int, int]]
) -> list[Callable[[], None]]:
    """Return jobs that smooth planes with a separable Gaussian, one for each band of rows.

    Beyond its rim the image is mirrored.

    Args:
        planes: float32 [3, H, W].
        weights: float32 [radius + 1], from `gaussian_weights`.
        smoothed: float32 [3, H, W], written by the jobs.
        rows: First row of each band, and the row after its last.
    """
    room = planes.shape[2] + 2 * (len(weights) - 1)
    return [partial(_smooth, planes, weights, np.empty(room, np.float32), smoothed, *band) for band in rows]


@compiled
def _smooth(planes, weights, padded, smoothed, first, last):  # type: ignore[no-untyped-def]
    """Smooth a band of rows.

    Args:
        planes: float32 [3, H, W].
        weights: float32 [radius + 1].
        padded: float32 [W + 2 radius], work space.
        smoothed: float32 [3, H, W], written in the rows `first` to `last` - 1.
        first: First row of the band.
        last: Row after the band.
    """
    count, height, width = planes.shape
    radius = len(weights) - 1
    line = padded[radius : radius + width]
    for row in range(first, last):
        for plane in range(count):
            # Smooth down the columns into `line`, the middle of `padded`.
            source = planes[plane, row]
            for k in range(width):
                line[k] = weights[0] * source[k]
            for offset in range(1, radius + 1):
                weight = weights[offset]
                above, below = (
                    planes[plane, _mirror(row - offset, height)],
                    planes[plane, _mirror(row + offset, height)],
                )
                for k in range(width):
                    line[k] += weight * (above[k] + below[k])
            # Pad that row with its mirror image, and smooth along it.
            for offset in range(1, radius + 1):
                padded[radius - offset] = line[_mirror(-offset, width)]
                padded[radius + width - 1 + offset] = line[_mirror(width - 1 + offset, width)]
            target = smoothed[plane, row]
            for k in range(width):
                target[k] = weights[0] * line[k]
            for offset in range(1, radius + 1):
                weight = weights[offset]
                left, right = padded[radius - offset :], padded[radius + offset :]
                for k in range(width):
                    target[k] += weight * (left[k] + right[k])


@compiled
def _mirror(index, length):  # type: ignore[no-untyped-def]
    """Return the index in 0 to `length` - 1 to which mirroring at the rim maps an index; the rim pixel is repeated."""
    while index < 0 or index >= length:
        index = -1 - index if index < 0 else 2 * length - 1 - index
    return index


def unweighted(smoothed: Planes, planes: Planes) -> Planes:
    """Remove the effect of missing pixels on smoothed depth: divide the mean of w z by the mean of w.

    Args:
        smoothed: The smoothed planes of `write_depth`.
        planes: The planes before smoothing.

    Returns:
        float32 [3, H, W]: w z, w and 0 with the smoothed z and the original w.
    """
    result = planes.copy()
    np.divide(smoothed[0], smoothed[1], out=result[0], where=planes[1] > 0)
    return result
