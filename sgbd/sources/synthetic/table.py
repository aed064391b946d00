"""Generate the table, or the patch of floor, that objects are dropped on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sgbd.sources.synthetic import colors, finishes
from sgbd.sources.synthetic.meshes import box, cylinder, lathe, moved
from sgbd.sources.synthetic.shapes.part import Part
from sgbd.sources.synthetic.textures import Checks, Plain, Speckled, Texture, Wood


@dataclass(frozen=True, eq=False)
class Table:
    """A table whose top is centred above the origin of the room.

    Attributes:
        round: Whether the top is a disc; otherwise a rectangle.
        size: Lengths of the top along x and y, metres (both are the diameter for a disc).
        height: Height of the top's surface above the floor, metres.
        parts: Visible parts in the room's frame.
    """

    round: bool
    size: tuple[float, float]
    height: float
    parts: tuple[Part, ...]

    def holds(self, position: npt.NDArray[np.float64]) -> bool:
        """Return whether a point lies above the table top."""
        half = np.asarray(self.size) / 2
        if self.round:
            inside = bool(np.hypot(position[0], position[1]) <= half[0])
        else:
            inside = bool((np.abs(position[:2]) <= half).all())
        return inside and bool(position[2] > self.height - 0.01)


def random_table(rng: np.random.Generator) -> Table:
    """Draw a table: round or rectangular; of wood, stone or laminate, or with a checked cloth."""
    is_round = bool(rng.random() < 0.35)
    height = rng.uniform(0.55, 0.85)
    thick = rng.uniform(0.02, 0.05)
    top_texture = _top_texture(rng)
    leg_texture = finishes.wooden(rng, 2) if rng.random() < 0.5 else finishes.plastic(rng, colors.gray(rng))
    if is_round:
        diameter = rng.uniform(1.1, 1.6)
        size = (diameter, diameter)
        radius = diameter / 2
        profile = [
            (0, 0),
            (radius - 0.008, 0),
            (radius, 0.008),
            (radius, thick - 0.006),
            (radius - 0.006, thick),
            (0, thick),
        ]
        parts = [Part("top", moved(lathe(profile, 64), shift=(0, 0, height - thick)), top_texture)]
        parts.append(Part("column", cylinder(0.05, height - thick, (0, 0, (height - thick) / 2)), leg_texture))
        foot = moved(lathe([(0, 0), (0.55 * radius, 0), (0.5 * radius, 0.03), (0.06, 0.06), (0, 0.06)], 32))
        parts.append(Part("foot", foot, leg_texture))
    else:
        size = (rng.uniform(1.1, 2.0), rng.uniform(0.9, 1.3))
        parts = [Part("top", box((*size, thick), (0, 0, height - thick / 2), 0.004), top_texture)]
        leg, inset = rng.uniform(0.04, 0.08), 0.08
        for x in (-1, 1):
            for y in (-1, 1):
                center = (x * (size[0] / 2 - inset), y * (size[1] / 2 - inset), (height - thick) / 2)
                parts.append(Part("leg", box((leg, leg, height - thick), center, 0.003), leg_texture))
        apron = box((size[0] - 2 * inset, size[1] - 2 * inset, 0.08), (0, 0, height - thick - 0.04))
        parts.append(Part("apron", apron, leg_texture))
    return Table(is_round, size, height, tuple(parts))


def random_floor(rng: np.random.Generator) -> Table:
    """Draw a patch of floor, such as a carpet or boards, to use instead of a table."""
    size = (rng.uniform(2.2, 3.2), rng.uniform(2.2, 3.2))
    thick = rng.uniform(0.005, 0.02)
    texture = finishes.cloth(rng) if rng.random() < 0.4 else _top_texture(rng)
    return Table(False, size, thick, (Part("top", box((*size, thick), (0, 0, thick / 2)), texture),))


def _top_texture(rng: np.random.Generator) -> Texture:
    kind = rng.choice(5, p=(0.5, 0.15, 0.15, 0.1, 0.1))
    seed = finishes.seed_of(rng)
    if kind == 0:
        board = 0.0 if rng.random() < 0.5 else rng.uniform(0.08, 0.2)
        return Wood(colors.wood(rng), 0, board, 2.5, rng.uniform(0.2, 0.6), seed, gloss=rng.uniform(0.05, 0.35))
    if kind == 1:
        light, dark = colors.light(rng), colors.muted(rng)
        size = rng.uniform(0.02, 0.06)
        return Speckled(
            np.stack([light, 0.6 * light + 0.4 * dark]), (size, size, size), rng.uniform(0, 0.4), seed, gloss=0.4
        )
    if kind == 2:
        plain = colors.light(rng) if rng.random() < 0.5 else colors.muted(rng)
        return Plain(plain, 0.03, 0.01, seed, gloss=rng.uniform(0.05, 0.3))
    if kind == 3:
        pair = np.stack([colors.light(rng), colors.any_color(rng)])
        return Checks(pair, rng.uniform(0.02, 0.06), True, gloss=0.0)
    gray = colors.gray(rng)
    size = rng.uniform(0.004, 0.012)
    return Speckled(np.stack([gray, np.clip(gray * np.float32(1.35), 0, 1)]), (size, size, size), 0.7, seed, gloss=0.3)
