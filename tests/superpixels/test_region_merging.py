import numpy as np
import numpy.typing as npt
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.adjacency import border_pairs
from sgbd.superpixels.connect import renumber
from sgbd.superpixels.region_merging import merge_alike
from sgbd.superpixels.slanted_planes import RIDGE
from tests.label_maps import label_maps


def _planes(shape: tuple[int, ...], seed: int, missing: float) -> npt.NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    planes = rng.normal(0, 3, (4, *shape)).astype(np.float32)
    planes[3] = np.where(rng.random(shape) < missing, 0, 100 + planes[3])
    return planes


def _error(planes: npt.NDArray[np.float32], inside: npt.NDArray[np.bool_]) -> tuple[float, float]:
    """Return the squared errors of the colours and of the fitted plane, computed directly from the pixels."""
    colors = planes[:3, inside].astype(float)
    colors_error = float(((colors - colors.mean(axis=1, keepdims=True)) ** 2).sum())
    row, column = np.nonzero(inside & (planes[3] > 0))
    if len(row) == 0:
        return colors_error, 0.0
    d = planes[3, row, column].astype(float)
    places = np.stack([row - row.mean(), column - column.mean()])
    slopes = np.linalg.solve(places @ places.T + RIDGE * np.eye(2), places @ d)
    off = d - d.mean() - slopes @ places
    return colors_error, float((off**2).sum() + RIDGE * (slopes**2).sum())


def _merged(
    label_map: npt.NDArray[np.int32],
    planes: npt.NDArray[np.float32],
    n_segments: int,
    tolerance: float,
    min_size: int,
) -> npt.NDArray[np.int32]:
    """The definition: evaluate all pairs of neighbours, merge the cheapest, and repeat."""
    label_map = label_map.copy()
    only_fragments = False
    while True:
        sizes = np.bincount(label_map.ravel())
        costs = {}
        for i, j in border_pairs(label_map).T.tolist():
            one, other = label_map == i, label_map == j
            whole, first, second = (_error(planes, inside) for inside in (one | other, one, other))
            both_known = (planes[3, one] > 0).any() and (planes[3, other] > 0).any()
            rises = [w - f - s for w, f, s in zip(whole, first, second, strict=True)]
            costs[i, j] = rises[0] + (max(rises[1], 0.0) if both_known else 0.0)
        if only_fragments:
            costs = {pair: cost for pair, cost in costs.items() if min(sizes[list(pair)]) < min_size}
        if not costs:
            return label_map
        i, j = min(costs, key=lambda pair: costs[pair])
        if not only_fragments and len(sizes) <= n_segments and costs[i, j] > tolerance:
            only_fragments = True
            continue
        label_map[label_map == j] = i
        label_map = renumber(label_map)


@given(
    label_maps(8),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.3, 1.0]),
    st.integers(1, 12),
    st.sampled_from([0.0, 20.0, 200.0]),
    st.integers(0, 12),
)
@settings(max_examples=40, deadline=None)
def test_merging_is_that_of_looking_at_all_pairs_every_time(
    label_map: npt.NDArray[np.int32], seed: int, missing: float, n_segments: int, tolerance: float, min_size: int
) -> None:
    planes = _planes(label_map.shape, seed, missing)
    merged = merge_alike(label_map, planes, n_segments, tolerance, min_size)
    assert merged.dtype == np.int32
    np.testing.assert_array_equal(merged, _merged(label_map, planes, n_segments, tolerance, min_size))


def test_the_cost_of_colours_is_that_of_ward() -> None:
    # Two pixels of 0 beside one of 3: 2 * 1 / 3 * 9 = 6.
    label_map = np.array([[0, 0, 1]], np.int32)
    planes = np.zeros((4, 1, 3), np.float32)
    planes[0, 0, 2] = 3
    assert merge_alike(label_map, planes, 5, 6.001, 0).tolist() == [[0, 0, 0]]
    assert merge_alike(label_map, planes, 5, 5.999, 0).tolist() == [[0, 0, 1]]


def test_a_slanted_surface_is_one_and_a_step_is_two() -> None:
    label_map = np.repeat(np.arange(4, dtype=np.int32), 10)[None].repeat(20, axis=0)
    planes = np.zeros((4, 20, 40), np.float32)
    column = np.mgrid[:20, :40][1]
    planes[3] = 100 + 2 * column
    assert merge_alike(label_map, planes, 4, 250.0, 0).max() == 0
    planes[3] += 20 * (column >= 20)
    np.testing.assert_array_equal(merge_alike(label_map, planes, 4, 250.0, 0), column // 20)


def test_fragments_go_where_they_cost_least_and_not_where_their_border_is_longest() -> None:
    label_map = np.zeros((6, 9), np.int32)
    label_map[:, 5:] = 1
    label_map[2:4, 3:5] = 2
    label_map = renumber(label_map)
    planes = np.zeros((4, 6, 9), np.float32)
    planes[0, :, 5:] = 10
    planes[0, 2:4, 3:5] = 9
    fragment = label_map[2, 3]
    merged = merge_alike(label_map, planes, 9, 0.0, 5)
    assert fragment == 2
    assert (merged[2:4, 3:5] == merged[0, 8]).all()
    assert merged.max() == 1
