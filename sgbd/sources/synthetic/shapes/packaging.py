"""Carton and roll: packaging without a category, which makes training frames more like real tables."""

from __future__ import annotations

import numpy as np

from sgbd.sources.synthetic import colors, finishes, prints
from sgbd.sources.synthetic.log_uniform import log_uniform
from sgbd.sources.synthetic.meshes import box, lathe
from sgbd.sources.synthetic.shapes.part import Part, Shape, assemble, solid_box, solid_cylinder
from sgbd.sources.synthetic.textures import Plain, Printed, Texture


def carton(rng: np.random.Generator) -> Shape:
    """A cardboard box or a book: from a flat sheet of a box to a cube, each face printed, plain or patterned."""
    height = log_uniform(rng, 0.07, 0.32)
    width = height * rng.uniform(0.45, 1.0)
    depth = log_uniform(rng, 0.02, min(width, 0.14))
    texture: Texture = Plain(colors.any_color(rng), 0.03, 0.02, finishes.seed_of(rng), gloss=rng.uniform(0, 0.3))
    if rng.random() < 0.8:
        front, side = prints.label(rng, 192, 256), prints.label(rng, 96, 256)
        for face, picture, half in (
            ("-y", front, width),
            ("+y", front, width),
            ("-x", side, depth),
            ("+x", side, depth),
        ):
            texture = Printed(picture, texture, face, (-half / 2, 0.0), (half / 2, height), gloss=texture.gloss)
        lid = prints.pattern(rng, 96, 64)
        texture = Printed(lid, texture, "+z", (-width / 2, -depth / 2), (width / 2, depth / 2), gloss=texture.gloss)
    size = (width, depth, height)
    parts = [Part("body", box(size, (0, 0, height / 2), 0.002), texture)]
    return assemble("carton", parts, [solid_box(size, (0, 0, height / 2))], upright=0.45)


def roll(rng: np.random.Generator) -> Shape:
    """A cylinder with flat ends: a tin of biscuits, a tube of crisps, a roll of tape without its hole."""
    radius = rng.uniform(0.025, 0.11)
    height = log_uniform(rng, 0.03, 0.24)
    base: Texture = finishes.plastic(rng) if rng.random() < 0.6 else finishes.metallic(rng)
    if rng.random() < 0.75:
        base = finishes.wrapped(rng, 0.0, height, base)
    edge = min(0.004, height / 8)
    profile = [
        (0, 0),
        (radius - edge, 0),
        (radius, edge),
        (radius, height - edge),
        (radius - edge, height),
        (0, height),
    ]
    parts = [Part("body", lathe(profile, 40), base)]
    return assemble("roll", parts, [solid_cylinder(radius, height, (0, 0, height / 2))], upright=0.7)
