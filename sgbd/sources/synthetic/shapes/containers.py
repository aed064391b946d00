"""Containers: ashcan, bag, bottle, bowl, can, jar, mug, pot."""

from __future__ import annotations

import numpy as np

from sgbd.sources.synthetic import colors, finishes, prints
from sgbd.sources.synthetic.meshes import arc, box, cylinder, ellipsoid, frustum, hull, joined, lathe, moved, ring, tube
from sgbd.sources.synthetic.shapes.part import (
    Part,
    Shape,
    Solid,
    assemble,
    hollow,
    solid_box,
    solid_cylinder,
    solid_hull,
    squashed,
)
from sgbd.sources.synthetic.textures import Bands, Plain, Printed, Stripes, Texture


def ashcan(rng: np.random.Generator) -> Shape:
    """A waste bin: a tall tapered bucket, open, with a swing lid, or with a pedal and a domed lid."""
    height = rng.uniform(0.16, 0.30)
    top = height * rng.uniform(0.30, 0.42)
    bottom = top * rng.uniform(0.68, 0.95)
    wall = rng.uniform(0.003, 0.006)
    squash = 1.0 if rng.random() < 0.7 else rng.uniform(0.65, 0.9)
    rim = rng.uniform(0.004, 0.009)
    body: Texture = finishes.plastic(rng) if rng.random() < 0.6 else finishes.metallic(rng)
    if rng.random() < 0.35:
        pair = np.stack([colors.any_color(rng), colors.any_color(rng)])
        body = Stripes(pair, None, 2 * np.pi / rng.integers(10, 24), gloss=0.2)
    elif rng.random() < 0.35:
        body = finishes.wrapped(rng, 0.2 * height, 0.8 * height, body)
    trim = finishes.plastic(rng)
    bucket = [
        (0, 0),
        (bottom - 0.004, 0),
        (bottom, 0.004),
        (top, height - 0.015),
        (top, height),
        (top - wall, height),
        (bottom - wall, wall),
        (0, wall),
    ]
    parts = [
        Part("bucket", lathe(bucket, 32, squash), body),
        Part("rim", moved(lathe(_hoop(top + rim / 3, rim), 32, squash), shift=(0, 0, height - rim / 2)), trim),
    ]
    solids = hollow([(bottom, 0), (top, height)], [(bottom - wall - 0.004, wall + 0.004), (top - wall - 0.004, height)])
    kind = rng.choice(3, p=(0.5, 0.25, 0.25))
    if kind > 0:
        rise = top * (0.25 if kind == 1 else 0.5)
        dome = [
            (0, 0),
            (top, 0),
            (top, 0.01),
            (top * 0.8, 0.01 + 0.6 * rise),
            (top * 0.4, 0.01 + 0.93 * rise),
            (0, 0.01 + rise),
        ]
        parts.append(Part("lid", moved(lathe(dome, 32, squash), shift=(0, 0, height)), trim))
        if kind == 1:
            flap = box((1.1 * top, 0.5 * top * squash, 0.012), (0, 0, height + 0.01 + 0.9 * rise), 0.004)
            parts.append(Part("flap", flap, body))
        else:
            pedal = box((0.035, 0.03, 0.008), (bottom + 0.012, 0, 0.006), 0.002)
            parts.append(Part("pedal", pedal, finishes.metallic(rng)))
        solids = [
            solid_hull(
                lathe(
                    [
                        (0, 0),
                        (bottom, 0),
                        (top, height),
                        (top, height + 0.01),
                        (top * 0.8, height + 0.6 * rise),
                        (0, height + 0.01 + rise),
                    ],
                    14,
                ).vertices
            )
        ]
    if squash != 1.0:
        solids = squashed(solids, squash)
    return assemble("ashcan", parts, solids, upright=0.65)


