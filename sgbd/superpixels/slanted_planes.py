"""Local k-means whose centres are slanted planes: SLIC with a model of surfaces.

A plane in space is an *affine* function of the image position in inverse depth, whatever the camera. The noise of a
triangulating sensor is also the same everywhere in inverse depth, while in metres it grows with the square of the
distance. So a centre has a mean colour, a mean position and a plane d = A + B row + C column of inverse depth, fitted
to its pixels by least squares. The squared distance of pixel p to centre c is

    |f_p - f_c|^2 + |x_p - x_c|^2 / step^2 + v_p min((d_p - A - B row_p - C column_p)^2, cap) + missing (v_p - s_c)^2,

with f the Lab colours divided by the compactness, v = 1 for pixels with depth and 0 for those without, and s_c the
share of the centre's pixels to which its plane was fitted. Two faces of a box are separated where their planes cross, a
slanted table is one surface, and quantised depth far away makes no steps. The cap makes the fit robust: pixels farther
from the plane take no part in it.

Sources: Yamaguchi, McAllester, Urtasun, Efficient joint segmentation, occlusion labeling, stereo and flow estimation,
ECCV 2014, DOI 10.1007/978-3-319-10602-1_49 (slanted planes); Achanta et al., TPAMI 2012, DOI 10.1109/TPAMI.2012.120.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from sgbd.machine.compiled import compiled
from sgbd.machine.side_by_side import bands, side_by_side
from sgbd.superpixels import local_k_means
from sgbd.superpixels.local_k_means import Cells, Samples, gather, least_of_nine, scatter, write_places

DISPARITY, ROW, COLUMN = 3, 4, 5
"""Rows of `values`: L, a, b in 0 to 2, then the inverse depth (0 = missing), and the position in pixels."""

PLANES = 4
"""Number of rows of `values` that come from images, the `planes`: L, a, b and inverse depth, the first rows."""

# Columns of `forms`: the coefficients of L, a, b and of the position in 0 to 4, the constant, the plane (A, B, C), the
# weight of the distance to the plane (0 for a centre without one), and what is added for a pixel with depth.
CONSTANT, PLANE, WEIGHT, VALID, FORM = 5, 6, 9, 10, 11

CAP = 9.0
"""Upper limit of the squared distance to a plane: three times the noise."""

RIDGE = 50.0
"""Penalty on the squared slope of a plane, pixels^2: a handful of noisy pixels does not determine a slope."""

UNKNOWN = 4.0
"""Squared distance of a pixel with depth to a centre without a plane."""

MISSING = 1.0
"""Weight of the squared difference between a pixel's validity and the share of a centre's pixels on its plane."""

NEAREST = 0.1
"""Metres. Smaller depth is treated as this depth."""

ENOUGH = 4
"""Valid samples that a centre needs for a plane."""

ACROSS = 6
"""Minimum number of samples from side to side of a cell: a plane needs more of them than a mean."""

# Columns of `sums`, one row per centre: 0 the number of samples, 1 and 2 the sums of row and column, 3 to 5 those of
# the colours; from _PLANE_SUMS on, over samples with depth, the nine sums that `plane_fit` needs.
_PLANE_SUMS, _SUMS = 6, 15


@compiled
def write_inverse_depth(depth, scale, plane, first, last):  # type: ignore[no-untyped-def]
    """Write scaled inverse depth for a band of rows.

    Args:
        depth: float32 [H, W], metres, 0 = missing.
        scale: float32, factor by which inverse metres are multiplied.
        plane: float32 [H, W], written in the rows `first` to `last` - 1; 0 = missing.
        first: First row of the band.
        last: Row after the band.
    """
    nearest = np.float32(NEAREST)
    for row in range(first, last):
        source, target = depth[row], plane[row]
        for column in range(depth.shape[1]):
            meters = source[column]
            target[column] = (
                scale / (meters if meters > nearest else nearest) if meters > np.float32(0) else np.float32(0)
            )


def cluster(
    planes: npt.NDArray[np.float32], cells: Cells, iterations: int, subsample: int, threads: int = 1
) -> npt.NDArray[np.float32]:
    """Find the slanted planes of an image.

    One thread computes each sum, in the order of the samples, so the result does not depend on the number of threads.

    Args:
        planes: float32 [4, H, W]: L, a, b over the compactness, and inverse depth over its noise, 0 = missing.
        cells: Where the centres start.
        iterations: Rounds of assignment and update.
        subsample: Use only every `subsample`-th row and column.
        threads: Number of threads.

    Returns:
        float32 [cells, 11], the centres, for `assign`.
    """
    samples = Samples.of(cells, subsample, ACROSS)
    offsets = samples.offsets
    rows, columns = len(cells.tops) - 1, len(cells.lefts) - 1
    values = np.empty((PLANES + 2, len(samples.pixels)), np.float32)
    values[ROW:] = samples.positions
    labels = np.repeat(np.arange(len(cells), dtype=np.int32), np.diff(offsets))
    places = cells.centers
    forms = np.zeros((len(cells), FORM), np.float32)
    sums = np.empty((len(cells), _SUMS))
    widest = max(1, int(np.diff(offsets).max()))
    flat, scale = planes.reshape(PLANES, -1), np.float32(1 / cells.step**2)
    cell_bands = [(first * columns, last * columns) for first, last in bands(rows, threads)]

    def update(robust: bool) -> None:
        jobs = []
        for first, last in cell_bands:
            # A sample is labelled with one of the nine centres around it, so the samples of a band's centres lie at
            # most one row of cells outside the band.
            begin, end = offsets[max(first - columns, 0)], offsets[min(last + columns, len(cells))]
            jobs.append(partial(_update, values, labels, begin, end, scale, robust, sums, places, forms, first, last))
        side_by_side(jobs, threads)

    side_by_side(
        [partial(_pick, flat, samples.pixels, values, offsets[first], offsets[last]) for first, last in cell_bands],
        threads,
    )
    update(False)
    for _ in range(iterations):
        side_by_side(
            [
                partial(
                    _assign_samples,
                    values,
                    offsets,
                    cells.near,
                    forms,
                    np.empty((9, widest), np.float32),
                    labels,
                    *band,
                )
                for band in cell_bands
            ],
            threads,
        )
        update(True)
    return forms


@compiled
def _pick(planes, pixels, values, first, last):  # type: ignore[no-untyped-def]
    """Copy the planes of the samples `first` to `last` - 1 into the first rows of `values`."""
    for plane in range(PLANES):
        for k in range(first, last):
            values[plane, k] = planes[plane, pixels[k]]


@compiled
def _assign_samples(values, offsets, near, forms, distances, labels, first, last):  # type: ignore[no-untyped-def]
    """Label every sample of the cells `first` to `last` - 1 with the nearest of the nine centres around it."""
    for cell in range(first, last):
        begin, end = offsets[cell], offsets[cell + 1]
        # Positions of samples are relative to the image corner; offsets[0] is an integer 0 of the right type.
        _nearest_plane(values, begin, offsets[0], offsets[0], near[cell], forms, distances, labels[begin:end])


@compiled(error_model="numpy")
def _update(values, labels, begin, end, scale, robust, sums, places, forms, first, last):  # type: ignore[no-untyped-def]
    """Fit some centres to their samples.

    A centre without samples stays as it is, and one with too few samples near its plane keeps that plane.

    Args:
        values: float32 [6, M], the samples.
        labels: int32 [M], the centre of each sample.
        begin: First sample that may belong to one of these centres.
        end: The sample after the last.
        scale: Weight of squared distances in the image.
        robust: Leave out depth whose squared distance to the centre's current plane is beyond the cap.
        sums: float64 [cells, 15], work space.
        places: float64 [cells, 2], mean row and column of each centre; written. Sums are relative to the old ones.
        forms: float32 [cells, 11], written.
        first: First of the centres.
        last: The centre after the last.
    """
    _sum_samples(values, labels, begin, end, robust, places, forms, first, last, sums)
    for center in range(first, last):
        if sums[center, 0] > 0:
            _fit_center(sums[center], scale, places[center], forms[center])


@compiled
def _sum_samples(values, labels, begin, end, robust, places, forms, first, last, sums):  # type: ignore[no-untyped-def]
    """Sum over the samples of each centre, with positions relative to its place; arguments as in `_update`."""
    for center in range(first, last):
        for k in range(_SUMS):
            sums[center, k] = 0.0
    for sample in range(begin, end):
        own = np.int64(labels[sample])
        if own < first or own >= last:
            continue
        # Indexed in full: slicing the centre's rows for every sample would take longer than the sums.
        y, x = values[ROW, sample] - places[own, 0], values[COLUMN, sample] - places[own, 1]
        sums[own, 0] += 1
        sums[own, 1] += y
        sums[own, 2] += x
        sums[own, 3] += values[0, sample]
        sums[own, 4] += values[1, sample]
        sums[own, 5] += values[2, sample]
        d = values[DISPARITY, sample]
        if d > 0:
            # Distance to the plane before this update.
            off = d - (
                forms[own, PLANE]
                + forms[own, PLANE + 1] * values[ROW, sample]
                + forms[own, PLANE + 2] * values[COLUMN, sample]
            )
            if robust and forms[own, WEIGHT] > 0 and off * off > CAP:
                continue
            sums[own, _PLANE_SUMS] += 1
            sums[own, _PLANE_SUMS + 1] += y
            sums[own, _PLANE_SUMS + 2] += x
            sums[own, _PLANE_SUMS + 3] += y * y
            sums[own, _PLANE_SUMS + 4] += y * x
            sums[own, _PLANE_SUMS + 5] += x * x
            sums[own, _PLANE_SUMS + 6] += d
            sums[own, _PLANE_SUMS + 7] += d * y
            sums[own, _PLANE_SUMS + 8] += d * x


@compiled(error_model="numpy")
def _fit_center(total, scale, place, form):  # type: ignore[no-untyped-def]
    """Move a centre to the mean of its samples, and fit its plane if enough of them have depth.

    Args:
        total: float64 [15], the sums over its samples, of which there is at least one.
        scale: Weight of squared distances in the image.
        place: float64 [2], its row and column before the update; overwritten with the new ones.
        form: float32 [11], its coefficients; written.
    """
    count, valid = total[0], total[_PLANE_SUMS]
    if valid >= ENOUGH:
        level, down, right, _ = plane_fit(total[_PLANE_SUMS:], 0.0)
        # The fit is relative to the old place; A is the plane's value at the image corner.
        form[PLANE] = level - down * place[0] - right * place[1]
        form[PLANE + 1], form[PLANE + 2] = down, right
        form[WEIGHT] = 1
    row, column = place[0] + total[1] / count, place[1] + total[2] / count
    place[0], place[1] = row, column
    lightness, a, b = total[3] / count, total[4] / count, total[5] / count
    share = valid / count
    form[0], form[1], form[2] = -2 * lightness, -2 * a, -2 * b
    form[3], form[4] = -2 * row * scale, -2 * column * scale
    # The squared distance without terms that depend on the pixel alone. As v^2 = v, of missing (v - s)^2 there remain
    # the constant missing s^2 and, for pixels with depth, -2 missing s.
    form[CONSTANT] = (
        lightness * lightness + a * a + b * b + (row * row + column * column) * scale + MISSING * share * share
    )
    form[VALID] = -2 * share * MISSING + (0.0 if form[WEIGHT] > 0 else UNKNOWN)


@compiled(error_model="numpy")
def plane_fit(sums, squares):  # type: ignore[no-untyped-def]
    """Fit a plane of inverse depth by least squares, with a penalty on its slope.

    Args:
        sums: float64 [9], or nine numbers, over the pixels: of 1, y, x, y y, y x, x x, d, d y, d x.
        squares: Sum of d d, used only for the fourth result.

    Returns:
        The plane's value where y = x = 0, its slopes along y and x, and the sum of squared distances, penalty included.
    """
    count = sums[0]
    y, x, d = sums[1] / count, sums[2] / count, sums[6] / count
    yy, yx, xx = sums[3] - count * y * y + RIDGE, sums[4] - count * y * x, sums[5] - count * x * x + RIDGE
    dy, dx = sums[7] - count * d * y, sums[8] - count * d * x
    # The penalty keeps the determinant positive.
    determinant = yy * xx - yx * yx
    down, right = (dy * xx - dx * yx) / determinant, (dx * yy - dy * yx) / determinant
    error = squares - count * d * d - down * dy - right * dx
    return d - down * y - right * x, down, right, 0.0 if error < 0 else error


def work_space(cells: Cells) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Allocate the work space of one thread for `assign`.

    Args:
        cells: The cells of the image.

    Returns:
        For the B pixels of a batch: their values, float32 [6, B], their distances to nine centres, float32 [9, B], and
        their labels, int32 [B].
    """
    return local_k_means.work_space(cells, PLANES + 2)


