"""The components of an object: visible parts and solids for collision."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import trimesh

from sgbd.sources.synthetic.meshes import axis_rotation
from sgbd.sources.synthetic.textures import Texture

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Part:
    """A closed surface with one texture.

    Attributes:
        name: Name of the part, such as `handle`.
        mesh: Mesh in the object's frame, metres.
        texture: Texture of the surface.
    """

    name: str
    mesh: trimesh.Trimesh
    texture: Texture


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex body for the physics simulation.

    Attributes:
        kind: `box`, `cylinder` or `hull`.
        size: Half lengths [3] of a box; (radius, half height) of a cylinder; points [n, 3] of a hull. Metres.
        center: Position in the object's frame.
        turn: Rotation [3, 3] in the object's frame.
    """

    kind: str
    size: Floats
    center: Floats = field(default_factory=lambda: np.zeros(3))
    turn: Floats = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True, eq=False)
class Shape:
    """One object; z points up in its normal orientation, and the origin is the centre of its bounding box.

    Attributes:
        category: Category name.
        parts: Visible parts.
        solids: Collision bodies. They follow the parts closely, so that contacts look right in the image.
        upright: Probability that the object is dropped upright.
    """

    category: str
    parts: tuple[Part, ...]
    solids: tuple[Solid, ...]
    upright: float = 0.6

    @property
    def extents(self) -> Floats:
        """Lengths of the bounding box along x, y, z, metres."""
        low = np.min([part.mesh.bounds[0] for part in self.parts], axis=0)
        high = np.max([part.mesh.bounds[1] for part in self.parts], axis=0)
        return high - low


def solid_box(size: npt.ArrayLike, center: npt.ArrayLike = (0, 0, 0), turn: Floats | None = None) -> Solid:
    """Return a box from its full lengths."""
    return Solid("box", np.asarray(size, float) / 2, np.asarray(center, float), np.eye(3) if turn is None else turn)


def solid_cylinder(radius: float, height: float, center: npt.ArrayLike = (0, 0, 0), axis: str = "z") -> Solid:
    """Return a cylinder along an axis from its radius and full height."""
    return Solid("cylinder", np.array([radius, height / 2]), np.asarray(center, float), axis_rotation(axis))


def solid_hull(points: npt.ArrayLike) -> Solid:
    """Return the convex hull of points [n, 3]."""
    return Solid("hull", np.asarray(points, float))


def hollow(outer: npt.ArrayLike, inner: npt.ArrayLike, sections: int = 10, floor: bool = True) -> list[Solid]:
    """Return the wall of a round vessel as wedges, so that other objects can fall into it.

    Args:
        outer: (radius, height) at the bottom and at the top of the outside, [2, 2].
        inner: (radius, height) at the bottom and at the top of the inside, [2, 2].
        sections: Number of wedges.
        floor: Whether the vessel has a floor.

    Returns:
        The wedges, and a disc for the floor between the two lower heights.
    """
    (r0, z0), (r1, z1) = np.asarray(outer, float)
    (q0, w0), (q1, w1) = np.asarray(inner, float)
    edges = np.linspace(0, 2 * np.pi, sections + 1)
    # The flat outer side of a wedge lies inside the circle: move its corners outwards to keep the mean radius.
    swell = 0.5 * (1 + 1 / np.cos(np.pi / sections))
    solids = []
    for a, b in pairwise(edges):
        points = [
            (r * k * np.cos(t), r * k * np.sin(t), z)
            for t in (a, b)
            for r, z, k in ((r0, z0, swell), (r1, z1, swell), (q0, w0, 1.0), (q1, w1, 1.0))
        ]
        solids.append(solid_hull(points))
    if floor:
        solids.append(solid_cylinder(r0, max(w0 - z0, 0.004), (0, 0, (z0 + w0) / 2)))
    return solids


def squashed(solids: Iterable[Solid], squash: float) -> list[Solid]:
    """Return solids scaled along y: hulls exactly, a floor disc by its shorter radius."""
    return [
        solid_hull(solid.size * [1, squash, 1])
        if solid.kind == "hull"
        else Solid(solid.kind, solid.size * [squash, 1], solid.center, solid.turn)
        for solid in solids
    ]


def assemble(category: str, parts: list[Part], solids: list[Solid], upright: float = 0.6) -> Shape:
    """Return a shape, moved so that its bounding box is centred on the origin.

    Textures stay defined in the original frame: they are wrapped to be called with points shifted back.
    """
    low = np.min([part.mesh.bounds[0] for part in parts], axis=0)
    high = np.max([part.mesh.bounds[1] for part in parts], axis=0)
    middle = (low + high) / 2
    moved_parts = []
    for part in parts:
        mesh = part.mesh.copy()
        mesh.apply_translation(-middle)
        moved_parts.append(
            Part(part.name, mesh, Shifted(part.texture, middle.astype(np.float32), gloss=part.texture.gloss))
        )
    moved_solids = tuple(
        Solid(s.kind, s.size - middle, s.center, s.turn)
        if s.kind == "hull"
        else Solid(s.kind, s.size, s.center - middle, s.turn)
        for s in solids
    )
    return Shape(category, tuple(moved_parts), moved_solids, upright)


@dataclass(frozen=True, eq=False)
class Shifted(Texture):
    """A texture defined in a translated frame.

    Attributes:
        texture: The texture.
        shift: float32 [3], added to points before calling the texture.
    """

    texture: Texture
    shift: npt.NDArray[np.float32]

    def __call__(self, points: npt.NDArray[np.float32], normals: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Return the colour of surface points."""
        return self.texture(points + self.shift, normals)
