"""Ray casting of a scene: exact depth and labels, textured and lit colours.

Rays are traced by Embree: I. Wald, S. Woop, C. Benthin, G. S. Johnson, M. Ernst, "Embree: a kernel framework for
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
from sgbd.sources.synthetic.room import Placed
from sgbd.sources.synthetic.shading import edge_aware_mean

Floats = npt.NDArray[np.float32]

GAMMA = 2.2
CREASE = np.cos(np.deg2rad(42))
"""Faces that meet at a smaller angle are shaded as one smooth surface."""
LIFT = 6e-4
"""Metres by which secondary rays start above their surface."""
TILE = 4
"""Side of the tile of pixels that share a set of light samples."""


@dataclass(frozen=True, eq=False)
class Light:
    """A glowing ball.

    Attributes:
        position: float64 [3], metres.
        radius: Metres; the larger, the softer the shadows.
        colour: float32 [3], irradiance on a surface that faces it from `reach` metres.
        reach: Metres.
    """

    position: npt.NDArray[np.float64]
    radius: float
    colour: Floats
    reach: float


@dataclass(frozen=True, eq=False)
class Camera:
    """Where a view is taken from.

    Attributes:
        position: float64 [3], metres, in the room.
        turn: float64 [3, 3], from the camera's frame (x right, y down, z forward) to the room's.
        intrinsics: Focal lengths and principal point, pixels.
        width: Columns.
        height: Rows.
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
        """Return the camera at a position that has a target in its middle; `roll` (radians) turns the picture."""
        forward = (target - position) / np.linalg.norm(target - position)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        turn = np.stack([right, down, forward], axis=1)
        c, s = np.cos(roll), np.sin(roll)
        return cls(position, turn @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), intrinsics, width, height)

    def rays(self, step: int = 1) -> Floats:
        """Return the direction [H/step, W/step, 3] of every step-th pixel; lengths along it are depths."""
        k = self.intrinsics
        x = (np.arange(0, self.width, step) - k.cx) / k.fx
        y = (np.arange(0, self.height, step) - k.cy) / k.fy
        grid = np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))], axis=-1)
        return (grid @ self.turn.T).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Rendering:
    """What a camera sees.

    Attributes:
        colour: float32 [H, W, 3], linear light, any exposure.
        depth: float32 [H, W], metres along the optical axis; 0 where nothing is hit.
        label: int32 [H, W], instance ids.
        facing: float32 [H, W], cosine between the surface's normal and the ray back to the camera.
    """

    colour: Floats
    depth: Floats
    label: npt.NDArray[np.int32]
    facing: Floats


