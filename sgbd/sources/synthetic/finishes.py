"""Draw random textures for materials: plastic, metal, ceramic, cloth, wood, glass and labels."""

from __future__ import annotations

import numpy as np

from sgbd.sources.synthetic import colors, prints
from sgbd.sources.synthetic.textures import Bands, Checks, Plain, Printed, Speckled, Stripes, Texture, Wood


def seed_of(rng: np.random.Generator) -> int:
    """Draw a seed for a texture's noise."""
    return int(rng.integers(1 << 20))


def plastic(rng: np.random.Generator, color: colors.Color | None = None) -> Texture:
    """Draw a plastic texture: one colour, smooth and slightly shiny."""
    chosen = colors.any_color(rng) if color is None else color
    return Plain(chosen, grain=0.02, scale=0.01, seed=seed_of(rng), gloss=rng.uniform(0.15, 0.5))


def metallic(rng: np.random.Generator) -> Texture:
    """Draw brushed metal: fine streaks and strong highlights."""
    color = colors.metal(rng)
    pair = np.stack([color * np.float32(0.95), color * np.float32(1.03)])
    return Speckled(pair, (0.002, 0.03, 0.03), 0.0, seed_of(rng), gloss=rng.uniform(0.5, 0.9))


def ceramic(rng: np.random.Generator) -> Texture:
    """Draw glazed ceramic: plain, dipped, striped or speckled."""
    first = colors.any_color(rng)
    second = colors.contrasting(rng, first)
    gloss = rng.uniform(0.3, 0.7)
    kind = rng.choice(5, p=(0.35, 0.2, 0.2, 0.1, 0.15))
    if kind == 0:
        return Plain(first, 0.03, 0.02, seed_of(rng), gloss=gloss)
    if kind == 1:
        height = rng.uniform(-0.03, 0.03)
        return Bands((Plain(first, gloss=gloss), Plain(second, gloss=gloss)), (height,), gloss=gloss)
    if kind == 2:
        return Stripes(
            np.stack([first, second]),
            np.array([0, 0, 1], dtype=np.float32),
            rng.uniform(0.015, 0.05),
            rng.random(),
            gloss=gloss,
        )
    if kind == 3:
        return Stripes(np.stack([first, second]), None, 2 * np.pi / rng.integers(4, 12), gloss=gloss)
    size = rng.uniform(0.004, 0.02)
    return Speckled(np.stack([first, second]), (size, size, size), rng.uniform(0.4, 1), seed_of(rng), gloss=gloss)


def cloth(rng: np.random.Generator) -> Texture:
    """Draw fabric: plain, striped, checked, mottled or printed."""
    first = colors.any_color(rng)
    second = colors.contrasting(rng, first)
    pair = np.stack([first, second])
    kind = rng.choice(5, p=(0.3, 0.2, 0.2, 0.1, 0.2))
    if kind == 0:
        return Plain(first, 0.15, 0.006, seed_of(rng), gloss=0.0)
    if kind == 1:
        direction = np.zeros(3, dtype=np.float32)
        direction[rng.integers(2)] = 1
        return Stripes(pair, direction, rng.uniform(0.015, 0.06), rng.random(), gloss=0.0)
    if kind == 2:
        return Checks(pair, rng.uniform(0.01, 0.04), bool(rng.random() < 0.6), gloss=0.0)
    if kind == 3:
        size = rng.uniform(0.01, 0.03)
        return Speckled(pair, (size, size, size), rng.uniform(0.2, 0.7), seed_of(rng), gloss=0.0)
    return Printed(prints.pattern(rng), Plain(first, gloss=0.0), "box", (-0.2, -0.2), (0.2, 0.2), gloss=0.0)


def casing(rng: np.random.Generator) -> Texture:
    """Draw the casing of an appliance: white, grey, black, steel or, rarely, coloured."""
    kind = rng.choice(5, p=(0.35, 0.15, 0.2, 0.15, 0.15))
    if kind == 3:
        return metallic(rng)
    pick = (colors.light, colors.gray, colors.dark, colors.metal, colors.vivid)[kind]
    return Plain(pick(rng), 0.02, 0.05, seed_of(rng), gloss=rng.uniform(0.1, 0.5))


def wooden(rng: np.random.Generator, along: int | None = None) -> Texture:
    """Draw solid wood; `along` is the axis of the grain (0, 1 or 2), random if None."""
    axis = int(rng.integers(3)) if along is None else along
    return Wood(colors.wood(rng), axis, contrast=rng.uniform(0.3, 0.8), seed=seed_of(rng), gloss=rng.uniform(0, 0.3))


def glass_dark(rng: np.random.Generator) -> Texture:
    """Draw dark polished glass."""
    return Plain(colors.dark(rng) * np.float32(0.7), 0.0, gloss=0.9)


def wrapped(rng: np.random.Generator, low: float, high: float, base: Texture, repeats: int | None = None) -> Texture:
    """Draw a printed label around the z axis between the heights `low` and `high`, metres; `base` elsewhere."""
    times = int(rng.integers(1, 4)) if repeats is None else repeats
    image = prints.label(rng, 384, 128, times)
    return Printed(image, base, "around", (-np.pi, low), (np.pi, high), gloss=base.gloss)
