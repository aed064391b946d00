"""Render a scene by ray casting: exact depth and labels, textured and lit colours.

Rays are traced with Embree: I. Wald, S. Woop, C. Benthin, G. S. Johnson, M. Ernst, "Embree: a kernel framework for
efficient CPU ray tracing", ACM Transactions on Graphics 33(4), 2014, doi:10.1145/2601097.2601199.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from sgbd.frame import Intrinsics
from sgbd.sources.synthetic import shading
from sgbd.sources.synthetic.room import Placed

Floats = npt.NDArray[np.float32]

CREASE = np.cos(np.deg2rad(42))
"""Cosine of the largest angle between faces that are shaded as one smooth surface."""
LIFT = 6e-4
"""Offset of secondary ray origins from the surface, relative to the depth (at least 1 m)."""
TILE = 4
"""Side of a tile of pixels, pixels: each pixel of a tile uses a different light sample."""
SURROUNDINGS = 0.35
"""Distance within which other surfaces block ambient light (ambient occlusion), metres."""


@dataclass(frozen=True, eq=False)
class Light:
    """A spherical light source.

    Attributes:
        position: float64 [3], metres.
        radius: Metres; larger lights cast softer shadows.
        color: float32 [3], irradiance on a surface facing the light at distance `reach`.
        reach: Reference distance of `color`, metres.
    """

    position: npt.NDArray[np.float64]
    radius: float
    color: Floats
    reach: float


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera in the room.

    Attributes:
        position: float64 [3], in the room, metres.
        turn: float64 [3, 3], rotation from the camera's frame (x right, y down, z forward) to the room's.
        intrinsics: Focal lengths and principal point, pixels.
        width: Image width, pixels.
        height: Image height, pixels.
    """

    position: npt.NDArray[np.float64]
    turn: npt.NDArray[np.float64]
    intrinsics: Intrinsics
    width: int
    height: int

    @classmethod
    def looking_at(
        cls,
        position: npt.NDArray[np.float64],
        target: npt.NDArray[np.float64],
        roll: float,
        intrinsics: Intrinsics,
        width: int,
        height: int,
    ) -> Camera:
        """Return a camera that looks from a position at a target; `roll` (radians) rotates the image."""
        forward = (target - position) / np.linalg.norm(target - position)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        turn = np.stack([right, down, forward], axis=1)
        c, s = np.cos(roll), np.sin(roll)
        return cls(position, turn @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), intrinsics, width, height)

    def rays(self, step: int = 1) -> Floats:
        """Return the ray [H/step, W/step, 3] of every step-th pixel, scaled so that ray parameters are depths."""
        k = self.intrinsics
        x = (np.arange(0, self.width, step) - k.cx) / k.fx
        y = (np.arange(0, self.height, step) - k.cy) / k.fy
        grid = np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))], axis=-1)
        return (grid @ self.turn.T).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Rendering:
    """The rendered view of a camera.

    Attributes:
        color: float32 [H, W, 3], linear light, unexposed.
        depth: float32 [H, W], metres along the optical axis; 0 if nothing is hit.
        label: int32 [H, W], instance ids.
        facing: float32 [H, W], cosine of the angle between surface normal and the direction to the camera.
    """

    color: Floats
    depth: Floats
    label: npt.NDArray[np.int32]
    facing: Floats