def bag(rng: np.random.Generator) -> Shape:
    """A bag: a soft tapered body with a gusset and two looped handles, or a backpack with a pocket and straps."""
    width, depth = rng.uniform(0.14, 0.26), rng.uniform(0.05, 0.11)
    height = width * rng.uniform(0.75, 1.3)
    body = finishes.cloth(rng) if rng.random() < 0.6 else finishes.plastic(rng)
    if rng.random() < 0.35:
        image = prints.label(rng, 192, 192)
        body = Printed(
            image, body, "-y", (-0.35 * width, 0.15 * height), (0.35 * width, 0.75 * height), gloss=body.gloss
        )
    trim = finishes.cloth(rng)
    if rng.random() < 0.65:
        narrow = rng.uniform(0.25, 0.7)
        flare = rng.uniform(0.8, 1.08)
        lower = frustum((width * 0.94, depth * 0.9), (width, depth), 0.12 * height)
        upper = frustum((width, depth), (width * flare, depth * narrow), 0.88 * height, at=(0, 0, 0.12 * height))
        points = np.concatenate([lower, upper])
        parts = [Part("body", hull(_rounded(points, 0.012)), body)]
        edge = Part(
            "hem", box((width * flare * 0.98, depth * narrow + 0.006, 0.014), (0, 0, height + 0.008), 0.003), trim
        )
        parts.append(edge)
        reach, drop = 0.27 * width, rng.uniform(0.25, 0.5) * height
        for side in (-1, 1):
            loop = arc((0, side * depth * narrow * 0.32, height), (reach, drop), 0, np.pi, "xz", 14)
            parts.append(Part("handle", tube(loop, rng.uniform(0.004, 0.007), 6), trim))
        solids = [solid_hull(points)]
        solids.append(solid_box((2 * reach, depth * narrow * 0.7, drop * 0.9), (0, 0, height + drop * 0.45)))
    else:
        shell = np.concatenate(
            [
                frustum((width, depth), (width, depth), 0.7 * height),
                [[x * width * 0.42, y * depth * 0.4, height] for x in (-1, 1) for y in (-1, 1)],
            ]
        )
        front = (0, -depth * 0.65, 0.06 * height)
        pocket = frustum((width * 0.75, depth * 0.45), (width * 0.7, depth * 0.3), 0.45 * height, at=front)
        parts = [
            Part("body", hull(_rounded(shell, 0.02)), body),
            Part("pocket", hull(_rounded(pocket, 0.01)), trim),
            Part(
                "handle", tube(arc((0, depth * 0.2, height), (0.15 * width, 0.12 * height), 0, np.pi), 0.006, 6), trim
            ),
        ]
        for side in (-1, 1):
            strap = arc(
                (side * 0.28 * width, depth * 0.5, 0.5 * height), (0.04, 0.42 * height), -np.pi / 2, np.pi / 2, "yz", 12
            )
            parts.append(Part("strap", tube(strap, 0.009, 6, flatten=1.6), trim))
        solids = [solid_hull(shell), solid_hull(pocket)]
        solids.append(solid_box((0.66 * width, 0.04, 0.75 * height), (0, depth * 0.5 + 0.02, 0.5 * height)))
    return assemble("bag", parts, solids, upright=0.6)


def bottle(rng: np.random.Generator) -> Shape:
    """A bottle: a body, a shoulder that narrows to a neck, a cap."""
    height = rng.uniform(0.17, 0.31)
    radius = height * rng.uniform(0.11, 0.19)
    neck = radius * rng.uniform(0.25, 0.5)
    shoulder, collar = rng.uniform(0.45, 0.68), rng.uniform(0.72, 0.85)
    waist = rng.uniform(0.82, 1.0)
    roundness = np.linspace(0, np.pi / 2, 6)
    slope = [
        (neck + (radius - neck) * np.cos(a), (shoulder + (collar - shoulder) * np.sin(a)) * height) for a in roundness
    ]
    profile = [(0, 0), (radius * 0.9, 0), (radius, 0.012), (radius * waist, 0.5 * shoulder * height), *slope]
    profile += [(neck, 0.94 * height), (0, 0.94 * height)]
    base: Texture = Plain(colors.any_color(rng), 0.02, gloss=0.7) if rng.random() < 0.7 else finishes.plastic(rng)
    if rng.random() < 0.3:
        base = Bands(
            (base, Plain(colors.any_color(rng), gloss=0.5)), (shoulder * height * rng.uniform(0.6, 1.1),), gloss=0.6
        )
    if rng.random() < 0.8:
        low = rng.uniform(0.08, 0.2) * height
        base = finishes.wrapped(rng, low, min(low + rng.uniform(0.2, 0.4) * height, shoulder * height), base)
    cap = Part("cap", cylinder(neck * 1.25, 0.09 * height, (0, 0, 0.955 * height)), finishes.plastic(rng))
    parts = [Part("body", lathe(profile, 30), base), cap]
    solids = [
        solid_cylinder(radius, shoulder * height, (0, 0, 0.5 * shoulder * height)),
        solid_hull(lathe([(0, shoulder * height), *slope, (neck, collar * height), (0, collar * height)], 14).vertices),
        solid_cylinder(neck * 1.2, (1 - collar) * height, (0, 0, 0.5 * (1 + collar) * height)),
    ]
    return assemble("bottle", parts, solids, upright=0.6)


