import numpy as np
import pytest

from sgbd.superpixels.local_k_means import Cells, Samples, assign, batches, cluster, work_space

SHAPES = [(1, 1), (1, 50), (50, 1), (3, 3), (37, 53), (48, 64), (101, 7)]


def _assigned(planes: np.ndarray, cells: Cells, forms: np.ndarray, parts: int = 1) -> np.ndarray:
    rows = len(cells.tops) - 1
    labels = np.full(planes.shape[1:], -1, np.int32)
    for k in range(parts):
        first, last = rows * k // parts, rows * (k + 1) // parts
        assign(planes, batches(cells, first, last), cells.near, forms, *work_space(cells), labels)
    return labels


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("n_segments", [1, 2, 12, 100, 10_000])
def test_cells_tile_the_image(shape: tuple[int, int], n_segments: int) -> None:
    cells = Cells.grid(*shape, n_segments)
    assert cells.tops[0] == cells.lefts[0] == 0
    assert (cells.tops[-1], cells.lefts[-1]) == shape
    assert np.diff(cells.tops).min() >= 1
    assert np.diff(cells.lefts).min() >= 1
    assert len(cells) == (len(cells.tops) - 1) * (len(cells.lefts) - 1) <= shape[0] * shape[1]
    if n_segments <= min(shape):
        assert n_segments / 2 <= len(cells) <= 2 * n_segments


def test_the_cells_near_a_cell_are_the_nine_around_it() -> None:
    cells = Cells.grid(30, 40, 12)
    assert (len(cells.tops), len(cells.lefts)) == (4, 5)
    assert cells.near[5].tolist() == [0, 1, 2, 4, 5, 6, 8, 9, 10]
    assert set(cells.near[0].tolist()) == {0, 1, 4, 5}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("n_segments", [1, 12, 10_000])
def test_samples_lie_in_their_cells(shape: tuple[int, int], n_segments: int) -> None:
    cells = Cells.grid(*shape, n_segments)
    samples = Samples.of(cells, 4)
    assert np.diff(samples.offsets).min() >= 1
    assert len(np.unique(samples.pixels)) == len(samples.pixels) == samples.offsets[-1]
    row, column = np.divmod(samples.pixels, shape[1])
    np.testing.assert_array_equal(samples.positions, [row, column])
    cell_row = np.searchsorted(cells.tops, row, side="right") - 1
    cell_column = np.searchsorted(cells.lefts, column, side="right") - 1
    expected = np.repeat(np.arange(len(cells)), np.diff(samples.offsets))
    np.testing.assert_array_equal(cell_row * (len(cells.lefts) - 1) + cell_column, expected)


