"""Closed triangle meshes that objects and furniture are built from."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import ConvexHull

Vector = npt.ArrayLike
Points = npt.NDArray[np.float64]

_BOX_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)


def box(size: Vector, center: Vector = (0, 0, 0), bevel: float = 0.0) -> trimesh.Trimesh:
    """Return a box with bevelled edges.

    Args:
        size: Lengths along x, y, z, metres.
        center: Centre of the box.
        bevel: Width of the bevel, metres; limited to 45 % of the smallest length.
    """
    half = np.asarray(size, dtype=np.float64) / 2
    bevel = min(bevel, 0.9 * float(half.min()))
    if bevel <= 0:
        lengths = 2 * half
        foot = np.asarray(center, dtype=np.float64) - [0, 0, half[2]]
        return block(frustum(lengths[:2], lengths[:2], lengths[2], at=foot))
    corners = [_BOX_SIGNS * (half - bevel * (1 - np.eye(3)[axis])) for axis in range(3)]
    return hull(np.concatenate(corners) + np.asarray(center, dtype=np.float64))


def hull(points: Vector) -> trimesh.Trimesh:
    """Return the convex hull of points [n, 3]."""
    array = np.asarray(points, dtype=np.float64)
    found = ConvexHull(array)
    used, faces = np.unique(found.simplices, return_inverse=True)
    faces = faces.reshape(-1, 3)
    vertices = array[used]
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = (normals * found.equations[:, :3]).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    return trimesh.Trimesh(vertices, faces, process=False)


def block(corners: Points) -> trimesh.Trimesh:
    """Return the solid with the eight corners of a `frustum`; much faster than `hull`."""
    faces = [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
    return trimesh.Trimesh(corners, np.array(faces), process=False)


def frustum(
    bottom: npt.ArrayLike,
    top: npt.ArrayLike,
    height: float,
    shift: tuple[float, float] = (0, 0),
    at: Vector = (0, 0, 0),
) -> Points:
    """Return the eight corners [8, 3] of a box whose top and bottom may differ in size and position.

    Args:
        bottom: Lengths of the bottom along x and y, metres.
        top: Lengths of the top along x and y, metres.
        height: Distance from bottom to top.
        shift: Offset in x and y of the top's centre from the bottom's centre.
        at: Centre of the bottom.
    """
    corners = []
    for (lx, ly), (sx, sy), z in ((np.asarray(bottom), (0, 0), 0.0), (np.asarray(top), shift, height)):
        corners += [[sx + x * lx / 2, sy + y * ly / 2, z] for x in (-1, 1) for y in (-1, 1)]
    return np.asarray(corners, dtype=np.float64) + np.asarray(at, dtype=np.float64)


def lathe(profile: Vector, sections: int = 28, squash: float = 1.0) -> trimesh.Trimesh:
    """Return the solid of revolution of a profile about the z axis.

    Args:
        profile: (radius, height) [n, 2], counter-clockwise around the solid with the radius pointing right: from the
            axis along the bottom, up the outside, and back to the axis along the top or the inner wall. A closed
            profile gives a ring.
        sections: Number of flat sides.
        squash: Scale factor along y, for oval shapes.
    """
    mesh = trimesh.creation.revolve(np.asarray(profile, dtype=np.float64), sections=sections)
    if squash != 1.0:
        mesh.apply_scale([1.0, squash, 1.0])
    return mesh


def cylinder(
    radius: float, height: float, center: Vector = (0, 0, 0), axis: str = "z", sections: int = 24
) -> trimesh.Trimesh:
    """Return a solid cylinder along an axis, with slightly bevelled edges."""
    edge = 0.08 * min(radius, height)
    mesh = lathe(
        [
            (0, -height / 2),
            (radius - edge, -height / 2),
            (radius, -height / 2 + edge),
            (radius, height / 2 - edge),
            (radius - edge, height / 2),
            (0, height / 2),
        ],
        sections,
    )
    return placed(mesh, center, axis)


def ring(
    inner: float, outer: float, height: float, center: Vector = (0, 0, 0), axis: str = "z", sections: int = 28
) -> trimesh.Trimesh:
    """Return a flat ring along an axis."""
    low, high = -height / 2, height / 2
    mesh = lathe([(inner, low), (outer, low), (outer, high), (inner, high), (inner, low)], sections)
    return placed(mesh, center, axis)


def placed(mesh: trimesh.Trimesh, center: Vector, axis: str = "z") -> trimesh.Trimesh:
    """Rotate a mesh from the z axis to another axis and move it, in place."""
    turn = np.eye(4)
    turn[:3, :3] = axis_rotation(axis)
    turn[:3, 3] = np.asarray(center, dtype=np.float64)
    mesh.apply_transform(turn)
    return mesh


def axis_rotation(axis: str) -> Points:
    """Return the rotation [3, 3] that maps z to `x`, `y`, `z`, `-x`, `-y` or `-z`."""
    rotations = {
        "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
        "x": [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
        "-x": [[0, 0, -1], [-1, 0, 0], [0, 1, 0]],
        "y": [[-1, 0, 0], [0, 0, 1], [0, 1, 0]],
        "-y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    }
    return np.asarray(rotations[axis], dtype=np.float64)


def rotation(axis: str, angle: float) -> Points:
    """Return the rotation [3, 3] about `x`, `y` or `z` by an angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def moved(mesh: trimesh.Trimesh, turn: Points | None = None, shift: Vector = (0, 0, 0)) -> trimesh.Trimesh:
    """Rotate a mesh about the origin and then translate it, in place."""
    transform = np.eye(4)
    if turn is not None:
        transform[:3, :3] = turn
    transform[:3, 3] = np.asarray(shift, dtype=np.float64)
    mesh.apply_transform(transform)
    return mesh