def bowl(rng: np.random.Generator) -> Shape:
    """A bowl: wide, low, hollow, round inside, on a foot."""
    radius = rng.uniform(0.06, 0.12)
    height = radius * rng.uniform(0.55, 0.95)
    wall = rng.uniform(0.004, 0.007)
    foot = radius * rng.uniform(0.35, 0.55)
    lift = rng.uniform(0.003, 0.01)
    power = rng.uniform(1.6, 3.0)
    share = np.linspace(0, 1, 9)
    outside = [
        (foot + (radius - foot) * (1 - (1 - s) ** power) ** (1 / power), lift + (height - lift) * s) for s in share
    ]
    inside = [(max(r - wall, 0), z + (wall if k < 8 else 0)) for k, (r, z) in enumerate(outside)]
    profile = [(0, 0), (foot, 0), *outside, *reversed(inside), (0, lift + wall)]
    texture = finishes.ceramic(rng) if rng.random() < 0.8 else finishes.metallic(rng)
    parts = [Part("bowl", lathe(profile, 36), texture)]
    if rng.random() < 0.5:
        parts.append(
            Part(
                "rim",
                moved(lathe(_hoop(radius - wall / 2, wall * 1.3), 36), shift=(0, 0, height)),
                finishes.plastic(rng),
            )
        )
    middle = outside[4]
    solids = hollow([outside[0], middle], [inside[0], inside[4]])
    solids += hollow([middle, outside[8]], [inside[4], inside[8]], floor=False)
    solids.append(solid_cylinder(foot, lift + wall, (0, 0, (lift + wall) / 2)))
    return assemble("bowl", parts, solids, upright=0.8)


def can(rng: np.random.Generator) -> Shape:
    """A tin or drink can: a cylinder with a metal rim above and below and a printed label."""
    radius = rng.uniform(0.028, 0.055)
    height = radius * rng.uniform(1.2, 4.2)
    lip = rng.uniform(0.003, 0.006)
    neck = rng.uniform(0.80, 0.97)
    label = finishes.wrapped(rng, lip * 2, height - lip * 2, finishes.metallic(rng))
    profile = [
        (0, lip),
        (radius * neck - lip, lip),
        (radius * neck - lip, 0),
        (radius * neck, 0),
        (radius, 0.05 * height),
        (radius, 0.93 * height),
        (radius * neck, height),
        (radius * neck - lip, height),
        (radius * neck - lip, height - lip),
        (0, height - lip),
    ]
    parts = [Part("body", lathe(profile, 32), label)]
    if rng.random() < 0.5:
        tab = joined(
            [
                box((0.022, 0.014, 0.002), (0.004, 0, height - lip + 0.001)),
                ring(0.004, 0.008, 0.002, (0.012, 0, height - lip + 0.002)),
            ]
        )
        parts.append(Part("tab", tab, finishes.metallic(rng)))
    return assemble("can", parts, [solid_cylinder(radius, height, (0, 0, height / 2))], upright=0.6)


