"""Every category has closed parts and its characteristic features."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

pytest.importorskip("trimesh", reason="needs the extra sgbd[synthetic]")

from sgbd.sources.categories import TOD_CATEGORIES
from sgbd.sources.synthetic import meshes
from sgbd.sources.synthetic.shapes import SHAPES, Part, Shape
from sgbd.sources.synthetic.shapes.part import Solid, hollow

SEEDS = range(6)


def part(shape: Shape, name: str) -> Part:
    return next(piece for piece in shape.parts if piece.name == name)


def names(shape: Shape) -> set[str]:
    return {piece.name for piece in shape.parts}


def solidity(shape: Shape, name: str) -> float:
    """Return the share of its convex hull that a part fills: low for hollow parts."""
    mesh = part(shape, name).mesh
    return float(mesh.volume / meshes.hull(mesh.vertices).volume)


def is_round(shape: Shape, name: str, axis: int) -> bool:
    extents = np.delete(part(shape, name).mesh.extents, axis)
    return bool(abs(extents[0] - extents[1]) < 0.03 * extents.max())


def low(shape: Shape, name: str, axis: int) -> float:
    return float(part(shape, name).mesh.bounds[0, axis])


def high(shape: Shape, name: str, axis: int) -> float:
    return float(part(shape, name).mesh.bounds[1, axis])


def wide(shape: Shape, name: str) -> float:
    return high(shape, name, 0) - low(shape, name, 0)


def sticks_out(shape: Shape, name: str, body: str) -> bool:
    """Return whether a part extends beyond the body to the left or to the right."""
    return max(high(shape, name, 0), -low(shape, name, 0)) > high(shape, body, 0) + 0.01


TRAITS: dict[str, Callable[[Shape], bool]] = {
    "ashcan": lambda s: solidity(s, "bucket") < 0.35 and s.extents[2] > 0.9 * s.extents[0],
    "bag": lambda s: high(s, "handle", 2) > high(s, "body", 2) + 0.01,
    "birdhouse": lambda s: {"perch", "hole"} <= names(s) and high(s, "roof", 2) > high(s, "hole", 2),
    "bottle": lambda s: wide(s, "cap") < 0.75 * wide(s, "body") and s.extents[2] > 2 * s.extents[0],
    "bowl": lambda s: solidity(s, "bowl") < 0.5 and s.extents[2] < 0.6 * s.extents[0],
    "camera": lambda s: low(s, "lens", 1) < low(s, "body", 1) - 0.01 and is_round(s, "lens", 1),
    "can": lambda s: is_round(s, "body", 2) and solidity(s, "body") > 0.9,
    "cap": lambda s: solidity(s, "crown") < 0.35 and low(s, "peak", 1) < low(s, "crown", 1) - 0.02,
    "cellular_telephone": lambda s: bool({"screen", "keys"} & names(s)) and s.extents[0] < s.extents[1],
    "clock": lambda s: sum(p.name == "hand" for p in s.parts) == 2 and is_round(s, "dial", 1),
    "computer_keyboard": lambda s: len(part(s, "keys").mesh.faces) // 12 > 40 and s.extents[2] < 0.2 * s.extents[0],
    "dishwasher": lambda s: {"door", "handle", "controls"} <= names(s) and s.extents[2] > s.extents[0],
    "display": lambda s: low(s, "screen", 2) > high(s, "foot", 2) and "neck" in names(s),
    "helmet": lambda s: solidity(s, "shell") < 0.6 and bool({"brim", "visor", "vent"} & names(s)),
    "jar": lambda s: wide(s, "lid") < 1.02 * wide(s, "body") and is_round(s, "body", 2),
    "knife": lambda s: s.extents[0] > 3.5 * s.extents[1] and high(s, "blade", 2) - low(s, "blade", 2) < 0.006,
    "laptop": lambda s: high(s, "lid", 2) > high(s, "base", 2) + 0.05,
    "loudspeaker": lambda s: is_round(s, "driver", 1) and s.extents[2] > 1.2 * s.extents[0],
    "microwave": lambda s: {"window", "panel", "handle"} <= names(s) and s.extents[0] > 1.3 * s.extents[2],
    "mug": lambda s: solidity(s, "cup") < 0.5 and sticks_out(s, "handle", "cup"),
    "pillow": lambda s: s.extents[2] < 0.55 * s.extents[0] and solidity(s, "cushion") < 0.98,
    "pot": lambda s: solidity(s, "body") < 0.35 and sticks_out(s, "handle", "body"),
    "printer": lambda s: {"slot", "tray", "rest", "paper"} <= names(s),
    "telephone": lambda s: {"handset", "cord"} <= names(s) and bool({"keys", "dial"} & names(s)),
    "washer": lambda s: is_round(s, "door", 1) and is_round(s, "glass", 1) and s.extents[2] > s.extents[0],
}


def test_every_category_of_the_dataset_has_a_shape_and_a_trait() -> None:
    assert set(SHAPES) == set(TOD_CATEGORIES) == set(TRAITS)


@pytest.mark.parametrize("category", TOD_CATEGORIES)
def test_parts_are_closed_and_the_trait_is_there(category: str) -> None:
    for seed in SEEDS:
        shape = SHAPES[category](np.random.default_rng(seed))
        assert shape.category == category
        for piece in shape.parts:
            assert piece.mesh.is_watertight, piece.name
            assert piece.mesh.volume > 0, piece.name
        assert 0.06 < shape.extents.max() < 0.55
        assert TRAITS[category](shape), seed


@pytest.mark.parametrize("category", TOD_CATEGORIES)
def test_what_collides_fits_what_is_seen(category: str) -> None:
    for seed in SEEDS:
        shape = SHAPES[category](np.random.default_rng(seed))
        low, high = solid_bounds(shape.solids)
        tolerance = 0.012 + 0.03 * shape.extents
        assert (low > -shape.extents / 2 - tolerance).all(), seed
        assert (high < shape.extents / 2 + tolerance).all(), seed
        # No large part may extend beyond the solids: it would sink into other objects.
        assert (high - low > 0.75 * shape.extents - 0.03).all(), seed


@pytest.mark.parametrize("category", TOD_CATEGORIES)
def test_bounding_boxes_are_centred(category: str) -> None:
    shape = SHAPES[category](np.random.default_rng(0))
    bounds = np.array([piece.mesh.bounds for piece in shape.parts])
    np.testing.assert_allclose(bounds[:, 0].min(axis=0), -bounds[:, 1].max(axis=0), atol=1e-9)
    np.testing.assert_allclose(2 * bounds[:, 1].max(axis=0), shape.extents, atol=1e-9)


@pytest.mark.parametrize("category", TOD_CATEGORIES)
def test_textures_give_colours_in_range_of_several_tones(category: str) -> None:
    tones = set()
    for seed in SEEDS:
        shape = SHAPES[category](np.random.default_rng(seed))
        for piece in shape.parts:
            points = piece.mesh.triangles_center.astype(np.float32)
            colors = piece.texture(points, piece.mesh.face_normals.astype(np.float32))
            assert colors.shape == points.shape
            assert colors.dtype == np.float32
            assert np.isfinite(colors).all()
            assert colors.min() > -0.05
            assert colors.max() < 1.5
            tones.add(tuple((colors.mean(axis=0) * 8).astype(int)))
    assert len(tones) > 3


def test_a_seed_fixes_a_shape_and_another_changes_it() -> None:
    first, again, other = (SHAPES["mug"](np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.parts[0].mesh.vertices, again.parts[0].mesh.vertices)
    assert not np.allclose(first.extents, other.extents)


def test_a_hollow_wall_leaves_its_inside_free() -> None:
    solids = hollow([(0.5, 0), (0.5, 1)], [(0.4, 0.1), (0.4, 1)], sections=12)
    for solid in solids[:-1]:
        radii = np.linalg.norm(solid.size[:, :2], axis=1)
        inner = solid.size[radii < 0.45]
        # The inner face of a wedge is a chord, at least cos(15 degrees) of the inner radius from the axis.
        assert np.linalg.norm((inner[0, :2] + inner[-1, :2]) / 2) > 0.4 * np.cos(np.pi / 12) - 1e-9
    assert solids[-1].kind == "cylinder"


def solid_bounds(solids: tuple[Solid, ...]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    boxes = []
    for solid in solids:
        if solid.kind == "hull":
            corners = solid.size
        else:
            half = solid.size if solid.kind == "box" else np.array([solid.size[0], solid.size[0], solid.size[1]])
            signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
            corners = (signs * half) @ solid.turn.T
        boxes.append((corners.min(axis=0) + solid.center, corners.max(axis=0) + solid.center))
    return np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)