def ellipsoid(radii: Vector, center: Vector = (0, 0, 0), subdivisions: int = 3) -> trimesh.Trimesh:
    """Return an ellipsoid."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    mesh.apply_scale(np.asarray(radii, dtype=np.float64))
    mesh.apply_translation(np.asarray(center, dtype=np.float64))
    return mesh


def cushion(size: Vector, power: float = 3.0, steps: int = 20) -> trimesh.Trimesh:
    """Return a stuffed cushion: thick in the middle, thin at the seam, with pointed corners.

    Args:
        size: Lengths along x, y, z, metres.
        power: Squareness of the thick area; larger is squarer.
        steps: Number of grid cells along each side.
    """
    lx, ly, lz = np.asarray(size, dtype=np.float64)
    line = np.sin(np.linspace(-np.pi / 2, np.pi / 2, steps + 1))
    x, y = np.meshgrid(line, line, indexing="ij")
    swell = np.sqrt(np.clip((1 - np.abs(x) ** power) * (1 - np.abs(y) ** power), 0, None))
    waist = 1 - 0.07 * (1 - y**2), 1 - 0.07 * (1 - x**2)
    plan = np.stack([x * waist[0] * lx / 2, y * waist[1] * ly / 2], axis=-1)
    seam = 0.03 * lz
    top = np.concatenate([plan, (seam + swell * (lz / 2 - seam))[..., None]], axis=-1).reshape(-1, 3)
    bottom = top * [1, 1, -1]
    index = np.arange(top.shape[0]).reshape(x.shape)
    a, b, c, d = index[:-1, :-1].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel(), index[:-1, 1:].ravel()
    upper = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    outline = np.concatenate([index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1]])
    following, under = np.roll(outline, -1), top.shape[0]
    side = np.concatenate(
        [
            np.stack([outline + under, following + under, following], 1),
            np.stack([outline + under, following, outline], 1),
        ]
    )
    faces = np.concatenate([upper, upper[:, ::-1] + under, side])
    return trimesh.Trimesh(np.concatenate([top, bottom]), faces, process=False)


def tube(path: Vector, radius: float | Vector, sections: int = 8, flatten: float = 1.0) -> trimesh.Trimesh:
    """Sweep a circle along an open path, with closed ends.

    Args:
        path: Points [n, 3].
        radius: Radius in metres, a single value or one per point.
        sections: Number of sides of the circle.
        flatten: Thickness of the cross-section perpendicular to the plane of the path, relative to the radius.
    """
    points = np.asarray(path, dtype=np.float64)
    radii = np.broadcast_to(np.asarray(radius, dtype=np.float64), points.shape[:1])
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    # The normal of the path's plane, or any perpendicular of a straight path, gives a frame that does not twist.
    across = np.cross(points[-1] - points[0], points[len(points) // 2] - points[0])
    if np.linalg.norm(across) < 1e-9:
        across = np.cross(tangent[0], np.eye(3)[np.argmin(np.abs(tangent[0]))])
    across = across / np.linalg.norm(across)
    inward = np.cross(tangent, across)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    angle = np.linspace(0, 2 * np.pi, sections, endpoint=False)
    circle = inward[:, None] * np.cos(angle)[None, :, None] + flatten * across * np.sin(angle)[None, :, None]
    vertices = (points[:, None] + radii[:, None, None] * circle).reshape(-1, 3)
    vertices = np.concatenate([vertices, points[[0, -1]]])
    first = np.arange(sections)
    after = np.roll(first, -1)
    faces = []
    for k in range(len(points) - 1):
        low, high = k * sections, (k + 1) * sections
        faces += [
            np.stack([first + low, after + low, after + high], 1),
            np.stack([first + low, after + high, first + high], 1),
        ]
    start, end = len(vertices) - 2, len(vertices) - 1
    last = (len(points) - 1) * sections
    faces += [
        np.stack([after, first, np.full(sections, start)], 1),
        np.stack([first + last, after + last, np.full(sections, end)], 1),
    ]
    mesh = trimesh.Trimesh(vertices, np.concatenate(faces), process=False)
    if mesh.volume < 0:
        mesh.invert()
    return mesh


def arc(
    center: Vector, radii: tuple[float, float], start: float, stop: float, plane: str = "xz", steps: int = 12
) -> Points:
    """Return points on an elliptic arc, for `tube`.

    Args:
        center: Centre of the ellipse.
        radii: Radii along the first and second axis of the plane, metres.
        start: First angle, radians from the first axis of the plane.
        stop: Last angle, radians.
        plane: `xy`, `xz` or `yz`.
        steps: Number of points.
    """
    angle = np.linspace(start, stop, steps)
    points = np.tile(np.asarray(center, dtype=np.float64), (steps, 1))
    for axis, radius, wave in zip(plane, radii, (np.cos(angle), np.sin(angle)), strict=True):
        points[:, "xyz".index(axis)] += radius * wave
    return points


def joined(meshes: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Concatenate closed meshes; they may overlap, since only the outside is visible."""
    vertices, faces, count = [], [], 0
    for mesh in meshes:
        vertices.append(mesh.vertices)
        faces.append(mesh.faces + count)
        count += len(mesh.vertices)
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)