def jar(rng: np.random.Generator) -> Shape:
    """A jar: a bulging body, a wide mouth, a lid or a stopper."""
    height = rng.uniform(0.09, 0.19)
    radius = height * rng.uniform(0.3, 0.48)
    mouth = radius * rng.uniform(0.6, 0.88)
    foot = radius * rng.uniform(0.65, 0.95)
    share = np.linspace(0, 1, 11)
    belly = rng.uniform(0.35, 0.6)
    ends = np.where(share < belly, foot, mouth)
    swell = np.sqrt(np.clip(1 - ((share - belly) / np.where(share < belly, belly, 1 - belly)) ** 2, 0, 1))
    radii = ends + (radius - ends) * swell
    tall = 0.85 * height
    profile = [(0, 0), *[(r, tall * s) for r, s in zip(radii, share, strict=True)], (0, tall)]
    base = finishes.ceramic(rng)
    if rng.random() < 0.55:
        base = finishes.wrapped(rng, 0.25 * tall, 0.7 * tall, base, 1)
    parts = [Part("body", lathe(profile, 32), base)]
    lid: Texture = finishes.plastic(rng) if rng.random() < 0.5 else finishes.metallic(rng)
    lid_height = height - tall
    if rng.random() < 0.6:
        parts.append(Part("lid", cylinder(mouth * 1.06, lid_height, (0, 0, tall + lid_height / 2), sections=32), lid))
    else:
        lid = finishes.wooden(rng)
        dome = [
            (0, 0),
            (mouth * 1.1, 0),
            (mouth * 1.1, 0.3 * lid_height),
            (mouth * 0.5, 0.6 * lid_height),
            (0, 0.7 * lid_height),
        ]
        parts.append(Part("lid", moved(lathe(dome, 28), shift=(0, 0, tall)), lid))
        parts.append(Part("knob", ellipsoid((0.15 * mouth + 0.004,) * 3, (0, 0, tall + lid_height * 0.75), 2), lid))
    outline = [(0, 0), *[(radii[k], tall * share[k]) for k in (0, 2, 4, 6, 8, 10)], (0, tall)]
    solids = [
        solid_hull(lathe(outline, 16).vertices),
        solid_cylinder(mouth * 1.06, lid_height, (0, 0, tall + lid_height / 2)),
    ]
    return assemble("jar", parts, solids, upright=0.7)


def mug(rng: np.random.Generator) -> Shape:
    """A mug: a hollow cylinder or cup with a handle at its side."""
    radius = rng.uniform(0.035, 0.055)
    height = radius * rng.uniform(1.6, 2.6)
    foot = radius * rng.uniform(0.65, 1.0)
    wall = rng.uniform(0.004, 0.006)
    profile = [
        (0, 0),
        (foot - 0.003, 0),
        (foot, 0.004),
        (radius, height * rng.uniform(0.25, 0.6)),
        (radius, height - 0.002),
        (radius - wall / 2, height),
        (radius - wall, height - 0.002),
        (radius - wall, 0.3 * height),
        (foot - wall, 0.012),
        (0, 0.008),
    ]
    texture = finishes.ceramic(rng)
    if rng.random() < 0.45:
        image = prints.label(rng, 192, 128) if rng.random() < 0.6 else prints.pattern(rng)
        texture = Printed(
            image, texture, "around", (-np.pi, 0.15 * height), (0.2 * np.pi, 0.9 * height), gloss=texture.gloss
        )
    thickness = rng.uniform(0.0045, 0.0075)
    reach, drop = radius * rng.uniform(0.55, 0.8), height * rng.uniform(0.26, 0.36)
    path = arc((radius - wall, 0, 0.52 * height), (reach + wall, drop), -np.pi / 2, np.pi / 2, "xz", 14)
    # Many handles get a different colour than the body: a colour edge within one object.
    handle = texture if rng.random() < 0.6 and not isinstance(texture, Printed) else finishes.plastic(rng)
    parts = [
        Part("cup", lathe(profile, 32), texture),
        Part("handle", tube(path, thickness, 8, flatten=1.3), handle),
    ]
    solids = hollow([(foot, 0), (radius, height)], [(foot - wall - 0.002, 0.008), (radius - wall - 0.002, height)], 8)
    outer = radius + reach
    bar = (reach + thickness, 2.2 * thickness, 2 * thickness)
    solids += [solid_box(bar, (radius + reach / 2, 0, 0.52 * height + s * drop)) for s in (-1, 1)]
    solids.append(solid_box((2 * thickness, 2.2 * thickness, 1.5 * drop), (outer, 0, 0.52 * height)))
    return assemble("mug", parts, solids, upright=0.65)