@pytest.mark.parametrize("shape", [*SHAPES, (40, 1200), (600, 30)])
@pytest.mark.parametrize("n_segments", [1, 12, 10_000])
def test_batches_tile_their_cells_and_fit_the_work_space(shape: tuple[int, int], n_segments: int) -> None:
    cells = Cells.grid(*shape, n_segments)
    cell_rows, room = len(cells.tops) - 1, work_space(cells)[0].shape[1]
    found = np.full(shape, -1)
    for first, last in ((0, cell_rows // 2), (cell_rows // 2, cell_rows)):
        for cell, top, left, rows, width in batches(cells, first, last):
            assert 0 < rows * width <= room
            assert (found[top : top + rows, left : left + width] == -1).all()
            found[top : top + rows, left : left + width] = cell
    row, column = np.indices(shape)
    cell_row = np.searchsorted(cells.tops, row, side="right") - 1
    cell_column = np.searchsorted(cells.lefts, column, side="right") - 1
    np.testing.assert_array_equal(found, cell_row * (len(cells.lefts) - 1) + cell_column)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
def test_clustering_is_that_of_plain_loops(shape: tuple[int, int], weighted: bool) -> None:
    rng = np.random.default_rng(sum(shape))
    planes = rng.normal(size=(3, *shape)).astype(np.float32)
    if weighted:
        planes[1] = rng.random(shape) < 0.8
        planes[0] *= planes[1]
        planes[2] = 0
    cells = Cells.grid(*shape, 12)
    labels = _assigned(planes, cells, cluster(planes, cells, weighted, iterations=2, subsample=1))
    row, column = np.mgrid[: shape[0], : shape[1]]

    # The oracle computes means and distances as in the paper.
    cell = (np.searchsorted(cells.tops, row, "right") - 1) * (len(cells.lefts) - 1)
    cell = cell + np.searchsorted(cells.lefts, column, "right") - 1
    weight = planes[1].astype(float) if weighted else np.ones(shape)
    features = planes[:1] if weighted else planes
    label = cell.copy()
    center_row = (cells.tops[:-1] + cells.tops[1:] - 1)[cell // (len(cells.lefts) - 1)] / 2
    positions = {c: (center_row[cell == c][0], column[cell == c].mean()) for c in range(len(cells))}
    means: dict[int, np.ndarray] = {}
    for _ in range(3):
        for c in range(len(cells)):
            members = (label == c) & (weight > 0)
            if members.any():
                positions[c] = (row[members].mean(), column[members].mean())
                means[c] = features[:, members].astype(float).mean(axis=1)
        distances = np.full((len(cells), *shape), np.inf)
        for c in range(len(cells)):
            if c in means:
                apart = ((features.astype(float) - means[c][:, None, None]) ** 2).sum(axis=0)
            else:
                apart = np.full(shape, 1e4)
            squared = (row - positions[c][0]) ** 2 + (column - positions[c][1]) ** 2
            near = np.isin(cell, [k for k in range(len(cells)) if c in cells.near[k]])
            distances[c][near] = (weight * apart + squared / cells.step**2)[near]
        label = distances.argmin(axis=0)
    chosen = np.take_along_axis(distances, labels[None].astype(int), axis=0)[0]
    # Only ties between equally near centres may differ, by rounding.
    assert (chosen - distances.min(axis=0)).max() < 1e-3
    assert (labels == label).mean() > 0.98


@pytest.mark.parametrize("bands", [2, 3, 9])
def test_bands_change_nothing(bands: int) -> None:
    planes = np.random.default_rng(4).normal(size=(3, 47, 61)).astype(np.float32)
    cells = Cells.grid(47, 61, 20)
    forms = cluster(planes, cells, False, iterations=3, subsample=2)
    np.testing.assert_array_equal(_assigned(planes, cells, forms, bands), _assigned(planes, cells, forms))


def test_missing_pixels_pull_no_centre() -> None:
    cells = Cells.grid(10, 20, 2)
    planes = np.zeros((3, 10, 20), np.float32)
    planes[0, :, 5:10], planes[1, :, 5:10] = 3, 1
    known, unknown = cluster(planes, cells, True, iterations=0, subsample=1)
    # The left cell is valid in columns 5 to 9, at depth 3. The right cell has no valid pixel: its centre stays put.
    np.testing.assert_allclose(known, [-6, 9, 0, -2 * 4.5 / 100, -2 * 7 / 100, (4.5**2 + 7**2) / 100], rtol=1e-6)
    np.testing.assert_allclose(unknown[3:], [-2 * 4.5 / 100, -2 * 14.5 / 100, (4.5**2 + 14.5**2) / 100], rtol=1e-6)
    labels = _assigned(planes, cells, np.stack([known, unknown]))
    # Valid pixels avoid the centre without depth; missing pixels are assigned by position.
    assert (labels[:, 5:10] == 0).all()
    assert (labels[:, 12:] == 1).all()


def test_small_cells_are_sampled_densely() -> None:
    assert np.diff(Samples.of(Cells.grid(60, 80, 300), 4).offsets).min() >= 9
    assert np.diff(Samples.of(Cells.grid(480, 640, 128), 4).offsets).max() < 200