class Scene:
    """Parts in a room, ready to be traced.

    Args:
        items: Placed parts.
        labels: Instance id of each.
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
        self._embree = EmbreeScene()
        # The scene keeps a pointer only: the mesh must outlive it.
        self._mesh = TriangleMesh(self._embree, self.corners)

    def preview(self, camera: Camera, step: int = 8) -> tuple[npt.NDArray[np.int32], Floats]:
        """Return label and depth of every step-th pixel (label -1 where nothing is hit)."""
        rays = camera.rays(step)
        flat = rays.reshape(-1, 3)
        hit = self._trace(camera, flat)
        triangle = hit["primID"]
        labels = np.where(triangle >= 0, self.labels[self.owner[triangle]], -1)
        return labels.reshape(rays.shape[:2]), hit["tfar"].reshape(rays.shape[:2])

    def render(self, camera: Camera, lights: Sequence[Light], ambient: Floats, rng: np.random.Generator) -> Rendering:
        """Render a view.

        Args:
            camera: Where from.
            lights: Each costs a shadow ray a pixel.
            ambient: float32 [2, 3], light from below and from above; dimmed where nearby surfaces close in.
            rng: Source of randomness of the light samples.
        """
        height, width = camera.height, camera.width
        rays = camera.rays().reshape(-1, 3)
        hit = self._trace(camera, rays)
        triangle = hit["primID"]
        seen = triangle >= 0
        depth = np.where(seen, hit["tfar"], 0).astype(np.float32)
        owner = np.where(seen, self.owner[triangle], -1).astype(np.int32)
        points = camera.position.astype(np.float32) + rays * depth[:, None]
        back = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
        flat = hit["Ng"] / np.maximum(np.linalg.norm(hit["Ng"], axis=1, keepdims=True), 1e-20)
        flat *= np.where((flat * back).sum(axis=1) < 0, -1, 1)[:, None].astype(np.float32)
        smooth = self._smooth_normals(triangle, hit["u"], hit["v"])
        smooth *= np.where((smooth * flat).sum(axis=1) < 0, -1, 1)[:, None].astype(np.float32)

        albedo, gloss = self._surface(points, smooth, owner)
        start = points + flat * np.float32(LIFT) * np.maximum(depth, 1)[:, None]
        noisy = np.empty((height * width, len(lights) + 1), dtype=np.float32)
        directions = []
        for k, light in enumerate(lights):
            towards = _light_samples(light, height, width, rng) - start
            noisy[:, k] = self._unblocked(start, towards, 1.0)
            directions.append(light.position.astype(np.float32) - points)
        bounce = _cosine_samples(smooth, height, width, rng)
        noisy[:, -1] = self._unblocked(start, bounce, 0.35)
        visible = np.empty((height, width, noisy.shape[1]), dtype=np.float32)
        edge_aware_mean(
            noisy.reshape(visible.shape),
            owner.reshape(height, width),
            depth.reshape(height, width),
            smooth.reshape(height, width, 3),
            3,
            visible,
        )
        visible = visible.reshape(noisy.shape)

        upward = np.float32(0.5) + np.float32(0.5) * smooth[:, 2:3]
        openness = np.float32(0.12) + np.float32(0.88) * visible[:, -1:]
        diffuse = (ambient[0] * (1 - upward) + ambient[1] * upward) * openness
        highlight = np.zeros_like(diffuse)
        for k, light in enumerate(lights):
            distance = np.linalg.norm(directions[k], axis=1, keepdims=True)
            towards = directions[k] / distance
            strength = visible[:, k : k + 1] * (np.float32(light.reach) / distance) ** 2
            diffuse += strength * np.maximum((smooth * towards).sum(axis=1, keepdims=True), 0) * light.colour
            half = towards + back
            half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-9)
            glint = np.maximum((smooth * half).sum(axis=1), 0) ** (8 + 90 * gloss)
            highlight += strength * (np.float32(0.45) * gloss * glint)[:, None] * light.colour
        colour = albedo * diffuse + highlight
        colour[~seen] = 0
        return Rendering(
            colour.reshape(height, width, 3),
            depth.reshape(height, width),
            np.where(seen, self.labels[owner], 0).astype(np.int32).reshape(height, width),
            np.clip((flat * back).sum(axis=1), 0, 1).reshape(height, width),
        )

    def _trace(self, camera: Camera, rays: Floats) -> dict[str, npt.NDArray]:
        origins = np.broadcast_to(camera.position.astype(np.float32), rays.shape)
        return self._embree.run(np.ascontiguousarray(origins), rays, output=True)

    def _unblocked(self, origins: Floats, directions: Floats, reach: float) -> Floats:
        """Return 1 where nothing lies between an origin and `reach` times its direction further on, else 0."""
        distances = np.full(len(origins), reach, dtype=np.float32)
        hit = self._embree.run(
            np.ascontiguousarray(origins), np.ascontiguousarray(directions), dists=distances, query="OCCLUDED"
        )
        return (hit < 0).astype(np.float32)

    def _smooth_normals(self, triangle: npt.NDArray[np.int32], u: Floats, v: Floats) -> Floats:
        corner = self.normals[triangle]
        normals = corner[:, 0] * (1 - u - v)[:, None] + corner[:, 1] * u[:, None] + corner[:, 2] * v[:, None]
        return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)

    def _surface(self, points: Floats, normals: Floats, owner: npt.NDArray[np.int32]) -> tuple[Floats, Floats]:
        """Return linear albedo [n, 3] and gloss [n]: each visible part's texture is asked once."""
        albedo = np.zeros(points.shape, dtype=np.float32)
        gloss = np.zeros(len(points), dtype=np.float32)
        order = np.argsort(owner, kind="stable")
        bounds = np.searchsorted(owner[order], np.arange(len(self.items) + 1))
        for index in np.flatnonzero(np.diff(bounds)):
            pixels = order[bounds[index] : bounds[index + 1]]
            turn, shift = self._turns[index], self._shifts[index]
            texture = self.items[index].part.texture
            colour = texture((points[pixels] - shift) @ turn, normals[pixels] @ turn)
            albedo[pixels] = np.clip(colour, 0.01, 1) ** np.float32(GAMMA)
            gloss[pixels] = texture.gloss
        return albedo, gloss


def _corner_normals(triangles: npt.NDArray[np.float64], faces: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """Return the shading normal [F, 3, 3] of each corner of each face.

    It is the mean, weighted by area, of the normals of the faces at the corner's vertex that are not beyond a crease.
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


def _tiled(samples: Floats, height: int, width: int) -> Floats:
    """Lay TILE x TILE samples [TILE * TILE, k] over the image: neighbours have different ones. Returns [H * W, k]."""
    square = samples.reshape(TILE, TILE, -1)
    repeats = (-(-height // TILE), -(-width // TILE), 1)
    return np.tile(square, repeats)[:height, :width].reshape(height * width, -1)


def _stratified(rng: np.random.Generator) -> Floats:
    """Return TILE * TILE points [n, 2] of the unit square, one in each cell of a grid, in random order."""
    cells = np.stack(np.meshgrid(np.arange(TILE), np.arange(TILE)), axis=-1).reshape(-1, 2)
    points = (cells + rng.random(cells.shape)) / TILE
    return rng.permutation(points).astype(np.float32)


def _light_samples(light: Light, height: int, width: int, rng: np.random.Generator) -> Floats:
    square = _stratified(rng)
    angle, z = 2 * np.pi * square[:, 0], 2 * square[:, 1] - 1
    flat = np.sqrt(np.clip(1 - z * z, 0, None))
    ball = np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1) * light.radius
    return _tiled((light.position + ball).astype(np.float32), height, width)


def _cosine_samples(normals: Floats, height: int, width: int, rng: np.random.Generator) -> Floats:
    """Return directions [H * W, 3] about the normals, distributed as their cosine."""
    square = _stratified(rng)
    angle, z = 2 * np.pi * square[:, 0], 2 * square[:, 1] - 1
    flat = np.sqrt(np.clip(1 - z * z, 0, None))
    ball = np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1).astype(np.float32)
    # A point of the unit ball's surface about the tip of the normal.
    return normals * np.float32(1.001) + _tiled(ball, height, width)