def pot(rng: np.random.Generator) -> Shape:
    """A cooking pot with two loop handles or one long one, with or without a lid."""
    radius = rng.uniform(0.07, 0.12)
    height = radius * rng.uniform(0.75, 1.4)
    wall = rng.uniform(0.003, 0.006)
    foot = radius * rng.uniform(0.85, 1.0)
    body: Texture = finishes.metallic(rng) if rng.random() < 0.5 else finishes.plastic(rng)
    if rng.random() < 0.3:
        body = Bands((body, finishes.plastic(rng)), (height * rng.uniform(0.2, 0.8),), gloss=0.4)
    profile = [
        (0, 0),
        (foot - 0.006, 0),
        (foot, 0.006),
        (radius, height - 0.004),
        (radius + 0.004, height),
        (radius - wall, height),
        (foot - wall, 0.01),
        (0, wall + 0.002),
    ]
    grip = finishes.plastic(rng, colors.dark(rng) if rng.random() < 0.5 else None)
    parts = [Part("body", lathe(profile, 36), body)]
    solids: list[Solid]
    lidded = rng.random() < 0.5
    if lidded:
        rise = radius * rng.uniform(0.12, 0.25)
        dome = [(0, 0), (radius + 0.005, 0), (radius + 0.005, 0.006), (0.6 * radius, 0.8 * rise), (0, rise)]
        lid = body if rng.random() < 0.5 else finishes.metallic(rng)
        parts.append(Part("lid", moved(lathe(dome, 36), shift=(0, 0, height)), lid))
        knob = [(0, 0), (0.012, 0), (0.008, 0.012), (0.02, 0.02), (0.02, 0.026), (0, 0.03)]
        parts.append(Part("knob", moved(lathe(knob, 16), shift=(0, 0, height + rise - 0.004)), grip))
        solids = [
            solid_hull(
                lathe(
                    [
                        (0, 0),
                        (foot, 0),
                        (radius, height),
                        (radius, height + 0.006),
                        (0.6 * radius, height + 0.8 * rise),
                        (0, height + rise),
                    ],
                    16,
                ).vertices
            ),
            solid_cylinder(0.02, 0.028, (0, 0, height + rise + 0.012)),
        ]
    else:
        solids = hollow(
            [(foot, 0), (radius, height)], [(foot - wall - 0.003, 0.01), (radius - wall - 0.002, height)], 12
        )
    if rng.random() < 0.7:
        reach = radius * rng.uniform(0.3, 0.45)
        for side in (-1, 1):
            loop = arc(
                (side * (radius - 0.004), 0, 0.75 * height),
                (side * reach, 0.32 * radius),
                -np.pi / 2,
                np.pi / 2,
                "xy",
                12,
            )
            parts.append(Part("handle", tube(loop, 0.006, 8), grip))
            solids.append(solid_box((reach, 0.64 * radius, 0.012), (side * (radius + reach / 2), 0, 0.75 * height)))
    else:
        long = radius * rng.uniform(1.0, 1.5)
        path = np.array(
            [
                [radius - 0.004, 0, 0.8 * height],
                [radius + 0.4 * long, 0, 0.86 * height],
                [radius + long, 0, 0.88 * height],
            ]
        )
        parts.append(Part("handle", tube(path, [0.008, 0.01, 0.012], 8, flatten=1.2), grip))
        solids.append(solid_box((long, 0.026, 0.022), (radius + long / 2, 0, 0.86 * height)))
    return assemble("pot", parts, solids, upright=0.75)


def _hoop(radius: float, thickness: float) -> list[tuple[float, float]]:
    """Return the profile of a ring with an eight-sided section."""
    angle = np.linspace(0, 2 * np.pi, 9)
    section = [(radius + 0.5 * thickness * np.cos(a), 0.5 * thickness * np.sin(a)) for a in angle]
    section[-1] = section[0]
    return section


def _rounded(points: np.ndarray, radius: float) -> np.ndarray:
    """Replace corner points by small balls further inside; their hull has rounded edges."""
    middle = points.mean(axis=0)
    inset = points - radius * np.sign(points - middle)
    ball = ellipsoid((radius,) * 3, subdivisions=1).vertices
    return (inset[:, None] + ball).reshape(-1, 3)
