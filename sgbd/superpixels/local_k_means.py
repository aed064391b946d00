"""The clustering at the heart of SLIC, in compiled code: k-means in which a pixel sees only the centres around it.

An image is given as *planes*, float32 [3, H, W]: what a pixel is compared by, already divided by the compactness. The
centres start on a grid of cells, and a pixel considers the centres of the 3 x 3 cells around its own. The squared
distance of pixel p to centre c,

    w_p |f_p - f_c|^2 + |x_p - x_c|^2 / step^2,

loses nothing for comparing centres when the terms that depend on p alone are dropped. What is left is *linear* in the
planes and in the position, so a centre is six coefficients (its *form*), and the loop over the pixels of a cell has
nothing in it but multiplications and additions of neighbouring floats: compilers turn it into vector instructions.

Source: Achanta et al., SLIC superpixels compared to state-of-the-art superpixel methods, TPAMI 2012,
DOI 10.1109/TPAMI.2012.120.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sgbd.compiled import compiled

Planes = npt.NDArray[np.float32]
"""float32 [3, H, W]. Colours: L, a, b. Depth: w z, w and 0, where w is 1 for valid pixels and 0 for missing ones."""

# Columns of a centre: its position (samples) and the three features of its planes.
ROW, COLUMN, FEATURE = 0, 1, 2
CENTRE = 5

# Columns of a form: the coefficients of 1, of the position and of the three planes.
CONSTANT, BY_ROW, BY_COLUMN, BY_PLANE = 0, 1, 2, 3
FORM = 6

FAR = np.float32(1e4)
"""Squared distance of a valid pixel to a centre that knows no depth: farther than any centre that does."""


@dataclass(frozen=True)
class Cells:
    """The grid of cells on which the centres start.

    Attributes:
        tops: int64 [rows + 1], first image row of each row of cells, then the image height.
        lefts: int64 [columns + 1], first image column of each column of cells, then the image width.
        step: Side of a square of a cell's area, pixels: the unit of distances in the image.
    """

    tops: npt.NDArray[np.int64]
    lefts: npt.NDArray[np.int64]
    step: float

    @classmethod
    def grid(cls, height: int, width: int, n_segments: int) -> Cells:
        """Cut an image into about `n_segments` cells, as square as can be; at the most one a pixel.

        Args:
            height: Rows of the image, pixels.
            width: Columns of the image, pixels.
            n_segments: Cells asked for.

        Returns:
            The cells.
        """
        rows = int(np.clip(round((n_segments * height / width) ** 0.5), 1, height))
        columns = int(np.clip(round(n_segments / rows), 1, width))
        tops = np.arange(rows + 1, dtype=np.int64) * height // rows
        lefts = np.arange(columns + 1, dtype=np.int64) * width // columns
        return cls(tops, lefts, float((height * width / (rows * columns)) ** 0.5))

    def __len__(self) -> int:
        return (len(self.tops) - 1) * (len(self.lefts) - 1)


def cluster(planes: Planes, cells: Cells, weighted: bool, iterations: int, subsample: int) -> npt.NDArray[np.float32]:
    """Find the cluster centres of an image.

    Args:
        planes: What pixels are compared by.
        cells: Where the centres start.
        weighted: Whether the planes are those of depth, with a weight, rather than those of colour.
        iterations: Rounds of assignment and update. With 0 every centre is the mean of its cell.
        subsample: Only every so many rows and columns are looked at. The centres hardly change, and the time falls
            with the square. Small cells are sampled more densely, or their means would be of a handful of pixels.

    Returns:
        float32 [len(cells), 6], the *forms* of the centres, for `assign`.
    """
    stride = int(max(1, min(subsample, cells.step // 5)))
    samples = np.ascontiguousarray(planes[:, ::stride, ::stride])
    # The samples of a cell are the multiples of the stride in it.
    tops, lefts = -(-cells.tops // stride), -(-cells.lefts // stride)
    centres = _cluster(samples, tops, lefts, np.float32(cells.step / stride), weighted, iterations)
    centres[:, :FEATURE] *= stride
    return _forms(centres, np.float32(cells.step), weighted)


@compiled
def _cluster(samples, tops, lefts, step, weighted, iterations):  # type: ignore[no-untyped-def]
    rows, columns = len(tops) - 1, len(lefts) - 1
    height, width = samples.shape[1:]
    labels = np.empty((height, width), np.int32)
    centres = np.zeros((rows * columns, CENTRE), np.float32)
    for i in range(rows):
        for j in range(columns):
            labels[tops[i] : tops[i + 1], lefts[j] : lefts[j + 1]] = i * columns + j
            centres[i * columns + j, ROW] = np.float32(0.5) * np.float32(tops[i] + tops[i + 1] - 1)
            centres[i * columns + j, COLUMN] = np.float32(0.5) * np.float32(lefts[j] + lefts[j + 1] - 1)
    # A centre that knows no depth has weight 0 in its second plane, see _forms.
    _update(samples, labels, weighted, centres)
    for _ in range(iterations):
        assign(samples, tops, lefts, _forms(centres, step, weighted), labels, 0, height)
        _update(samples, labels, weighted, centres)
    return centres


@compiled
def _update(samples, labels, weighted, centres):  # type: ignore[no-untyped-def]
    """Move every centre to the mean of its samples that have features; one without any stays."""
    sums = np.zeros((len(centres), CENTRE + 1))
    height, width = labels.shape
    for row in range(height):
        for column in range(width):
            if weighted and samples[1, row, column] == 0:
                continue
            total = sums[labels[row, column]]
            total[ROW] += row
            total[COLUMN] += column
            for k in range(3):
                total[FEATURE + k] += samples[k, row, column]
            total[CENTRE] += 1
    for centre in range(len(centres)):
        if sums[centre, CENTRE] > 0:
            for k in range(CENTRE):
                centres[centre, k] = sums[centre, k] / sums[centre, CENTRE]


@compiled
def _forms(centres, step, weighted):  # type: ignore[no-untyped-def]
    """Expand the squared distance to each centre into its coefficients, without what depends on the pixel alone."""
    forms = np.zeros((len(centres), FORM), np.float32)
    unit = np.float32(1) / (step * step)
    for centre in range(len(centres)):
        row, column = centres[centre, ROW], centres[centre, COLUMN]
        first, second, third = centres[centre, FEATURE], centres[centre, FEATURE + 1], centres[centre, FEATURE + 2]
        form = forms[centre]
        form[CONSTANT] = (row * row + column * column) * unit
        form[BY_ROW] = np.float32(-2) * row * unit
        form[BY_COLUMN] = np.float32(-2) * column * unit
        if weighted:
            # w (z - z_c)^2 = w z^2 - 2 z_c (w z) + z_c^2 w. The mean weight of a centre's valid samples is 1, of a
            # centre that never had one 0.
            form[BY_PLANE] = np.float32(-2) * first
            form[BY_PLANE + 1] = first * first if second > 0 else FAR
        else:
            form[CONSTANT] += first * first + second * second + third * third
            form[BY_PLANE] = np.float32(-2) * first
            form[BY_PLANE + 1] = np.float32(-2) * second
            form[BY_PLANE + 2] = np.float32(-2) * third
    return forms


@compiled
def assign(planes, tops, lefts, forms, labels, first, last):  # type: ignore[no-untyped-def]
    """Give every pixel of a band of rows the nearest of the nine centres around it.

    Args:
        planes: float32 [3, H, W], what pixels are compared by.
        tops: int64 [rows + 1], see `Cells`.
        lefts: int64 [columns + 1], see `Cells`.
        forms: float32 [rows * columns, 6], the centres, from `cluster`.
        labels: int32 [H, W], written in the rows `first` to `last` - 1: the index of the nearest centre.
        first: First row of the band.
        last: Row after the band.
    """
    rows, columns = len(tops) - 1, len(lefts) - 1
    width = labels.shape[1]
    position = np.arange(width).astype(np.float32)
    distances = np.empty((9, width), np.float32)
    candidates = np.empty(9, np.int32)
    for i in range(rows):
        for row in range(max(first, tops[i]), min(last, tops[i + 1])):
            for j in range(columns):
                left, right = lefts[j], lefts[j + 1]
                x = position[left:right]
                p, q, r = planes[0, row, left:right], planes[1, row, left:right], planes[2, row, left:right]
                for near in range(9):
                    # At the rim of the grid some candidates come twice, which changes nothing.
                    near_row = min(max(i + near // 3 - 1, 0), rows - 1)
                    near_column = min(max(j + near % 3 - 1, 0), columns - 1)
                    candidate = near_row * columns + near_column
                    candidates[near] = candidate
                    form = forms[candidate]
                    here = form[CONSTANT] + form[BY_ROW] * np.float32(row)
                    by_x, by_p, by_q, by_r = form[BY_COLUMN], form[BY_PLANE], form[BY_PLANE + 1], form[BY_PLANE + 2]
                    distance = distances[near]
                    for k in range(right - left):
                        distance[k] = here + by_x * x[k] + by_p * p[k] + by_q * q[k] + by_r * r[k]
                _nearest_of_nine(distances, candidates, labels[row, left:right])


@compiled
def _nearest_of_nine(distances, candidates, labels):  # type: ignore[no-untyped-def]
    # Written out, not looped, because only then is the loop over pixels turned into vector instructions.
    d0, d1, d2, d3, d4, d5, d6, d7, d8 = (
        distances[0], distances[1], distances[2], distances[3], distances[4],
        distances[5], distances[6], distances[7], distances[8],
    )  # fmt: skip
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = (
        candidates[0], candidates[1], candidates[2], candidates[3], candidates[4],
        candidates[5], candidates[6], candidates[7], candidates[8],
    )  # fmt: skip
    for k in range(len(labels)):
        best, label = _nearer(d0[k], c0, d1[k], c1)
        best, label = _nearer(best, label, d2[k], c2)
        best, label = _nearer(best, label, d3[k], c3)
        best, label = _nearer(best, label, d4[k], c4)
        best, label = _nearer(best, label, d5[k], c5)
        best, label = _nearer(best, label, d6[k], c6)
        best, label = _nearer(best, label, d7[k], c7)
        best, label = _nearer(best, label, d8[k], c8)
        labels[k] = label


@compiled
def _nearer(distance, label, other_distance, other_label):  # type: ignore[no-untyped-def]
    return (other_distance, other_label) if other_distance < distance else (distance, label)
