"""Local k-means whose centres are slanted planes: SLIC that knows what a surface is.

In inverse depth, a plane in space is an *affine* function of the image position, whatever the camera, and the noise of
a triangulating sensor is the same everywhere, where in metres it grows with the square. So a centre has a mean colour,
a mean position and a plane d = A + B row + C column of inverse depth, fitted to its pixels by least squares, and the
squared distance of a pixel to it is

    |f_p - f_c|^2 + |x_p - x_c|^2 / step^2 + v_p min((d_p - A - B row_p - C column_p)^2, cap) + missing (v_p - s_c)^2,

with Lab colours f over the compactness, v = 1 where there is depth and 0 where it is missing, and s_c the share of the
centre's pixels that its plane was fitted to. Two faces of a box are cut where their planes cross, a slanted table is
one surface, and quantised depth far away makes no steps. The cap makes the fit robust: pixels farther off take no part.

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
"""What a pixel is compared by: L, a, b, the inverse depth (0 = missing), and its place."""

PLANES = 4
"""The first of them are images."""

# The coefficients of a centre: of L, a, b and the place, of 1, then its plane (A, B, C), the weight of the distance to
# it (0 for a centre that knows no depth), and what a pixel with depth costs besides.
CONSTANT, PLANE, WEIGHT, VALID, FORM = 5, 6, 9, 10, 11

CAP = 9.0
"""Squared distances to a plane end here: at three times the noise."""

RIDGE = 50.0
"""Penalty of the squared slope of a plane, pixels^2: a handful of noisy pixels has no slope to speak of."""

UNKNOWN = 4.0
"""Squared distance of a pixel with depth to a centre that knows none."""

MISSING = 1.0
"""Weight of the squared difference between a pixel's validity and the share of a centre's pixels on its plane."""

NEAREST = 0.1
"""Metres. Depth below is compared as if it were this."""

ENOUGH = 4
"""Valid samples that a centre needs for a plane."""

ACROSS = 6
"""Samples from side to side of a cell, at the least: a plane needs more of them than a mean."""

# Sums over the samples of a centre: their number, place and colour, then of those with depth what a plane needs.
_PLANE_SUMS, _SUMS = 6, 15


@compiled
def write_inverse_depth(depth, scale, plane, first, last):  # type: ignore[no-untyped-def]
    """Write scaled inverse depth for a band of rows.

    Args:
        depth: float32 [H, W], metres, 0 = missing.
        scale: float32, what inverse metres are multiplied by.
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

    Every sum is taken by one thread in the order of the samples, so that their number changes nothing.

    Args:
        planes: float32 [4, H, W]: L, a, b over the compactness, and inverse depth over its noise, 0 = missing.
        cells: Where the centres start.
        iterations: Rounds of assignment and update.
        subsample: Only every so many rows and columns are looked at.
        threads: Threads to work in.

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
            # Samples have the label of one of the nine centres around them, so those of a band lie at most a row off.
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
    for plane in range(PLANES):
        for k in range(first, last):
            values[plane, k] = planes[plane, pixels[k]]


@compiled
def _assign_samples(values, offsets, near, forms, distances, labels, first, last):  # type: ignore[no-untyped-def]
    """Give every sample of the cells `first` to `last` - 1 the nearest of the nine centres around it."""
    for cell in range(first, last):
        begin, end = offsets[cell], offsets[cell + 1]
        _nearest_plane(values, begin, offsets[0], offsets[0], near[cell], forms, distances, labels[begin:end])