class Scene:
    """Placed parts, prepared for ray tracing.

    Args:
        items: Placed parts.
        labels: Instance id of each part.
    """

    def __init__(self, items: Sequence[Placed], labels: Sequence[int]) -> None:
        self.items = tuple(items)
        self.labels = np.asarray(labels, dtype=np.int32)
        corners, normals, owner = [], [], []
        for index, item in enumerate(self.items):
            mesh = item.part.mesh
            triangles = mesh.vertices[mesh.faces]
            corners.append((triangles @ item.turn.T + item.shift).astype(np.float32))
            normals.append((_corner_normals(triangles, mesh.faces) @ item.turn.T).astype(np.float32))
            owner.append(np.full(len(triangles), index, dtype=np.int32))
        self.corners = np.concatenate(corners)
        self.normals = np.concatenate(normals)
        self.owner = np.concatenate(owner)
        self._turns = np.stack([item.turn for item in self.items]).astype(np.float32)
        self._shifts = np.stack([item.shift for item in self.items]).astype(np.float32)
        self._gloss = np.array([item.part.texture.gloss for item in self.items], dtype=np.float32)
        self._embree = EmbreeScene()
        # Embree stores only a pointer, so the mesh must stay alive as long as the scene.
        self._mesh = TriangleMesh(self._embree, self.corners)

    def preview(self, camera: Camera, step: int = 8) -> tuple[npt.NDArray[np.int32], Floats]:
        """Return label and depth of every step-th pixel; label -1 if nothing is hit."""
        rays = camera.rays(step)
        flat = rays.reshape(-1, 3)
        hit = self._trace(camera, flat)
        triangle = hit["primID"]
        labels = np.where(triangle >= 0, self.labels[self.owner[triangle]], -1)
        return labels.reshape(rays.shape[:2]), hit["tfar"].reshape(rays.shape[:2])

    def render(self, camera: Camera, lights: Sequence[Light], ambient: Floats, rng: np.random.Generator) -> Rendering:
        """Render a view.

        Args:
            camera: The camera.
            lights: Light sources; each costs one shadow ray per pixel.
            ambient: float32 [2, 3], ambient light from below and from above; reduced by nearby surfaces.
            rng: Random generator for the light samples.
        """
        height, width = camera.height, camera.width
        count = height * width
        rays = camera.rays().reshape(-1, 3)
        hit = self._trace(camera, rays)
        eye = camera.position.astype(np.float32)
        part, depth, facing = np.empty(count, np.int32), np.empty(count, np.float32), np.empty(count, np.float32)
        points, starts, normals = (np.empty((count, 3), np.float32) for _ in range(3))
        shading.surface_points(
            eye, rays, hit["tfar"], hit["primID"], hit["u"], hit["v"], hit["Ng"], self.normals, self.owner, LIFT,
            part, depth, points, starts, normals, facing,
        )  # fmt: skip
        colors, gloss = self._surface(points, normals, part)

        sampled = np.empty((height, width, len(lights) + 1), dtype=np.float32)
        secondary = np.empty_like(starts)
        for k, light in enumerate(lights):
            shading.rays_to_samples(starts, _ball_samples(light, rng), width, TILE, secondary)
            sampled[..., k] = self._unblocked(starts, secondary, 1.0).reshape(height, width)
        shading.rays_about_normals(normals, _sphere_samples(rng), width, TILE, secondary)
        sampled[..., -1] = self._unblocked(starts, secondary, SURROUNDINGS).reshape(height, width)
        image = part.reshape(height, width), depth.reshape(height, width), normals.reshape(height, width, 3)
        visible, halfway = np.empty_like(sampled), np.empty_like(sampled)
        shading.smooth_along(0, 1, sampled, *image, TILE - 1, halfway)
        shading.smooth_along(1, 0, halfway, *image, TILE - 1, visible)

        color = np.empty_like(points)
        shading.reflected_light(
            eye,
            points,
            normals,
            colors,
            gloss,
            visible.reshape(count, -1),
            np.stack([light.position for light in lights]).astype(np.float32),
            np.stack([light.color for light in lights]).astype(np.float32),
            np.array([light.reach for light in lights], dtype=np.float32),
            ambient.astype(np.float32),
            color,
        )
        color[part < 0] = 0
        labels = np.where(part >= 0, self.labels[part], 0).astype(np.int32)
        return Rendering(
            color.reshape(height, width, 3),
            depth.reshape(height, width),
            labels.reshape(height, width),
            facing.reshape(height, width),
        )

    def _trace(self, camera: Camera, rays: Floats) -> dict[str, npt.NDArray]:
        origins = np.broadcast_to(camera.position.astype(np.float32), rays.shape)
        return self._embree.run(np.ascontiguousarray(origins), rays, output=True)

    def _unblocked(self, origins: Floats, directions: Floats, reach: float) -> Floats:
        """Return 1 if the segment from an origin to origin + `reach` * direction hits nothing, otherwise 0."""
        distances = np.full(len(origins), reach, dtype=np.float32)
        hit = self._embree.run(
            np.ascontiguousarray(origins), np.ascontiguousarray(directions), dists=distances, query="OCCLUDED"
        )
        return (hit < 0).astype(np.float32)

    def _surface(self, points: Floats, normals: Floats, part: npt.NDArray[np.int32]) -> tuple[Floats, Floats]:
        """Return gamma-encoded colour [n, 3] and gloss [n]; each visible part's texture is evaluated once."""
        order = np.argsort(part.astype(np.int16), kind="stable")  # NumPy uses radix sort for 16 bits
        bounds = np.searchsorted(part[order], np.arange(len(self.items) + 1))
        own_points, own_normals, sorted_colors = (np.zeros_like(points) for _ in range(3))
        shading.to_own_frames(order, part, points, normals, self._turns, self._shifts, own_points, own_normals)
        for index in np.flatnonzero(np.diff(bounds)):
            pixels = slice(bounds[index], bounds[index + 1])
            sorted_colors[pixels] = self.items[index].part.texture(own_points[pixels], own_normals[pixels])
        colors = np.empty_like(points)
        colors[order] = sorted_colors
        return colors, np.where(part >= 0, self._gloss[part], np.float32(0))


def _corner_normals(triangles: npt.NDArray[np.float64], faces: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """Return the shading normal [F, 3, 3] of each corner of each face.

    It is the area-weighted mean of the normals of those faces at the same vertex that are not separated by a crease.
    """
    areas = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    unit = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-20)
    vertex = faces.ravel()
    face = np.repeat(np.arange(len(faces)), 3)
    order = np.argsort(vertex, kind="stable")
    starts = np.searchsorted(vertex[order], np.arange(int(vertex.max()) + 2))
    counts = np.diff(starts)[vertex]
    # Every pair (corner, face at the same vertex).
    first = np.repeat(np.arange(len(vertex)), counts)
    within = np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    other = face[order[starts[vertex[first]] + within]]
    smooth = (unit[face[first]] * unit[other]).sum(axis=1) > CREASE
    weighted = areas[other] * smooth[:, None]
    sums = np.add.reduceat(weighted, np.cumsum(counts) - counts, axis=0)
    sums = sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-20)
    return sums.reshape(-1, 3, 3)


def _stratified(rng: np.random.Generator) -> Floats:
    """Return stratified samples [TILE * TILE, 2] of the unit square, one per grid cell, in random order."""
    cells = np.stack(np.meshgrid(np.arange(TILE), np.arange(TILE)), axis=-1).reshape(-1, 2)
    points = (cells + rng.random(cells.shape)) / TILE
    return rng.permutation(points).astype(np.float32)


def _sphere_samples(rng: np.random.Generator) -> Floats:
    """Return points [TILE * TILE, 3] distributed over the unit sphere."""
    square = _stratified(rng)
    angle, z = 2 * np.pi * square[:, 0], 2 * square[:, 1] - 1
    flat = np.sqrt(np.clip(1 - z * z, 0, None))
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1).astype(np.float32)


def _ball_samples(light: Light, rng: np.random.Generator) -> Floats:
    """Return points [TILE * TILE, 3] distributed over a light source."""
    return (light.position + light.radius * _sphere_samples(rng)).astype(np.float32)
