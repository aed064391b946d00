"""Cartons and rolls are closed, centred, and equally large in physics and rendering."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("trimesh", reason="needs the extra sgbd[synthetic]")

from sgbd.sources.categories import TOD_CATEGORIES
from sgbd.sources.synthetic.shapes import SHAPES, Shape
from sgbd.sources.synthetic.shapes.packaging import carton, roll
from tests.sources.synthetic.test_shapes import solid_bounds

BUILDERS = pytest.mark.parametrize("builder", [carton, roll])
SEEDS = range(8)


@BUILDERS
def test_packaging_has_no_category(builder: Callable[[np.random.Generator], Shape]) -> None:
    name = builder(np.random.default_rng(0)).category
    assert name == builder.__name__
    assert name not in TOD_CATEGORIES
    assert name not in SHAPES


@BUILDERS
def test_what_collides_is_what_is_seen(builder: Callable[[np.random.Generator], Shape]) -> None:
    for seed in SEEDS:
        shape = builder(np.random.default_rng(seed))
        low, high = solid_bounds(shape.solids)
        # Bevelled edges of a mesh touch the sides of its solid; the flat sides of a round mesh lie inside it.
        np.testing.assert_allclose(high - low, shape.extents, rtol=0.005, err_msg=str(seed))
        np.testing.assert_allclose(low, -high, atol=1e-6)


@BUILDERS
def test_parts_are_closed_and_bounding_boxes_centred(builder: Callable[[np.random.Generator], Shape]) -> None:
    for seed in SEEDS:
        shape = builder(np.random.default_rng(seed))
        bounds = np.array([piece.mesh.bounds for piece in shape.parts])
        np.testing.assert_allclose(bounds[:, 0].min(axis=0), -bounds[:, 1].max(axis=0), atol=1e-9)
        for piece in shape.parts:
            assert piece.mesh.is_watertight
            assert piece.mesh.volume > 0


def test_sizes_are_those_of_packaging() -> None:
    for seed in SEEDS:
        width, depth, height = carton(np.random.default_rng(seed)).extents
        assert 0.07 - 1e-6 <= height <= 0.32 + 1e-6
        assert 0.45 * height - 1e-6 <= width <= height + 1e-6
        assert 0.02 - 1e-6 <= depth <= min(width, 0.14) + 1e-6
        tin = roll(np.random.default_rng(seed)).extents
        assert 0.05 - 1e-3 <= tin[0] <= 0.22 + 1e-6
        assert tin[1] == pytest.approx(tin[0], rel=1e-3)
        assert 0.03 - 1e-6 <= tin[2] <= 0.24 + 1e-6


def test_a_carton_fills_its_box_and_a_roll_its_cylinder() -> None:
    for seed in SEEDS:
        shape = carton(np.random.default_rng(seed))
        assert shape.parts[0].mesh.volume > 0.95 * np.prod(shape.extents)
        shape = roll(np.random.default_rng(seed))
        share = shape.parts[0].mesh.volume / np.prod(shape.extents)
        assert 0.88 * np.pi / 4 < share < np.pi / 4


@BUILDERS
def test_textures_give_colours_in_range(builder: Callable[[np.random.Generator], Shape]) -> None:
    tones = set()
    for seed in SEEDS:
        for piece in builder(np.random.default_rng(seed)).parts:
            points = piece.mesh.triangles_center.astype(np.float32)
            colors = piece.texture(points, piece.mesh.face_normals.astype(np.float32))
            assert colors.shape == points.shape
            assert colors.dtype == np.float32
            assert np.isfinite(colors).all()
            assert colors.min() > -0.05
            assert colors.max() < 1.5
            tones.add(tuple((colors.mean(axis=0) * 8).astype(int)))
    assert len(tones) > 3


@BUILDERS
def test_a_seed_fixes_a_shape_and_another_changes_it(builder: Callable[[np.random.Generator], Shape]) -> None:
    first, again, other = (builder(np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.parts[0].mesh.vertices, again.parts[0].mesh.vertices)
    assert not np.allclose(first.extents, other.extents)
