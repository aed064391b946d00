"""The furnished room around the table: background of every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sgbd.sources.synthetic import colors, finishes, prints
from sgbd.sources.synthetic.meshes import (
    box,
    cylinder,
    ellipsoid,
    joined,
    lathe,
    moved,
    ring,
    rotation,
    tube,
)
from sgbd.sources.synthetic.shapes.part import Part
from sgbd.sources.synthetic.table import Table
from sgbd.sources.synthetic.textures import Plain, Printed, Speckled, Stripes, Texture, Tiles, Wood

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Furniture:
    """Things that stand on the floor: the origin is the middle of their foot, their front faces -y.

    Attributes:
        parts: In the furniture's own frame.
        width: Length along x, metres.
        depth: Length along y, metres.
    """

    parts: tuple[Part, ...]
    width: float
    depth: float


@dataclass(frozen=True, eq=False)
class Placed:
    """A part and where it is.

    Attributes:
        part: In its own frame.
        turn: float64 [3, 3] from its frame to the room's.
        shift: float64 [3], metres.
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
        items: Everything in it but the table.
    """

    low: Floats
    high: Floats
    height: float
    items: tuple[Placed, ...]


def random_room(table: Table, rng: np.random.Generator) -> Room:
    """Draw a room around a table, with furniture along its walls, chairs at the table and things on the floor."""
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
        items += _on_floor(_floor_thing(rng), low, high, rng, taken)
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
    """Fill a wall from one corner on; wall 0 is at high y, then counter-clockwise."""
    axis = wall % 2
    size = high - low
    long = size[axis]
    middle = (low + high) / 2
    # Furniture faces -y by itself, which suits the wall at high y.
    turn = rotation("z", wall * np.pi / 2)
    origin = np.array([*middle, 0.0])
    back = size[1 - axis] / 2
    items: list[Placed] = []
    at = -long / 2 + rng.uniform(0.0, 0.6)
    while True:
        thing = _WALL_FURNITURE[rng.integers(len(_WALL_FURNITURE))](rng)
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
        hung = _on_wall(rng)
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
    chair = _chair(rng, table.height)
    for _ in range(6):
        angle = rng.uniform(0, 2 * np.pi)
        away = np.array([np.cos(angle), np.sin(angle)])
        half = np.asarray(table.size) / 2
        edge = half[0] if table.round else float(np.min(half / np.maximum(np.abs(away), 1e-6)))
        place = away * (edge + rng.uniform(0.28, 0.5))
        bounds = (place - 0.22, place + 0.22)
        if _is_free(bounds, taken) and (bounds[0] > low).all() and (bounds[1] < high).all():
            taken.append(bounds)
            # Its front (-y) looks at the table, more or less.
            turn = rotation("z", angle - np.pi / 2 + rng.normal(0, 0.25))
            return [Placed(part, turn, np.array([*place, 0.0])) for part in chair.parts]
    return []


def _chair(rng: np.random.Generator, table_height: float) -> Furniture:
    seat = 0.6 * table_height
    width, depth, back = rng.uniform(0.38, 0.44), rng.uniform(0.38, 0.44), seat + rng.uniform(0.32, 0.5)
    frame = finishes.wooden(rng, 2) if rng.random() < 0.6 else finishes.plastic(rng)
    cover = finishes.cloth(rng) if rng.random() < 0.5 else frame
    legs = [
        box((0.035, 0.035, seat), (x * (width / 2 - 0.03), y * (depth / 2 - 0.03), seat / 2))
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    legs += [
        box((0.035, 0.03, back - seat), (x * (width / 2 - 0.03), depth / 2 - 0.02, (back + seat) / 2)) for x in (-1, 1)
    ]
    bars = int(rng.integers(1, 5))
    slats = [
        box(
            (width - 0.06, 0.02, 0.6 * (back - seat) / bars),
            (0, depth / 2 - 0.02, seat + (k + 0.7) * (back - seat) / (bars + 0.2)),
        )
        for k in range(bars)
    ]
    parts = (
        Part("legs", joined(legs), frame),
        Part("back", joined(slats), frame),
        Part("seat", box((width, depth, 0.04), (0, 0, seat), 0.01), cover),
    )
    return Furniture(parts, width, depth)


def _cupboard(rng: np.random.Generator) -> Furniture:
    width, depth = rng.uniform(0.5, 1.3), rng.uniform(0.35, 0.55)
    height = rng.uniform(0.7, 2.1)
    body = finishes.wooden(rng, 2) if rng.random() < 0.6 else finishes.casing(rng)
    door = body if rng.random() < 0.5 else finishes.plastic(rng)
    columns, rows = max(1, round(width / rng.uniform(0.4, 0.6))), int(rng.integers(1, 5))
    cell = (width / columns, (height - 0.1) / rows)
    doors, knobs = [], []
    for i in range(columns):
        for j in range(rows):
            x, z = -width / 2 + (i + 0.5) * cell[0], 0.08 + (j + 0.5) * cell[1]
            doors.append(box((cell[0] - 0.015, 0.02, cell[1] - 0.015), (x, -depth / 2 - 0.008, z), 0.003))
            knobs.append(box((0.1, 0.02, 0.015), (x, -depth / 2 - 0.028, z + 0.3 * cell[1])))
    parts = [
        Part("body", box((width, depth, height), (0, 0, height / 2), 0.004), body),
        Part("doors", joined(doors), door),
        Part("knobs", joined(knobs), finishes.metallic(rng)),
    ]
    if height < 1.3:
        parts += _clutter((width - 0.1, depth - 0.1), height, rng)
    return Furniture(tuple(parts), width, depth)


def _shelf(rng: np.random.Generator) -> Furniture:
    width, depth, height = rng.uniform(0.6, 1.2), rng.uniform(0.25, 0.35), rng.uniform(1.0, 2.1)
    wood = finishes.wooden(rng, 2) if rng.random() < 0.7 else finishes.plastic(rng, colors.light(rng))
    levels = max(2, round(height / rng.uniform(0.32, 0.45)))
    boards = [box((0.025, depth, height), (s * width / 2, 0, height / 2)) for s in (-1, 1)]
    boards.append(box((width, 0.015, height), (0, depth / 2 - 0.008, height / 2)))
    parts: list[Part] = []
    for level in range(levels + 1):
        z = 0.05 + level * (height - 0.07) / levels
        boards.append(box((width, depth, 0.022), (0, 0, z)))
        if level < levels:
            parts += _books(width - 0.06, depth, z + 0.011, (height - 0.07) / levels - 0.04, rng)
    return Furniture((Part("boards", joined(boards), wood), *parts), width, depth)


def _books(width: float, depth: float, z: float, room: float, rng: np.random.Generator) -> list[Part]:
    """Return books in a few colours, each colour one part."""
    palette = [Plain(colors.any_color(rng), 0.05, 0.02, gloss=0.1) for _ in range(4)]
    piles: list[list] = [[] for _ in palette]
    at = -width / 2 + rng.uniform(0, 0.3) * width
    end = width / 2 - rng.uniform(0, 0.4) * width
    while at < end - 0.06:
        thick, tall, deep = rng.uniform(0.015, 0.06), room * rng.uniform(0.6, 0.97), depth * rng.uniform(0.6, 0.85)
        piles[rng.integers(4)].append(box((thick - 0.002, deep, tall), (at + thick / 2, 0.05 * depth, z + tall / 2)))
        at += thick
    return [Part("books", joined(pile), look) for pile, look in zip(piles, palette, strict=True) if pile]


def _sofa(rng: np.random.Generator) -> Furniture:
    width, depth = rng.uniform(0.9, 1.9), rng.uniform(0.75, 0.9)
    cover = finishes.cloth(rng)
    seat, back, arm = rng.uniform(0.38, 0.45), rng.uniform(0.75, 0.9), rng.uniform(0.12, 0.2)
    frame = [
        box((width, depth, seat - 0.12), (0, 0, (seat - 0.12) / 2 + 0.04), 0.03),
        box((width, 0.2, back), (0, depth / 2 - 0.1, back / 2), 0.05),
        *[box((arm, depth, seat + 0.18), (s * (width - arm) / 2, 0, (seat + 0.18) / 2), 0.05) for s in (-1, 1)],
    ]
    count = max(1, round(width / 0.7))
    each = (width - 2 * arm) / count
    cushions = [
        box((each - 0.01, depth - 0.22, 0.14), (-width / 2 + arm + (k + 0.5) * each, -0.08, seat - 0.05), 0.04)
        for k in range(count)
    ]
    second = cover if rng.random() < 0.6 else finishes.cloth(rng)
    return Furniture((Part("frame", joined(frame), cover), Part("cushions", joined(cushions), second)), width, depth)


def _door(rng: np.random.Generator) -> Furniture:
    width, height = rng.uniform(0.8, 0.95), rng.uniform(2.0, 2.15)
    leaf = finishes.wooden(rng, 2) if rng.random() < 0.5 else Plain(colors.light(rng), gloss=0.2)
    frame = [box((0.08, 0.06, height), (s * width / 2, 0, height / 2)) for s in (-1, 1)]
    frame.append(box((width + 0.08, 0.06, 0.08), (0, 0, height)))
    panels = [box((0.6 * width, 0.012, 0.35 * height), (0, -0.022, z * height), 0.004) for z in (0.27, 0.72)]
    return Furniture(
        (
            Part("leaf", box((width, 0.03, height), (0, 0, height / 2)), leaf),
            Part("panels", joined(panels), leaf),
            Part("frame", joined(frame), finishes.wooden(rng, 2) if rng.random() < 0.5 else leaf),
            Part("latch", box((0.12, 0.03, 0.02), (0.38 * width, -0.04, 1.0)), finishes.metallic(rng)),
        ),
        width + 0.1,
        0.08,
    )


def _plant(rng: np.random.Generator) -> Furniture:
    radius, tall = rng.uniform(0.12, 0.2), rng.uniform(0.25, 0.4)
    pot = lathe(
        [
            (0, 0),
            (0.75 * radius, 0),
            (radius, tall),
            (radius - 0.015, tall),
            (0.85 * radius, tall - 0.04),
            (0, tall - 0.04),
        ],
        28,
    )
    leaves = []
    for _ in range(rng.integers(18, 36)):
        turn = rotation("z", rng.uniform(0, 2 * np.pi)) @ rotation("y", rng.uniform(0.2, 1.2))
        long = rng.uniform(0.2, 0.5)
        leaf = ellipsoid((0.05, 0.012, long / 2), (0, 0, long / 2), 1)
        leaves.append(moved(leaf, turn, (0, 0, tall + rng.uniform(-0.05, 0.4))))
    green = colors.rgb(rng.uniform(0.15, 0.35), rng.uniform(0.38, 0.55), rng.uniform(0.12, 0.28))
    stem = tube(np.array([[0, 0, tall - 0.05], [0.01, 0, tall + 0.2], [0, 0.01, tall + 0.45]]), 0.012, 6)
    parts = (
        Part("pot", pot, finishes.ceramic(rng)),
        Part(
            "leaves",
            joined(leaves),
            Speckled(np.stack([green, green * np.float32(0.7)]), (0.03, 0.03, 0.03), 0.3, gloss=0.15),
        ),
        Part("stem", stem, finishes.wooden(rng, 2)),
    )
    return Furniture(parts, 2.4 * radius, 2.4 * radius)


def _lamp(rng: np.random.Generator) -> Furniture:
    height, radius = rng.uniform(1.3, 1.7), rng.uniform(0.14, 0.22)
    metal = finishes.metallic(rng)
    shade = moved(
        lathe(
            [
                (0.7 * radius, 0.28),
                (radius, 0),
                (radius - 0.005, 0),
                (0.7 * radius - 0.005, 0.28),
                (0.7 * radius, 0.28),
            ],
            28,
        ),
        None,
        (0, 0, height - 0.28),
    )
    parts = (
        Part("foot", lathe([(0, 0), (0.15, 0), (0.14, 0.02), (0, 0.03)], 28), metal),
        Part("pole", cylinder(0.012, height - 0.1, (0, 0, (height - 0.1) / 2), sections=10), metal),
        Part("shade", shade, Plain(colors.light(rng), 0.05)),
    )
    return Furniture(parts, 2 * radius, 2 * radius)


_WALL_FURNITURE = (_cupboard, _cupboard, _shelf, _shelf, _sofa, _door, _plant, _lamp)


def _floor_thing(rng: np.random.Generator) -> Furniture:
    kind = rng.integers(4)
    if kind == 0:
        return _plant(rng)
    if kind == 1:
        return _chair(rng, 0.75)
    boxes: list[Part] = []
    width, depth, z = rng.uniform(0.3, 0.5), rng.uniform(0.25, 0.4), 0.0
    for _ in range(rng.integers(1, 4)):
        tall = rng.uniform(0.15, 0.35)
        cardboard = np.clip(colors.rgb(0.66, 0.52, 0.37) + rng.normal(0, 0.03, 3), 0, 1).astype(np.float32)
        look: Texture = Plain(cardboard, 0.08, 0.02)
        if rng.random() < 0.5:
            look = Printed(
                prints.label(rng, 160, 96), look, "-y", (-0.35 * width, z + 0.2 * tall), (0.35 * width, z + 0.8 * tall)
            )
        size = (width * rng.uniform(0.7, 1), depth * rng.uniform(0.7, 1), tall)
        boxes.append(
            Part("box", moved(box(size, bevel=0.003), rotation("z", rng.normal(0, 0.15)), (0, 0, z + tall / 2)), look)
        )
        z += tall
    return Furniture(tuple(boxes), width, depth)


def _clutter(area: tuple[float, float], z: float, rng: np.random.Generator) -> list[Part]:
    """Return boxes, vases and balls on top of a low cupboard."""
    parts = []
    for _ in range(rng.integers(0, 5)):
        x, y = rng.uniform(-0.5, 0.5) * area[0], rng.uniform(-0.4, 0.4) * area[1]
        kind = rng.integers(3)
        if kind == 0:
            tall = rng.uniform(0.08, 0.3)
            parts.append(
                Part(
                    "box",
                    box((rng.uniform(0.08, 0.3), rng.uniform(0.08, 0.25), tall), (x, y, z + tall / 2), 0.003),
                    finishes.plastic(rng),
                )
            )
        elif kind == 1:
            r, tall = rng.uniform(0.04, 0.09), rng.uniform(0.15, 0.35)
            vase = lathe(
                [(0, 0), (0.7 * r, 0), (r, 0.4 * tall), (0.5 * r, 0.8 * tall), (0.7 * r, tall), (0, 0.97 * tall)], 24
            )
            parts.append(Part("vase", moved(vase, None, (x, y, z)), finishes.ceramic(rng)))
        else:
            r = rng.uniform(0.06, 0.12)
            parts.append(Part("ball", ellipsoid((r, r, r), (x, y, z + r)), finishes.plastic(rng)))
    return parts


def _on_wall(rng: np.random.Generator) -> list[Part]:
    """Return a framed picture, a shelf board, a socket or a clock, in the frame of a wall at y = 0 seen from -y."""
    kind = rng.choice(4, p=(0.55, 0.2, 0.15, 0.1))
    if kind == 0:
        width, height = rng.uniform(0.25, 0.8), rng.uniform(0.25, 0.6)
        image = prints.label(rng, 160, 128) if rng.random() < 0.5 else prints.screen(rng)
        canvas = Printed(
            image, Plain(colors.light(rng)), "-y", (-width / 2, -height / 2), (width / 2, height / 2), gloss=0.1
        )
        return [
            Part("frame", box((width + 0.05, 0.02, height + 0.05), (0, -0.01, 0), 0.004), finishes.wooden(rng)),
            Part("canvas", box((width, 0.004, height), (0, -0.022, 0)), canvas),
        ]
    if kind == 1:
        width = rng.uniform(0.5, 1.0)
        board = Part("board", box((width, 0.2, 0.025), (0, -0.1, 0)), finishes.wooden(rng, 0))
        return [
            board,
            *[
                Part(p.name, moved(p.mesh, None, (0, -0.1, 0)), p.texture)
                for p in _books(width, 0.18, 0.013, 0.25, rng)
            ],
        ]
    if kind == 2:
        return [Part("socket", box((0.09, 0.012, 0.09), (0, -0.006, -0.4), 0.003), Plain(colors.light(rng), gloss=0.3))]
    return [
        Part("rim", ring(0.13, 0.15, 0.04, (0, -0.02, 0), "y"), finishes.plastic(rng)),
        Part(
            "dial",
            cylinder(0.14, 0.02, (0, -0.01, 0), "y"),
            Printed(prints.dial(rng), Plain(colors.light(rng)), "-y", (-0.13, -0.13), (0.13, 0.13)),
        ),
    ]
