"""Generate the furnished room around the table, the background of every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sgbd.sources.synthetic import colors, finishes
from sgbd.sources.synthetic.furniture import WALL_FURNITURE, Furniture, chair, floor_thing, wall_decoration
from sgbd.sources.synthetic.meshes import box, rotation
from sgbd.sources.synthetic.shapes.part import Part
from sgbd.sources.synthetic.table import Table
from sgbd.sources.synthetic.textures import Plain, Speckled, Stripes, Texture, Tiles, Wood

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Placed:
    """A part with its pose in the room.

    Attributes:
        part: The part in its own frame.
        turn: float64 [3, 3], rotation from its frame to the room's.
        shift: float64 [3], translation, metres.
    """

    part: Part
    turn: Floats
    shift: Floats


@dataclass(frozen=True, eq=False)
class Room:
    """Walls, floor, ceiling and furniture.

    Attributes:
        low: Smallest x, y of the floor, metres.
        high: Largest x, y of the floor, metres.
        height: Height of the ceiling, metres.
        items: Everything in the room except the table.
    """

    low: Floats
    high: Floats
    height: float
    items: tuple[Placed, ...]


def random_room(table: Table, rng: np.random.Generator) -> Room:
    """Draw a room around a table, with furniture along the walls, chairs at the table and items on the floor."""
    half = np.asarray(table.size) / 2
    low = -(half + rng.uniform(0.7, 2.2, 2))
    high = half + rng.uniform(0.7, 2.2, 2)
    height = rng.uniform(2.4, 3.1)
    items = [Placed(part, np.eye(3), np.zeros(3)) for part in _shell(low, high, height, rng)]
    taken: list[tuple[Floats, Floats]] = [(-half - 0.05, half + 0.05)]
    for wall in range(4):
        items += _along_wall(wall, low, high, height, rng, taken)
    for _ in range(rng.integers(0, 4)):
        items += _chair_at(table, low, high, rng, taken)
    for _ in range(rng.integers(1, 5)):
        items += _on_floor(floor_thing(rng), low, high, rng, taken)
    return Room(low, high, height, tuple(items))


def _shell(low: Floats, high: Floats, height: float, rng: np.random.Generator) -> list[Part]:
    size, middle = high - low, (high + low) / 2
    thick = 0.1
    paint = _wall_texture(rng)
    accent = _wall_texture(rng) if rng.random() < 0.4 else paint
    parts = [
        Part("floor", box((*(size + 0.2), thick), (*middle, -thick / 2)), _floor_texture(rng)),
        Part(
            "ceiling", box((*(size + 0.2), thick), (*middle, height + thick / 2)), Plain(colors.light(rng), 0.02, 0.1)
        ),
    ]
    skirting = finishes.wooden(rng, 0) if rng.random() < 0.5 else Plain(colors.light(rng))
    for axis in (0, 1):
        for side, edge in ((-1, low[axis]), (1, high[axis])):
            lengths = np.array([size[0] + 0.2, size[1] + 0.2, height])
            center = np.array([*middle, height / 2])
            lengths[axis], center[axis] = thick, edge + side * thick / 2
            parts.append(Part("wall", box(lengths, center), accent if (axis, side) == (1, 1) else paint))
            lengths[axis], center[axis] = 0.015, edge - side * 0.0075
            lengths[2], center[2] = 0.09, 0.045
            parts.append(Part("skirting", box(lengths, center), skirting))
    return parts


def _wall_texture(rng: np.random.Generator) -> Texture:
    kind = rng.choice(5, p=(0.5, 0.12, 0.14, 0.12, 0.12))
    seed = finishes.seed_of(rng)
    color = colors.light(rng) if rng.random() < 0.5 else np.clip(0.5 * colors.muted(rng) + np.float32(0.42), 0, 1)
    if kind == 0:
        return Plain(color, 0.04, 0.3, seed, gloss=0.02)
    if kind == 1:
        pair = np.stack([color, color * np.float32(rng.uniform(0.8, 0.93))])
        direction = np.array([0.7071, 0.7071, 0], dtype=np.float32)
        return Stripes(pair, direction, rng.uniform(0.08, 0.3), gloss=0.0)
    if kind == 2:
        brick = np.clip(colors.rgb(0.62, 0.36, 0.28) + rng.normal(0, 0.06, 3), 0, 1).astype(np.float32)
        if rng.random() < 0.4:
            brick = color
        return Tiles(brick, colors.gray(rng), (0.24, 0.075), 0.012, 0.5, 0.3, seed, gloss=0.0)
    if kind == 3:
        side = rng.uniform(0.12, 0.3)
        return Tiles(color, colors.gray(rng), (side, side), 0.006, 0.0, 0.06, seed, gloss=0.4)
    return Speckled(np.stack([color, color * np.float32(0.86)]), (0.12, 0.12, 0.12), 0.2, seed, gloss=0.0)


def _floor_texture(rng: np.random.Generator) -> Texture:
    kind = rng.choice(4, p=(0.45, 0.2, 0.2, 0.15))
    seed = finishes.seed_of(rng)
    if kind == 0:
        return Wood(
            colors.wood(rng),
            int(rng.integers(2)),
            rng.uniform(0.07, 0.16),
            rng.uniform(0.6, 1.6),
            0.5,
            seed,
            gloss=0.2,
        )
    if kind == 1:
        side = rng.uniform(0.2, 0.5)
        return Tiles(colors.muted(rng), colors.gray(rng), (side, side), 0.006, 0.0, 0.12, seed, gloss=0.35)
    if kind == 2:
        color = colors.muted(rng)
        return Speckled(np.stack([color, color * np.float32(0.75)]), (0.008, 0.008, 0.008), 0.4, seed, gloss=0.0)
    color = colors.gray(rng)
    return Speckled(np.stack([color, color * np.float32(0.85)]), (0.25, 0.25, 0.25), 0.1, seed, gloss=0.1)


def _along_wall(
    wall: int, low: Floats, high: Floats, height: float, rng: np.random.Generator, taken: list[tuple[Floats, Floats]]
) -> list[Placed]:
    """Fill a wall with furniture, starting at one corner; wall 0 is at high y, the others follow counter-clockwise."""
    axis = wall % 2
    size = high - low
    long = size[axis]
    middle = (low + high) / 2
    # Unrotated furniture faces -y, as needed at wall 0.
    turn = rotation("z", wall * np.pi / 2)
    origin = np.array([*middle, 0.0])
    back = size[1 - axis] / 2
    items: list[Placed] = []
    at = -long / 2 + rng.uniform(0.0, 0.6)
    while True:
        thing = WALL_FURNITURE[rng.integers(len(WALL_FURNITURE))](rng)
        if at + thing.width > long / 2 - 0.05:
            break
        shift = origin + turn @ [at + thing.width / 2, back - thing.depth / 2 - 0.02, 0]
        corners = [turn @ [s * thing.width / 2, t * thing.depth / 2, 0] + shift for s in (-1, 1) for t in (-1, 1)]
        bounds = (np.min(corners, axis=0)[:2], np.max(corners, axis=0)[:2])
        if _is_free(bounds, taken):
            taken.append(bounds)
            items += [Placed(part, turn, shift) for part in thing.parts]
        at += thing.width + rng.uniform(0.03, 0.9)
    for _ in range(rng.integers(0, 4)):
        hung = wall_decoration(rng)
        shift = origin + turn @ [rng.uniform(-0.42, 0.42) * long, back, rng.uniform(1.2, min(1.9, height - 0.6))]
        items += [Placed(part, turn, shift) for part in hung]
    return items


def _is_free(bounds: tuple[Floats, Floats], taken: list[tuple[Floats, Floats]]) -> bool:
    return not any((bounds[0] < high).all() and (bounds[1] > low).all() for low, high in taken)


def _on_floor(
    thing: Furniture, low: Floats, high: Floats, rng: np.random.Generator, taken: list[tuple[Floats, Floats]]
) -> list[Placed]:
    for _ in range(8):
        place = rng.uniform(low + 0.3, high - 0.3)
        reach = 0.5 * np.hypot(thing.width, thing.depth)
        bounds = (place - reach, place + reach)
        if _is_free(bounds, taken) and (bounds[0] > low).all() and (bounds[1] < high).all():
            taken.append(bounds)
            turn = rotation("z", rng.uniform(0, 2 * np.pi))
            return [Placed(part, turn, np.array([*place, 0.0])) for part in thing.parts]
    return []


def _chair_at(
    table: Table, low: Floats, high: Floats, rng: np.random.Generator, taken: list[tuple[Floats, Floats]]
) -> list[Placed]:
    seat = chair(rng, table.height)
    for _ in range(6):
        angle = rng.uniform(0, 2 * np.pi)
        away = np.array([np.cos(angle), np.sin(angle)])
        half = np.asarray(table.size) / 2
        edge = half[0] if table.round else float(np.min(half / np.maximum(np.abs(away), 1e-6)))
        place = away * (edge + rng.uniform(0.28, 0.5))
        bounds = (place - 0.22, place + 0.22)
        if _is_free(bounds, taken) and (bounds[0] > low).all() and (bounds[1] < high).all():
            taken.append(bounds)
            # The front of the chair (-y) roughly faces the table.
            turn = rotation("z", angle - np.pi / 2 + rng.normal(0, 0.25))
            return [Placed(part, turn, np.array([*place, 0.0])) for part in seat.parts]
    return []