@compiled
def assign(planes, batches, near, forms, values, distances, found, labels):  # type: ignore[no-untyped-def]
    """Label every pixel of some cells with the nearest of the nine centres around it.

    Only the distance differs from `local_k_means.assign`. The function is repeated here because Numba does not cache
    the machine code of functions that take another function as an argument.

    Args:
        planes: float32 [4, H, W], as in `cluster`.
        batches: int64 [B, 5], the rectangles of pixels to label, from `local_k_means.batches`.
        near: int32 [cells, 9], see `Cells`.
        forms: float32 [cells, 11], from `cluster`.
        values: float32 [6, room], from `work_space`.
        distances: float32 [9, room], from `work_space`.
        found: int32 [room], from `work_space`.
        labels: int32 [H, W], written inside the rectangles: the index of the nearest centre.
    """
    filled = np.int64(0)
    for k in range(len(batches)):
        batch = batches[k]
        cell, top, left, rows, width = batch[0], batch[1], batch[2], batch[3], batch[4]
        # Positions are relative to the rectangle's corner, so they change only when the width does.
        if width != filled:
            write_places(width, values[ROW], values[COLUMN])
            filled = width
        gather(planes, top, rows, left, width, values)
        _nearest_plane(values, np.int64(0), top, left, near[cell], forms, distances, found[: rows * width])
        scatter(found, top, rows, left, width, labels)