@compiled(error_model="numpy")
def _update(values, labels, begin, end, scale, robust, sums, places, forms, first, last):  # type: ignore[no-untyped-def]
    """Fit some centres to their samples; one without any stays, and one whose depth is all off keeps its plane.

    Args:
        values: float32 [6, M], the samples.
        labels: int32 [M], their centres.
        begin: First sample that may belong to one of these centres.
        end: The sample after the last.
        scale: Weight of squared distances in the image.
        robust: Leave out depth that is beyond the cap for the centre as it is.
        sums: float64 [cells, 15] to work in.
        places: float64 [cells, 2], mean row and column; sums are taken relative to the old ones. Written.
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
    """Sum over the samples of each centre, relative to its place; arguments as of `_update`."""
    for center in range(first, last):
        for k in range(_SUMS):
            sums[center, k] = 0.0
    for sample in range(begin, end):
        own = np.int64(labels[sample])
        if own < first or own >= last:
            continue
        # Indexed: to slice the centre's rows for every sample takes longer than the sums.
        y, x = values[ROW, sample] - places[own, 0], values[COLUMN, sample] - places[own, 1]
        sums[own, 0] += 1
        sums[own, 1] += y
        sums[own, 2] += x
        sums[own, 3] += values[0, sample]
        sums[own, 4] += values[1, sample]
        sums[own, 5] += values[2, sample]
        d = values[DISPARITY, sample]
        if d > 0:
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
        place: float64 [2], its row and column before; written.
        form: float32 [11], its coefficients; written.
    """
    count, valid = total[0], total[_PLANE_SUMS]
    if valid >= ENOUGH:
        level, down, right, _ = plane_fit(total[_PLANE_SUMS:], 0.0)
        form[PLANE] = level - down * place[0] - right * place[1]
        form[PLANE + 1], form[PLANE + 2] = down, right
        form[WEIGHT] = 1
    row, column = place[0] + total[1] / count, place[1] + total[2] / count
    place[0], place[1] = row, column
    lightness, a, b = total[3] / count, total[4] / count, total[5] / count
    share = valid / count
    form[0], form[1], form[2] = -2 * lightness, -2 * a, -2 * b
    form[3], form[4] = -2 * row * scale, -2 * column * scale
    form[CONSTANT] = (
        lightness * lightness + a * a + b * b + (row * row + column * column) * scale + MISSING * share * share
    )
    form[VALID] = -2 * share * MISSING + (0.0 if form[WEIGHT] > 0 else UNKNOWN)


@compiled(error_model="numpy")
def plane_fit(sums, squares):  # type: ignore[no-untyped-def]
    """Fit a plane of inverse depth by least squares, with a penalty on its slope.

    Args:
        sums: float64 [9], or nine numbers, over the pixels: of 1, y, x, y y, y x, x x, d, d y, d x.
        squares: Sum of d d, for the fourth result.

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
    """Allocate what one thread needs in `assign`: values float32 [6, B], distances float32 [9, B], labels int32 [B]."""
    return local_k_means.work_space(cells, PLANES + 2)


@compiled
def assign(planes, batches, near, forms, values, distances, found, labels):  # type: ignore[no-untyped-def]
    """Give every pixel of some cells the nearest of the nine centres around it.

    It differs from the function of this name in `local_k_means` in nothing but the distance. That is written out,
    because Numba keeps no machine code on disk of functions that are given another one.

    Args:
        planes: float32 [4, H, W], as in `cluster`.
        batches: int64 [B, 5], the pixels, from `local_k_means.batches`.
        near: int32 [cells, 9], see `Cells`.
        forms: float32 [cells, 11], from `cluster`.
        values: float32 [6, room], from `work_space`.
        distances: float32 [9, room], from `work_space`.
        found: int32 [room], from `work_space`.
        labels: int32 [H, W], written where the pixels are: the index of the nearest centre.
    """
    filled = np.int64(0)
    for k in range(len(batches)):
        batch = batches[k]
        cell, top, left, rows, width = batch[0], batch[1], batch[2], batch[3], batch[4]
        if width != filled:
            write_places(width, values[ROW], values[COLUMN])
            filled = width
        gather(planes, top, rows, left, width, values)
        _nearest_plane(values, np.int64(0), top, left, near[cell], forms, distances, found[: rows * width])
        scatter(found, top, rows, left, width, labels)


@compiled
def _nearest_plane(values, begin, top, left, near, forms, distances, labels):  # type: ignore[no-untyped-def]
    """Give as many pixels as there are `labels`, from `begin` on in `values`, the nearest of nine centres.

    Rows and columns in `values` are counted from `top` and `left`.
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
