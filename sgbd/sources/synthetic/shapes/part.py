"""What an object is made of: parts to be seen, solids to collide with."""

from __future__ import annotations

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
        name: What it is, such as `handle`.
        mesh: In the object's frame, metres.
        texture: Its look.
    """

    name: str
    mesh: trimesh.Trimesh
    texture: Texture


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex body for the physics.

    Attributes:
        kind: `box`, `cylinder` or `hull`.
        size: Half lengths [3] of a box; (radius, half height) of a cylinder; points [n, 3] of a hull. Metres.
        center: Place in the object's frame.
        turn: Rotation [3, 3] in the object's frame.
    """

    kind: str
    size: Floats
    center: Floats = field(default_factory=lambda: np.zeros(3))
    turn: Floats = field(default_factory=lambda: np.eye(3))


@dataclass(frozen=True, eq=False)
class Shape:
    """One object: z is up when it stands as it is used; the origin is the middle of its bounding box.

    Attributes:
        category: Name of its category.
        parts: What is seen.
        solids: What collides. They follow the parts closely, so that what touches there touches in the picture.
        upright: Probability that it is dropped standing up.
    """

    category: str
    parts: tuple[Part, ...]
    solids: tuple[Solid, ...]
    upright: float = 0.6

    @property
    def radius(self) -> float:
        """Radius of the smallest ball about the origin that holds the parts, metres."""
        return max(float(np.linalg.norm(part.mesh.vertices, axis=1).max()) for part in self.parts)

    @property
    def extents(self) -> Floats:
        """Lengths of the bounding box along x, y, z, metres."""
        low = np.min([part.mesh.bounds[0] for part in self.parts], axis=0)
        high = np.max([part.mesh.bounds[1] for part in self.parts], axis=0)
        return high - low


def solid_box(size: npt.ArrayLike, center: npt.ArrayLike = (0, 0, 0), turn: Floats | None = None) -> Solid:
    """Return a box by its full lengths."""
    return Solid("box", np.asarray(size, float) / 2, np.asarray(center, float), np.eye(3) if turn is None else turn)


def solid_cylinder(radius: float, height: float, center: npt.ArrayLike = (0, 0, 0), axis: str = "z") -> Solid:
    """Return a cylinder along an axis by its radius and full height."""
    return Solid("cylinder", np.array([radius, height / 2]), np.asarray(center, float), axis_rotation(axis))


def solid_hull(points: npt.ArrayLike) -> Solid:
    """Return the convex hull of points [n, 3]."""
    return Solid("hull", np.asarray(points, float))


def hollow(outer: npt.ArrayLike, inner: npt.ArrayLike, sections: int = 10) -> tuple[Solid, ...]:
    """Return the wall of a turned vessel as wedges, so that other things can fall into it.

    Args:
        outer: (radius, height) at the bottom and at the top of the outside, [2, 2].
        inner: The same of the inside.
        sections: Number of wedges.

    Returns:
        The wedges, and a disc for the floor between the two lower heights.
    """
    (r0, z0), (r1, z1) = np.asarray(outer, float)
    (q0, w0), (q1, w1) = np.asarray(inner, float)
    edges = np.linspace(0, 2 * np.pi, sections + 1)
    # The wedge's flat outer side would lie inside of the circle: push its corners out to the same mean radius.
    swell = 0.5 * (1 + 1 / np.cos(np.pi / sections))
    solids = []
    for a, b in pairwise(edges):
        points = [
            (r * k * np.cos(t), r * k * np.sin(t), z)
            for t in (a, b)
            for r, z, k in ((r0, z0, swell), (r1, z1, swell), (q0, w0, 1.0), (q1, w1, 1.0))
        ]
        solids.append(solid_hull(points))
    solids.append(solid_cylinder(r0, max(w0 - z0, 0.004), (0, 0, (z0 + w0) / 2)))
    return tuple(solids)


def assemble(category: str, parts: list[Part], solids: list[Solid], upright: float = 0.6) -> Shape:
    """Return a shape, moved so that its bounding box is centred on the origin.

    Meshes move; textures keep the frame in which they were written down, so they are called with shifted points.
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
    """A texture in a frame that lies elsewhere.

    Attributes:
        texture: The texture.
        shift: float32 [3], what is added to points before it is called.
    """

    texture: Texture
    shift: npt.NDArray[np.float32]

    def __call__(self, points: npt.NDArray[np.float32], normals: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Return the colour of surface points."""
        return self.texture(points + self.shift, normals)
