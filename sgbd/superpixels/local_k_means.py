"""Compiled local k-means, the clustering of SLIC: a pixel is compared only with the centres around it.

An image is given as *planes*, float32 [3, H, W]: the features of its pixels, already divided by the compactness.
Centres start on a grid of cells, and a pixel considers the centres of the 3 x 3 cells around its own. The squared
distance of pixel p to centre c is

    w_p |f_p - f_c|^2 + |x_p - x_c|^2 / step^2.

Terms that depend on p alone do not change which centre is nearest and are dropped. The rest is *linear* in the planes
and in the position. A centre is therefore stored as six coefficients (its *form*), and the loop over the pixels of a
cell only multiplies and adds contiguous floats, which compilers turn into vector instructions.

Source: Achanta et al., SLIC superpixels compared to state-of-the-art superpixel methods, TPAMI 2012,
DOI 10.1109/TPAMI.2012.120.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from sgbd.machine.compiled import compiled

Planes = npt.NDArray[np.float32]
"""float32 [3, H, W]. Colours: L, a, b. Depth: w z, w and 0, where w is 1 for valid pixels and 0 for missing ones."""

# Rows of `values` (pixels) and columns of `centers`: three features in 0 to 2, then the position in pixels.
ROW, COLUMN, CENTER = 3, 4, 5

# Columns of `forms`: the coefficients of the three features and of the position, in the same order, and the constant.
CONSTANT, FORM = 5, 6

BATCH = 512
"""Number of pixels compared with their nine centres at a time: as many as fit in the fastest cache."""

FAR = np.float32(1e4)
"""Squared distance of a valid pixel to a centre without depth: farther than any centre that has depth."""


@dataclass(frozen=True, eq=False)
class Cells:
    """The grid of cells on which the centres start.

    Attributes:
        tops: int64 [rows + 1], first image row of each row of cells, then the image height.
        lefts: int64 [columns + 1], first image column of each column of cells, then the image width.
        step: Side of a square with the area of a cell, pixels: the unit of distances in the image.
        near: int32 [cells, 9], each cell and the eight around it. At the rim of the grid, some are repeated.
    """

    tops: npt.NDArray[np.int64]
    lefts: npt.NDArray[np.int64]
    step: float
    near: npt.NDArray[np.int32]

    @classmethod
    @lru_cache(maxsize=16)
    def grid(cls, height: int, width: int, n_segments: int) -> Cells:
        """Divide an image into about `n_segments` cells, as square as possible, at most one per pixel.

        Args:
            height: Rows of the image, pixels.
            width: Columns of the image, pixels.
            n_segments: Requested number of cells.

        Returns:
            The cells.
        """
        rows = int(np.clip(round((n_segments * height / width) ** 0.5), 1, min(height, n_segments)))
        columns = int(np.clip(round(n_segments / rows), 1, width))
        tops = np.arange(rows + 1, dtype=np.int64) * height // rows
        lefts = np.arange(columns + 1, dtype=np.int64) * width // columns
        around = np.arange(-1, 2)
        near_rows = np.clip(np.arange(rows)[:, None] + around, 0, rows - 1)
        near_columns = np.clip(np.arange(columns)[:, None] + around, 0, columns - 1)
        near = near_rows[:, None, :, None] * columns + near_columns[None, :, None, :]
        step = float((height * width / (rows * columns)) ** 0.5)
        return cls(tops, lefts, step, near.reshape(rows * columns, 9).astype(np.int32))

    @property
    def centers(self) -> npt.NDArray[np.float64]:
        """Row and column of the middle of each cell, float64 [cells, 2], pixels."""
        rows, columns = ((edges[:-1] + edges[1:] - 1) / 2 for edges in (self.tops, self.lefts))
        return np.stack([np.repeat(rows, len(columns)), np.tile(columns, len(rows))], axis=1)

    def __len__(self) -> int:
        return len(self.near)


@dataclass(frozen=True, eq=False)
class Samples:
    """The pixels from which the centres are computed, sorted by cell.

    Attributes:
        pixels: int64 [M], indices into the flattened image.
        offsets: int64 [cells + 1], index of the first sample of each cell, then M.
        positions: float32 [2, M], row and column, pixels.
    """

    pixels: npt.NDArray[np.int64]
    offsets: npt.NDArray[np.int64]
    positions: npt.NDArray[np.float32]

    @classmethod
    @lru_cache(maxsize=16)
    def of(cls, cells: Cells, subsample: int, across: int = 8) -> Samples:
        """Sample an image on a regular grid of pixels.

        Args:
            cells: The cells of the image.
            subsample: Distance between samples, pixels. Small cells are sampled more densely; otherwise their means
                would be taken over a handful of pixels.
            across: Minimum number of samples from side to side of a cell, if it has that many pixels.

        Returns:
            The samples.
        """
        stride = int(max(1, min(subsample, cells.step // across)))
        rows, columns = np.arange(0, cells.tops[-1], stride), np.arange(0, cells.lefts[-1], stride)
        cell_rows = np.searchsorted(cells.tops, rows, side="right") - 1
        cell_columns = np.searchsorted(cells.lefts, columns, side="right") - 1
        cell = (cell_rows[:, None] * (len(cells.lefts) - 1) + cell_columns).ravel()
        order = np.argsort(cell, kind="stable")
        row, column = rows[order // len(columns)], columns[order % len(columns)]
        offsets = np.searchsorted(cell[order], np.arange(len(cells) + 1))
        return cls(row * cells.lefts[-1] + column, offsets, np.stack([row, column]).astype(np.float32))


def cluster(planes: Planes, cells: Cells, weighted: bool, iterations: int, subsample: int) -> npt.NDArray[np.float32]:
    """Find the cluster centres of an image.

    Args:
        planes: The features of the pixels.
        cells: Where the centres start.
        weighted: True if the planes are those of depth, with a weight; False if they are colours.
        iterations: Rounds of assignment and update. With 0, every centre is the mean of its cell.
        subsample: Use only every `subsample`-th row and column. The centres hardly change, and the time falls with the
            square.

    Returns:
        float32 [cells, 6], the *forms* of the centres, for `assign`.
    """
    samples = Samples.of(cells, subsample)
    values = np.empty((CENTER, len(samples.pixels)), np.float32)
    values[ROW:] = samples.positions
    _pick(planes.reshape(3, -1), samples.pixels, values)
    # A centre that gets no valid samples stays where it started. Its second feature, the mean weight, is then still 0,
    # which tells _expand that it has no depth.
    centers = np.zeros((len(cells), CENTER), np.float32)
    centers[:, ROW:] = cells.centers
    forms = np.empty((len(cells), FORM), np.float32)
    labels = np.repeat(np.arange(len(cells), dtype=np.int32), np.diff(samples.offsets))
    sums = np.empty((len(cells), CENTER + 1))
    distances = np.empty((9, max(1, int(np.diff(samples.offsets).max()))), np.float32)
    scale = np.float32(1 / cells.step**2)
    _cluster(values, samples.offsets, cells.near, scale, weighted, iterations, labels, sums, distances, centers, forms)
    return forms


@compiled
def _pick(planes, pixels, values):  # type: ignore[no-untyped-def]
    """Copy the features of the sampled pixels into the first three rows of `values`."""
    for plane in range(3):
        for k in range(len(pixels)):
            values[plane, k] = planes[plane, pixels[k]]


@compiled
def _cluster(  # type: ignore[no-untyped-def]
    values, offsets, near, scale, weighted, iterations, labels, sums, distances, centers, forms
):
    """Alternate between updating the centres and assigning each sample to the nearest of nine centres.

    Args:
        values: float32 [5, M], features and position of the samples, sorted by cell.
        offsets: int64 [cells + 1], index of the first sample of each cell, then M.
        near: int32 [cells, 9], see `Cells`.
        scale: float32, 1 / step^2.
        weighted: Whether the second feature is a weight, see `cluster`.
        iterations: Number of rounds.
        labels: int32 [M], initially the cell of each sample; overwritten with its nearest centre.
        sums: float64 [cells, 6], work space.
        distances: float32 [9, samples of the largest cell], work space.
        centers: float32 [cells, 5], initial centres; overwritten with the final ones.
        forms: float32 [cells, 6], written: the final centres as coefficients.
    """
    _update(values, labels, weighted, sums, centers)
    _expand(centers, scale, weighted, forms)
    for _ in range(iterations):
        for cell in range(len(near)):
            first, last = offsets[cell], offsets[cell + 1]
            # Positions of samples are relative to the image corner; offsets[0] is an integer 0 of the right type.
            _nearest_of_nine(values, first, offsets[0], offsets[0], near[cell], forms, distances, labels[first:last])
        _update(values, labels, weighted, sums, centers)
        _expand(centers, scale, weighted, forms)


@compiled
def _update(values, labels, weighted, sums, centers):  # type: ignore[no-untyped-def]
    """Move every centre to the mean of its valid samples; a centre without any stays where it is."""
    for center in range(len(centers)):
        for k in range(CENTER + 1):
            sums[center, k] = 0.0
    for sample in range(len(labels)):
        # Samples without depth pull no centre.
        if weighted and values[1, sample] == 0:
            continue
        total = sums[labels[sample]]
        for k in range(CENTER):
            total[k] += values[k, sample]
        total[CENTER] += 1
    for center in range(len(centers)):
        if sums[center, CENTER] > 0:
            for k in range(CENTER):
                centers[center, k] = sums[center, k] / sums[center, CENTER]


@compiled
def _expand(centers, scale, weighted, forms):  # type: ignore[no-untyped-def]
    """Expand the squared distance to each centre into its coefficients, without terms of the pixel alone."""
    for center in range(len(centers)):
        row, column = centers[center, ROW], centers[center, COLUMN]
        first, second, third = centers[center, 0], centers[center, 1], centers[center, 2]
        form = forms[center]
        form[ROW], form[COLUMN] = np.float32(-2) * row * scale, np.float32(-2) * column * scale
        form[CONSTANT] = (row * row + column * column) * scale
        form[0] = np.float32(-2) * first
        if weighted:
            # w (z - z_c)^2 = w z^2 - 2 z_c (w z) + z_c^2 w, where the planes are w z and w. Only valid samples enter
            # the mean, so `second`, the mean weight, is 1; it is 0 for a centre that never had a valid sample.
            form[1] = first * first if second > 0 else FAR
            form[2] = np.float32(0)
        else:
            form[1], form[2] = np.float32(-2) * second, np.float32(-2) * third
            form[CONSTANT] += first * first + second * second + third * third


@lru_cache(maxsize=16)
def batches(cells: Cells, first: int, last: int) -> npt.NDArray[np.int64]:
    """Divide cells into the rectangles that `assign` processes: as many whole rows of a cell as fit into a batch.

    One long loop over several rows of a cell costs less than a short loop for each row.

    Args:
        cells: The cells of the image.
        first: First row of cells.
        last: Row of cells after the last.

    Returns:
        int64 [B, 5]: the cell, and the rectangle's first row, first column, number of rows and width, pixels.
    """
    heights, widths = np.diff(cells.tops), np.diff(cells.lefts)
    room = _room(cells) // widths
    count = -(-heights[first:last, None] // room)
    cell = np.repeat(np.arange(first * len(widths), last * len(widths)), count.ravel())
    row, column = np.divmod(cell, len(widths))
    # Number of each batch within its cell, from 0.
    number = np.arange(len(cell)) - np.repeat(np.cumsum(count) - count.ravel(), count.ravel())
    top = cells.tops[row] + number * room[column]
    rows = np.minimum(room[column], cells.tops[row + 1] - top)
    return np.stack([cell, top, cells.lefts[column], rows, widths[column]], axis=1)


def _room(cells: Cells) -> int:
    """Return the capacity of a batch in pixels: at least one row of the widest cell."""
    return max(BATCH, int(np.diff(cells.lefts).max()))


def work_space(
    cells: Cells, channels: int = CENTER
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Allocate the work space of one thread for `assign`.

    Args:
        cells: The cells of the image.
        channels: Number C of values that a pixel is compared by, including its position.

    Returns:
        For the B pixels of a batch: their values, float32 [C, B], their distances to nine centres, float32 [9, B], and
        their labels, int32 [B].
    """
    room = _room(cells)
    return np.empty((channels, room), np.float32), np.empty((9, room), np.float32), np.empty(room, np.int32)