@compiled
def _nearest_plane(values, begin, top, left, near, forms, distances, labels):  # type: ignore[no-untyped-def]
    """Label pixels with the nearest of nine centres.

    The pixels are columns `begin` to `begin + len(labels) - 1` of `values`. Their rows and columns are relative to
    `top` and `left`; the constant and the plane of each centre are shifted accordingly.
    """
    count = len(labels)
    p, q, r = values[0, begin : begin + count], values[1, begin : begin + count], values[2, begin : begin + count]
    d = values[DISPARITY, begin : begin + count]
    y, x = values[ROW, begin : begin + count], values[COLUMN, begin : begin + count]
    cap, none = np.float32(CAP), np.float32(0)
    for candidate in range(9):
        form = forms[near[candidate]]
        by_p, by_q, by_r, by_y, by_x, weight, valid = form[0], form[1], form[2], form[3], form[4], form[9], form[10]
        constant = form[CONSTANT] + by_y * np.float32(top) + by_x * np.float32(left)
        down, right = form[PLANE + 1], form[PLANE + 2]
        level = form[PLANE] + down * np.float32(top) + right * np.float32(left)
        distance = distances[candidate]
        for k in range(count):
            off = d[k] - (level + down * y[k] + right * x[k])
            squared = off * off
            squared = squared if squared < cap else cap
            depth = valid + weight * squared
            depth = depth if d[k] > none else none
            distance[k] = constant + by_y * y[k] + by_x * x[k] + by_p * p[k] + by_q * q[k] + by_r * r[k] + depth
    least_of_nine(distances, near, labels)
