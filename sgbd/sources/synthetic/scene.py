"""Generate a scene (objects at rest on a table in a room) and render views of it."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from sgbd.frame import SUPPORT, Intrinsics
from sgbd.sources.synthetic import colors, sensor
from sgbd.sources.synthetic.log_uniform import log_uniform
from sgbd.sources.synthetic.physics import Pose, UnstableSimulationError, settle
from sgbd.sources.synthetic.render import Camera, Light, Rendering, Scene
from sgbd.sources.synthetic.room import Placed, Room, random_room
from sgbd.sources.synthetic.sensor_variety import recorded_by_any_camera
from sgbd.sources.synthetic.shapes import SHAPES, Shape
from sgbd.sources.synthetic.shapes.packaging import carton, roll
from sgbd.sources.synthetic.shapes.sundries import SUNDRIES, assembly
from sgbd.sources.synthetic.table import Table, random_floor, random_table
from sgbd.sources.synthetic.variety import VARIETIES, Variety

log = logging.getLogger(__name__)

ATTEMPTS = 50
"""Maximum number of attempts to draw a scene; far more than a reasonable recipe needs."""
FEW = 6
"""Maximum number of objects in a scene with few objects."""
VISIBLE = 150
"""Minimum number of pixels, at 640x480, of a visible object."""


class SceneError(RuntimeError):
    """No acceptable scene or viewpoint could be drawn."""


@dataclass(frozen=True, eq=False)
class View:
    """A recorded view with its ground truth.

    Attributes:
        rgb: uint8 [H, W, 3].
        depth: uint16 [H, W], millimetres, 0 = missing.
        segmentation: uint8 [H, W]: 0 background, 1 table, 2 and above objects.
        camera: The camera.
    """

    rgb: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.uint16]
    segmentation: npt.NDArray[np.uint8]
    camera: Camera


@dataclass(frozen=True, eq=False)
class Arrangement:
    """Objects at rest on a table.

    Attributes:
        table: The table.
        shapes: The objects, in the order of their instance ids, from 2.
        poses: Pose of each object.
        attempt: Number of rejected draws before this one.
    """

    table: Table
    shapes: tuple[Shape, ...]
    poses: tuple[Pose, ...]
    attempt: int


def arrange(
    categories: Sequence[str],
    objects: tuple[int, int],
    seed: np.random.SeedSequence,
    variety: Variety = VARIETIES["tabletop"],
) -> Arrangement:
    """Draw objects and drop them on a table; repeat if the simulation diverges or too few objects stay on the table.

    Args:
        categories: Categories to draw from.
        objects: Minimum and maximum number of objects on the table.
        seed: Random seed.
        variety: Ranges that the arrangement is drawn from.

    Raises:
        SceneError: If no draw was acceptable.
    """
    reasons = []
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([*_words(seed), attempt])
        low, high = objects
        if variety.few > 0 and rng.random() < variety.few:
            high = min(high, FEW)
            low = min(low, high)
        table = random_floor(rng) if variety.floor > 0 and rng.random() < variety.floor else random_table(rng)
        count = int(rng.integers(low, high + 1))
        shapes: list[Shape] = []
        for _ in range(count):
            again = bool(shapes) and variety.repeated > 0 and rng.random() < variety.repeated
            shapes.append(shapes[int(rng.integers(len(shapes)))] if again else _random_shape(categories, variety, rng))
        try:
            poses = settle(shapes, table, rng, variety)
        except UnstableSimulationError as error:
            reasons.append(str(error))
            continue
        kept = [(shape, pose) for shape, pose in zip(shapes, poses, strict=True) if pose is not None]
        if len(kept) >= low:
            return Arrangement(table, tuple(s for s, _ in kept), tuple(p for _, p in kept), attempt)
        reasons.append(f"only {len(kept)} of {count} objects stayed on the table")
    raise SceneError(
        f"no scene with {objects[0]} to {objects[1]} objects came to rest in {ATTEMPTS} draws; ask for fewer objects. "
        f"The last draw: {reasons[-1]}"
    )


def _random_shape(categories: Sequence[str], variety: Variety, rng: np.random.Generator) -> Shape:
    if variety.packaging > 0 and rng.random() < variety.packaging:
        return carton(rng) if rng.random() < 0.7 else roll(rng)
    if variety.sundries > 0 and rng.random() < variety.sundries:
        sundry = SUNDRIES[int(rng.integers(len(SUNDRIES)))]
        if sundry is assembly and variety.assemblies < 1 and rng.random() >= variety.assemblies:
            sundry = carton
        return sundry(rng)
    return SHAPES[categories[int(rng.integers(len(categories)))]](rng)


def photograph(
    arrangement: Arrangement,
    views: int,
    sensor_name: str,
    resolution: tuple[int, int],
    seed: np.random.SeedSequence,
    variety: Variety = VARIETIES["tabletop"],
) -> list[View]:
    """Draw a room and lighting around an arrangement and record views.

    Args:
        arrangement: Table and objects.
        views: Number of views.
        sensor_name: `clean`, `kinect` or `varied`.
        resolution: Width and height, pixels.
        seed: Random seed.
        variety: Ranges that viewpoints and focal lengths are drawn from.
    """
    # Separate random streams for scene and sensor give the same scenes with every sensor.
    rng = np.random.default_rng([*_words(seed), 1 << 20])
    recorder = np.random.default_rng([*_words(seed), 1 << 21])
    room = random_room(arrangement.table, rng)
    items = list(room.items)
    labels = [0] * len(items)
    for part in arrangement.table.parts:
        items.append(Placed(part, np.eye(3), np.zeros(3)))
        labels.append(SUPPORT)
    for k, (shape, pose) in enumerate(zip(arrangement.shapes, arrangement.poses, strict=True)):
        items += [Placed(part, pose.turn, pose.position) for part in shape.parts]
        labels += [SUPPORT + 1 + k] * len(shape.parts)
    scene = Scene(items, labels)
    lights, ambient = _lighting(room, arrangement.table, rng)
    look = _look(sensor_name, recorder)
    pictures = []
    first = rng.uniform(0, 2 * np.pi)
    intrinsics = Intrinsics.default(*resolution)
    if variety.focal is not None:
        focal = resolution[0] * rng.uniform(*variety.focal)
        intrinsics = replace(intrinsics, fx=focal, fy=focal)
    for k in range(views):
        # The views are distributed around the table, each within its own sector.
        sector = (first + 2 * np.pi * k / views, np.pi / views)
        camera = _camera(scene, arrangement, room, intrinsics, resolution, sector, variety, rng)
        rendering = scene.render(camera, lights, ambient, rng)
        pictures.append(_recorded(rendering, camera, look, sensor_name, recorder))
    return pictures


@dataclass(frozen=True, eq=False)
class _Look:
    blur: float
    noise: float
    tint: npt.NDArray[np.float32]
    middle: float


def _look(sensor_name: str, rng: np.random.Generator) -> _Look:
    real = sensor_name != "clean"
    tint = 1 + rng.normal(0, 0.03 if real else 0.012, 3)
    return _Look(
        blur=rng.uniform(0.6, 1.0) if real else 0.5,
        noise=rng.uniform(2.0, 5.0) if real else 0.0,
        tint=tint.astype(np.float32),
        middle=log_uniform(rng, 0.12, 0.32),
    )


def _lighting(room: Room, table: Table, rng: np.random.Generator) -> tuple[list[Light], npt.NDArray[np.float32]]:
    """Draw one or two light sources below the ceiling or at window height, and the ambient light."""
    top = np.array([0, 0, table.height])
    lights = []
    count = 1 + int(rng.random() < 0.55)
    shares = rng.dirichlet(np.full(count, 2.0))
    for share in shares:
        if rng.random() < 0.7:
            place = np.array([*rng.uniform(0.6 * room.low, 0.6 * room.high), room.height - 0.15])
        else:
            place = np.array([*rng.uniform(room.low + 0.2, room.high - 0.2), rng.uniform(1.6, 2.2)])
            place[rng.integers(2)] *= 0.9
        warmth = rng.normal(0, 0.08)
        color = colors.rgb(1 + warmth, 1, 1 - warmth) * np.float32(share)
        lights.append(Light(place, rng.uniform(0.05, 0.45), color, float(np.linalg.norm(place - top))))
    fill = rng.uniform(0.35, 0.8)
    ambient = np.stack([np.full(3, 0.55 * fill), np.full(3, fill)]) * (1 + rng.normal(0, 0.03, 3))
    return lights, ambient.astype(np.float32)


def _camera(
    scene: Scene,
    arrangement: Arrangement,
    room: Room,
    intrinsics: Intrinsics,
    resolution: tuple[int, int],
    sector: tuple[float, float],
    variety: Variety,
    rng: np.random.Generator,
) -> Camera:
    """Draw a viewpoint that sees several objects and is not blocked by something close to the camera.

    Its azimuth lies in a sector (centre and half width in radians), which widens with every failed attempt.
    """
    width, height = resolution
    places = np.stack([pose.position for pose in arrangement.poses])
    wanted = min(len(places), 4)
    least = VISIBLE * (width * height) / (640 * 480)
    best: tuple[float, Camera] | None = None
    for attempt in range(30):
        reach = sector[1] * (1 + attempt / 6)
        target = places.mean(axis=0) + rng.normal(0, 0.06, 3)
        distance, elevation, azimuth = (
            rng.uniform(*variety.distance),
            np.deg2rad(rng.uniform(*variety.elevation)),
            sector[0] + rng.uniform(-reach, reach),
        )
        away = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
        position = target + distance * np.asarray(away)
        roll = np.deg2rad(rng.normal(0, 2.5))
        if (
            (position[:2] < room.low + 0.15).any()
            or (position[:2] > room.high - 0.15).any()
            or position[2] > room.height - 0.15
        ):
            continue
        camera = Camera.looking_at(position, target, roll, intrinsics, width, height)
        labels, depth = scene.preview(camera, step := 8)
        sizes = np.bincount(labels[labels > SUPPORT], minlength=2)[2:] * step**2
        seen = int((sizes >= least).sum())
        blocked = float((depth < 0.3).mean())
        if seen >= wanted and blocked < 0.01:
            return camera
        score = seen - 20 * blocked
        if best is None or score > best[0]:
            best = (score, camera)
    if best is None:
        raise SceneError("no viewpoint inside of the room looks at the table")
    return best[1]


def _recorded(rendering: Rendering, camera: Camera, look: _Look, sensor_name: str, rng: np.random.Generator) -> View:
    # Expose mainly for the table and the objects, like the auto-exposure of a camera pointed at them.
    weight = np.where(rendering.label >= SUPPORT, np.float32(1), np.float32(0.25))
    color = sensor.exposed(rendering.color, weight, look.middle)
    rgb = sensor.photographed(color, look.blur, look.noise, look.tint, rng)
    depth = rendering.depth
    if sensor_name == "kinect":
        depth = sensor.StructuredLight().measure(depth, rendering.facing, camera.intrinsics.fx, rng)
    elif sensor_name == "varied":
        rgb, depth = recorded_by_any_camera(rgb, rendering, camera.intrinsics.fx, rng)
    millimeters = np.clip(np.round(depth * 1000), 0, 65535).astype(np.uint16)
    return View(rgb, millimeters, rendering.label.astype(np.uint8), camera)


def _words(seed: np.random.SeedSequence) -> list[int]:
    return [int(word) for word in seed.generate_state(4)]