@compiled
def assign(planes, batches, near, forms, values, distances, found, labels):  # type: ignore[no-untyped-def]
    """Label every pixel of some cells with the nearest of the nine centres around it.

    Args:
        planes: float32 [3, H, W], the features of the pixels.
        batches: int64 [B, 5], the rectangles of pixels to label, from `batches`.
        near: int32 [cells, 9], see `Cells`.
        forms: float32 [cells, 6], the centres, from `cluster`.
        values: float32 [5, room], from `work_space`.
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
        _nearest_of_nine(values, np.int64(0), top, left, near[cell], forms, distances, found[: rows * width])
        scatter(found, top, rows, left, width, labels)


@compiled
def write_places(width, row, column):  # type: ignore[no-untyped-def]
    """Write the row and column of every pixel of a batch, relative to its corner; batches of one width share them."""
    for k in range(len(row) // width):
        for k_column in range(width):
            row[k * width + k_column] = k
            column[k * width + k_column] = k_column


@compiled
def gather(planes, top, rows, left, width, values):  # type: ignore[no-untyped-def]
    """Copy a rectangle of each plane into the row of `values` with the same index, flattened."""
    # Unsigned indices cannot be negative, so Numba omits the wrap-around check that would prevent vectorisation.
    for plane in range(len(planes)):
        target, source = values[plane], planes[plane]
        for k in range(rows):
            begin, row, from_column = np.uint64(k * width), np.uint64(top + k), np.uint64(left)
            for column in range(np.uint64(width)):
                target[begin + column] = source[row, from_column + column]


@compiled
def scatter(found, top, rows, left, width, labels):  # type: ignore[no-untyped-def]
    """Copy the flattened labels of a rectangle to its place in the image."""
    for k in range(rows):
        target, source = labels[top + k, left : left + width], found[k * width : (k + 1) * width]
        for column in range(width):
            target[column] = source[column]


@compiled
def _nearest_of_nine(values, begin, top, left, near, forms, distances, labels):  # type: ignore[no-untyped-def]
    """Label pixels with the nearest of nine centres.

    The pixels are columns `begin` to `begin + len(labels) - 1` of `values`. Their rows and columns are relative to
    `top` and `left`; adding these to the constant of each centre makes up for it.
    """
    count = len(labels)
    p, q, r = values[0, begin : begin + count], values[1, begin : begin + count], values[2, begin : begin + count]
    y, x = values[ROW, begin : begin + count], values[COLUMN, begin : begin + count]
    for candidate in range(9):
        form = forms[near[candidate]]
        by_p, by_q, by_r, by_y, by_x, constant = form[0], form[1], form[2], form[ROW], form[COLUMN], form[CONSTANT]
        constant += by_y * np.float32(top) + by_x * np.float32(left)
        distance = distances[candidate]
        for k in range(count):
            distance[k] = constant + by_y * y[k] + by_x * x[k] + by_p * p[k] + by_q * q[k] + by_r * r[k]
    least_of_nine(distances, near, labels)


@compiled
def least_of_nine(distances, near, labels):  # type: ignore[no-untyped-def]
    """Label each pixel with the nearest of nine centres.

    Args:
        distances: float32 [9, B], with B >= M.
        near: int32 [9], the centres.
        labels: int32 [M], written. If several centres are equally near, the first wins.
    """
    count = len(labels)
    # Unrolled by hand: compilers vectorise the comparison only in this form.
    c0, d0 = near[0], distances[0]
    c1, d1 = near[1], distances[1]
    c2, d2 = near[2], distances[2]
    c3, d3 = near[3], distances[3]
    c4, d4 = near[4], distances[4]
    c5, d5 = near[5], distances[5]
    c6, d6 = near[6], distances[6]
    c7, d7 = near[7], distances[7]
    c8, d8 = near[8], distances[8]
    for k in range(count):
        best, label = d0[k], c0
        best, label = (d1[k], c1) if d1[k] < best else (best, label)
        best, label = (d2[k], c2) if d2[k] < best else (best, label)
        best, label = (d3[k], c3) if d3[k] < best else (best, label)
        best, label = (d4[k], c4) if d4[k] < best else (best, label)
        best, label = (d5[k], c5) if d5[k] < best else (best, label)
        best, label = (d6[k], c6) if d6[k] < best else (best, label)
        best, label = (d7[k], c7) if d7[k] < best else (best, label)
        best, label = (d8[k], c8) if d8[k] < best else (best, label)
        labels[k] = label
