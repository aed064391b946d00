"""Generate furniture and decoration of a room with random proportions and surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
from sgbd.sources.synthetic.textures import Plain, Printed, Speckled, Texture


@dataclass(frozen=True, eq=False)
class Furniture:
    """A piece of furniture on the floor; the origin is the centre of its footprint and its front faces -y.

    Attributes:
        parts: Parts in the furniture's own frame.
        width: Length along x, metres.
        depth: Length along y, metres.
    """

    parts: tuple[Part, ...]
    width: float
    depth: float


def chair(rng: np.random.Generator, table_height: float) -> Furniture:
    """Return a chair whose seat height matches a table height in metres."""
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


def cupboard(rng: np.random.Generator) -> Furniture:
    """Return a cupboard with doors; low ones carry clutter."""
    width, depth = rng.uniform(0.5, 1.3), rng.uniform(0.35, 0.55)
    height = rng.uniform(0.7, 2.1)
    body = finishes.wooden(rng, 2) if rng.random() < 0.6 else finishes.casing(rng)
    front = body if rng.random() < 0.5 else finishes.plastic(rng)
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
        Part("doors", joined(doors), front),
        Part("knobs", joined(knobs), finishes.metallic(rng)),
    ]
    if height < 1.3:
        parts += _clutter((width - 0.1, depth - 0.1), height, rng)
    return Furniture(tuple(parts), width, depth)


def shelf(rng: np.random.Generator) -> Furniture:
    """Return a shelf of books."""
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
    """Return books in four colours, one part per colour."""
    palette = [Plain(colors.any_color(rng), 0.05, 0.02, gloss=0.1) for _ in range(4)]
    piles: list[list] = [[] for _ in palette]
    at = -width / 2 + rng.uniform(0, 0.3) * width
    end = width / 2 - rng.uniform(0, 0.4) * width
    while at < end - 0.06:
        thick, tall, deep = rng.uniform(0.015, 0.06), room * rng.uniform(0.6, 0.97), depth * rng.uniform(0.6, 0.85)
        piles[rng.integers(4)].append(box((thick - 0.002, deep, tall), (at + thick / 2, 0.05 * depth, z + tall / 2)))
        at += thick
    return [Part("books", joined(pile), look) for pile, look in zip(piles, palette, strict=True) if pile]


def sofa(rng: np.random.Generator) -> Furniture:
    """Return an armchair or a sofa."""
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


def door(rng: np.random.Generator) -> Furniture:
    """Return a door in its frame."""
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


def plant(rng: np.random.Generator) -> Furniture:
    """Return a plant in a pot."""
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


def lamp(rng: np.random.Generator) -> Furniture:
    """Return a floor lamp."""
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


def floor_thing(rng: np.random.Generator) -> Furniture:
    """Return an item for any place on the floor: a plant, a chair or a pile of cardboard boxes."""
    kind = rng.integers(4)
    if kind == 0:
        return plant(rng)
    if kind == 1:
        return chair(rng, 0.75)
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


def wall_decoration(rng: np.random.Generator) -> list[Part]:
    """Return a framed picture, a shelf board, a socket or a clock; the wall is the plane y = 0, seen from -y."""
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


WALL_FURNITURE = (cupboard, cupboard, shelf, shelf, sofa, door, plant, lamp)
"""Furniture placed along walls; cupboards and shelves are twice as frequent as the rest."""
