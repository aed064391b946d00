import numpy as np
import pytest

from sgbd.superpixels.local_k_means import Cells, batches
from sgbd.superpixels.slanted_planes import (
    CAP,
    MISSING,
    NEAREST,
    RIDGE,
    UNKNOWN,
    assign,
    cluster,
    plane_fit,
    work_space,
    write_inverse_depth,
)

SHAPES = [(1, 1), (1, 50), (50, 1), (3, 3), (37, 53), (101, 7)]


def _assigned(planes: np.ndarray, cells: Cells, forms: np.ndarray, bands: int = 1) -> np.ndarray:
    rows = len(cells.tops) - 1
    labels = np.full(planes.shape[1:], -1, np.int32)
    for k in range(bands):
        first, last = rows * k // bands, rows * (k + 1) // bands
        assign(planes, batches(cells, first, last), cells.near, forms, *work_space(cells), labels)
    return labels


def _random_planes(shape: tuple[int, int]) -> np.ndarray:
    rng = np.random.default_rng(sum(shape))
    planes = rng.normal(size=(4, *shape)).astype(np.float32)
    planes[3] = np.where(rng.random(shape) < 0.8, 20 + planes[3] + 0.1 * np.arange(shape[1]), 0)
    return planes


def test_a_plane_is_fitted_as_by_least_squares_with_a_penalty() -> None:
    rng = np.random.default_rng(0)
    y, x, d = rng.normal(3, 20, (3, 40))
    sums = np.array([np.sum(v) for v in (np.ones(40), y, x, y * y, y * x, x * x, d, d * y, d * x)])
    level, down, right, error = plane_fit(sums, np.sum(d * d))
    # Express the ridge penalty as two additional pixels, relative to the mean.
    places = np.stack([y - y.mean(), x - x.mean()], axis=1)
    rows = np.vstack([places, np.sqrt(RIDGE) * np.eye(2)])
    slopes, squares, *_ = np.linalg.lstsq(rows, np.concatenate([d - d.mean(), [0, 0]]))
    np.testing.assert_allclose([down, right], slopes, rtol=1e-9)
    np.testing.assert_allclose(error, squares[0], rtol=1e-9)
    np.testing.assert_allclose(level + down * y.mean() + right * x.mean(), d.mean(), rtol=1e-9)


def test_inverse_depth_is_scaled_and_missing_depth_stays_missing() -> None:
    depth = np.array([[0.0, 0.5, 2.0, 0.01]], np.float32)
    plane = np.full((1, 4), -1, np.float32)
    write_inverse_depth(depth, np.float32(300), plane, 0, 1)
    np.testing.assert_allclose(plane, [[0, 600, 150, 300 / NEAREST]], rtol=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_clustering_is_that_of_plain_loops(shape: tuple[int, int]) -> None:
    planes = _random_planes(shape)
    cells = Cells.grid(*shape, 12)
    labels = _assigned(planes, cells, cluster(planes, cells, iterations=2, subsample=1))

    # The oracle computes means, planes and distances as in the module docstring.
    row, column = np.mgrid[: shape[0], : shape[1]]
    cell = (np.searchsorted(cells.tops, row, "right") - 1) * (len(cells.lefts) - 1)
    cell = cell + np.searchsorted(cells.lefts, column, "right") - 1
    valid = planes[3] > 0
    d = planes[3].astype(float)
    label = cell.copy()
    fitted: dict[int, np.ndarray] = {}
    means: dict[int, np.ndarray] = {}
    for round_ in range(3):
        for c in range(len(cells)):
            members = label == c
            if not members.any():
                continue
            on = members & valid
            if round_ and c in fitted:
                on &= (d - fitted[c][0] - fitted[c][1] * row - fitted[c][2] * column) ** 2 <= CAP
            if on.sum() >= 4:
                places = np.stack([row[on] - row[on].mean(), column[on] - column[on].mean()])
                slopes = np.linalg.solve(places @ places.T + RIDGE * np.eye(2), places @ (d[on] - d[on].mean()))
                level = d[on].mean() - slopes @ [row[on].mean(), column[on].mean()]
                fitted[c] = np.array([level, *slopes])
            means[c] = np.array([*planes[:3, members].mean(axis=1), row[members].mean(), column[members].mean(),
                                 on.sum() / members.sum()])  # fmt: skip
        distances = np.full((len(cells), *shape), np.inf)
        for c, mean in means.items():
            near = np.isin(cell, [k for k in range(len(cells)) if c in cells.near[k]])
            apart = ((planes[:3] - mean[:3, None, None]) ** 2).sum(axis=0)
            apart += ((row - mean[3]) ** 2 + (column - mean[4]) ** 2) / cells.step**2
            apart += MISSING * (valid - mean[5]) ** 2
            if c in fitted:
                off = d - fitted[c][0] - fitted[c][1] * row - fitted[c][2] * column
                apart += valid * np.minimum(off**2, CAP)
            else:
                apart += valid * UNKNOWN
            distances[c][near] = apart[near]
        label = distances.argmin(axis=0)
    chosen = np.take_along_axis(distances, labels[None].astype(int), axis=0)[0]
    # Only ties between equally near centres may differ, by rounding.
    assert (chosen - distances.min(axis=0)).max() < 2e-3
    assert (labels == label).mean() > 0.98


@pytest.mark.parametrize("bands", [2, 3, 9])
def test_bands_change_nothing(bands: int) -> None:
    planes = _random_planes((47, 61))
    cells = Cells.grid(47, 61, 20)
    forms = cluster(planes, cells, iterations=3, subsample=2)
    np.testing.assert_array_equal(_assigned(planes, cells, forms, bands), _assigned(planes, cells, forms))


def test_two_slanted_planes_are_cut_where_they_cross() -> None:
    column = np.mgrid[:20, :60][1].astype(np.float32)
    planes = np.zeros((4, 20, 60), np.float32)
    # The planes cross between columns 33 and 34, away from the middle, where the cells meet.
    planes[3] = np.maximum(100 + 2 * (column - 33.5), 100 - 2 * (column - 33.5))
    cells = Cells.grid(20, 60, 2)
    labels = _assigned(planes, cells, cluster(planes, cells, iterations=8, subsample=1))
    assert (labels[:, :33] == 0).all()
    assert (labels[:, 35:] == 1).all()
