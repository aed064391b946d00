"""Made-up objects are closed, centred, of several parts and textures, and their solids match their meshes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import Delaunay

pytest.importorskip("trimesh", reason="needs the extra sgbd[synthetic]")

from sgbd.sources.categories import TOD_CATEGORIES
from sgbd.sources.synthetic.shapes import SHAPES, Shape
from sgbd.sources.synthetic.shapes.sundries import SUNDRIES, binder, convex, stand, tray
from tests.sources.synthetic.test_shapes import solid_bounds

Builder = Callable[[np.random.Generator], Shape]
BUILDERS = pytest.mark.parametrize("builder", SUNDRIES, ids=lambda builder: builder.__name__)
SEEDS = range(12)


@BUILDERS
def test_they_have_no_category(builder: Builder) -> None:
    name = builder(np.random.default_rng(0)).category
    assert name == builder.__name__
    assert name not in TOD_CATEGORIES
    assert name not in SHAPES


@BUILDERS
def test_parts_are_closed_and_bounding_boxes_centred(builder: Builder) -> None:
    for seed in SEEDS:
        shape = builder(np.random.default_rng(seed))
        bounds = np.array([piece.mesh.bounds for piece in shape.parts])
        np.testing.assert_allclose(bounds[:, 0].min(axis=0), -bounds[:, 1].max(axis=0), atol=1e-9)
        assert len(shape.parts) > 1
        assert 0.01 < shape.extents.max() < 0.9
        for piece in shape.parts:
            assert piece.mesh.is_watertight
            assert piece.mesh.volume > 0


@BUILDERS
def test_what_collides_fits_what_is_seen(builder: Builder) -> None:
    for seed in SEEDS:
        shape = builder(np.random.default_rng(seed))
        low, high = solid_bounds(shape.solids)
        # Panes and bent handles extend beyond their solids by millimetres.
        np.testing.assert_allclose(high - low, shape.extents, rtol=0.06, atol=0.014, err_msg=str(seed))


@BUILDERS
def test_most_have_parts_of_several_looks(builder: Builder) -> None:
    several = 0
    for seed in SEEDS:
        tones = set()
        for piece in builder(np.random.default_rng(seed)).parts:
            points = piece.mesh.triangles_center.astype(np.float32)
            found = piece.texture(points, piece.mesh.face_normals.astype(np.float32))
            assert found.shape == points.shape
            assert found.dtype == np.float32
            assert np.isfinite(found).all()
            assert found.min() > -0.05
            assert found.max() < 1.5
            tones.add(tuple((found.mean(axis=0) * 20).astype(int)))
        several += len(tones) > 1
    assert several >= 3


@BUILDERS
def test_a_seed_fixes_a_shape_and_another_changes_it(builder: Builder) -> None:
    first, again, other = (builder(np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.parts[0].mesh.vertices, again.parts[0].mesh.vertices)
    assert not np.allclose(first.extents, other.extents)


def test_a_convex_body_has_the_size_and_the_place_that_are_asked_for() -> None:
    size, foot = np.array([0.2, 0.1, 0.3]), np.array([1.0, 2.0, 3.0])
    for seed in range(24):
        mesh, solid = convex(np.random.default_rng(seed), size, foot)
        low, high = mesh.bounds
        np.testing.assert_allclose(low[2], 3.0, atol=1e-9)
        np.testing.assert_allclose((high - low)[2], 0.3, rtol=1e-9)
        # A roof may protrude by a twentieth.
        assert (high - low <= size * 1.06).all()
        assert (high - low >= size * 0.95).all()
        solid_low, solid_high = solid_bounds((solid,))
        np.testing.assert_allclose(solid_high - solid_low, high - low, rtol=0.05)


def test_leaves_of_a_binder_share_their_hinge() -> None:
    for seed in SEEDS:
        leaves = [part.mesh for part in binder(np.random.default_rng(seed)).parts if part.name == "leaf"]
        assert len(leaves) == 2
        apart = np.linalg.norm(leaves[0].vertices[:, None] - leaves[1].vertices[None], axis=2)
        assert apart.min() < 0.02


def test_what_falls_into_a_tray_finds_room() -> None:
    for seed in SEEDS:
        shape = tray(np.random.default_rng(seed))
        above_floor = np.array([[0.0, 0.0, shape.extents[2] / 2 - 0.001]])
        for solid in shape.solids:
            assert Delaunay(solid.size).find_simplex(above_floor)[0] == -1


def test_the_head_of_a_stand_is_above_its_foot() -> None:
    for seed in SEEDS:
        parts = {part.name: part.mesh for part in stand(np.random.default_rng(seed)).parts}
        assert parts["head"].bounds[1, 2] > parts["stem"].bounds[0, 2] > parts["foot"].bounds[0, 2]
