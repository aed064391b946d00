"""Birdhouse, cap, helmet, knife, pillow."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import trimesh

from sgbd.sources.synthetic import colors, finishes, prints
from sgbd.sources.synthetic.meshes import (
    arc,
    box,
    cushion,
    cylinder,
    ellipsoid,
    hull,
    joined,
    lathe,
    moved,
    rotation,
    tube,
)
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
from sgbd.sources.synthetic.textures import Plain, Printed, Speckled, Stripes, Texture


def birdhouse(rng: np.random.Generator) -> Shape:
    """A nesting box: a gabled box, two roof boards that overhang, a round hole, a perch, a floor board."""
    width = rng.uniform(0.10, 0.16)
    depth, eaves = width * rng.uniform(0.8, 1.2), width * rng.uniform(0.9, 1.5)
    pitch = rng.uniform(0.5, 0.95)
    ridge = eaves + 0.5 * width * np.tan(pitch)
    wall: Texture = finishes.wooden(rng, 2) if rng.random() < 0.6 else finishes.plastic(rng)
    roof: Texture = finishes.wooden(rng, 1) if rng.random() < 0.5 else finishes.plastic(rng)
    if rng.random() < 0.3:
        pair = np.stack([colors.any_color(rng), colors.any_color(rng)])
        wall = Stripes(pair, np.array([0, 0, 1], dtype=np.float32), rng.uniform(0.02, 0.05), gloss=0.1)
    front = -depth / 2
    gable = np.array(
        [[x * width / 2, y * depth / 2, z] for x in (-1, 1) for y in (-1, 1) for z in (0, eaves)]
        + [[0, y * depth / 2, ridge] for y in (-1, 1)]
    )
    parts = [Part("walls", hull(gable), wall)]
    solids: list[Solid] = [solid_hull(gable)]
    thick, over = 0.009, rng.uniform(0.015, 0.03)
    run = 0.5 * width / np.cos(pitch) + over
    for s in (-1, 1):
        turn = rotation("y", s * pitch)
        center = np.array([0, 0, ridge + 0.004]) + turn @ [s * run / 2, 0, thick / 2]
        size = (run + thick, depth + 2 * over, thick)
        parts.append(Part("roof", moved(box(size, bevel=0.001), turn, center), roof))
        solids.append(solid_box(size, center, turn))
    hole = rng.uniform(0.14, 0.22) * width
    parts.append(
        Part(
            "hole",
            cylinder(hole, 0.004, (0, front - 0.001, 0.68 * eaves), "y", 24),
            Plain(colors.dark(rng) * np.float32(0.5)),
        )
    )
    perch_z = 0.68 * eaves - hole - 0.02
    parts.append(Part("perch", cylinder(0.005, 0.04, (0, front - 0.018, perch_z), "y", 10), finishes.wooden(rng)))
    solids.append(solid_cylinder(0.005, 0.04, (0, front - 0.018, perch_z), "y"))
    floor = (width + 0.03, depth + 0.04, 0.01)
    parts.append(Part("floor", box(floor, (0, 0, -0.005), 0.002), roof))
    solids.append(solid_box(floor, (0, 0, -0.005)))
    return assemble("birdhouse", parts, solids, upright=0.7)


def cap(rng: np.random.Generator) -> Shape:
    """A baseball cap: a hollow dome of panels, a curved peak in front, a button on top."""
    radius = rng.uniform(0.075, 0.10)
    height = radius * rng.uniform(0.9, 1.15)
    squash = rng.uniform(1.05, 1.2)
    angle = np.linspace(0, np.pi / 2, 9)
    outside = [(radius * np.cos(a) ** 0.8, height * np.sin(a)) for a in angle]
    inside = [(max(r - 0.004, 0), z * 0.96) for r, z in outside]
    dome = lathe([*outside[:-1], (0, height), *[(r, z) for r, z in inside[::-1][1:]], outside[0]], 30, squash)
    crown = finishes.cloth(rng)
    if rng.random() < 0.35:
        pair = np.stack([colors.any_color(rng), colors.any_color(rng)])
        crown = Stripes(pair, None, 2 * np.pi / 3, rng.random(), gloss=0.0)
    if rng.random() < 0.4:
        logo = prints.label(rng, 96, 64) if rng.random() < 0.5 else prints.pattern(rng, 96, 64)
        crown = Printed(logo, crown, "-y", (-0.4 * radius, 0.25 * height), (0.4 * radius, 0.7 * height), gloss=0.0)
    peak_texture = crown if rng.random() < 0.35 and not isinstance(crown, Printed) else finishes.cloth(rng)
    reach = radius * rng.uniform(0.7, 0.95)
    bend = rng.uniform(0.1, 0.3) * radius
    peak = _peak(0.92 * radius, -0.72 * radius * squash, reach, bend)
    parts = [
        Part("crown", dome, crown),
        Part("peak", peak, peak_texture),
        Part("button", ellipsoid((0.009, 0.009, 0.006), (0, 0, height), 2), peak_texture),
    ]
    wall = hollow(
        [(radius, 0), (0.8 * radius, 0.62 * height)], [(radius - 0.008, 0), (0.74 * radius, 0.6 * height)], floor=False
    )
    solids = squashed(wall, squash)
    solids.append(
        solid_hull(
            lathe([(0, 0.6 * height), (0.8 * radius, 0.6 * height), *outside[4:-1], (0, height)], 14, squash).vertices
        )
    )
    edge = -0.72 * radius * squash
    for side, y, z in ((-1, 0.3, 0.45), (0, 0.42, 0.0), (1, 0.3, 0.45)):
        plate = solid_box((0.6 * radius, reach, 0.008), (side * 0.55 * radius, edge - y * reach, -z * bend))
        solids.append(plate)
    return assemble("cap", parts, solids, upright=0.75)


def helmet(rng: np.random.Generator) -> Shape:
    """A helmet: a thick hollow shell with a ridge, stripes or vents, and a brim, a visor or ear pieces."""
    radius = rng.uniform(0.085, 0.12)
    height = radius * rng.uniform(0.95, 1.25)
    squash = rng.uniform(1.12, 1.3)
    skirt = rng.uniform(0.1, 0.35) * height
    angle = np.linspace(0, np.pi / 2, 10)
    outside = [(0.94 * radius, 0), *[(radius * np.cos(a), skirt + (height - skirt) * np.sin(a)) for a in angle]]
    inside = [(max(r - 0.012, 0), z - (0.0 if k == 0 else 0.012)) for k, (r, z) in enumerate(outside)]
    shell = lathe([*outside[:-1], (0, height), (0, height - 0.012), *inside[::-1][1:], outside[0]], 34, squash)
    main = finishes.plastic(rng)
    texture: Texture = main
    if rng.random() < 0.4:
        pair = np.stack([colors.any_color(rng), colors.any_color(rng)])
        texture = Stripes(
            pair, np.array([1, 0, 0], dtype=np.float32), rng.uniform(0.6, 1.3) * radius, rng.random(), gloss=0.5
        )
    elif rng.random() < 0.3:
        pair = np.stack([colors.any_color(rng), colors.any_color(rng)])
        texture = Speckled(pair, (0.03, 0.03, 0.03), 0.8, finishes.seed_of(rng), gloss=0.2)
    parts = [Part("shell", shell, texture)]
    trim = finishes.plastic(rng)
    wall = hollow(
        [(0.97 * radius, 0), (0.9 * radius, skirt + 0.45 * (height - skirt))],
        [(0.85 * radius, 0), (0.78 * radius, skirt + 0.4 * (height - skirt))],
        floor=False,
    )
    solids = squashed(wall, squash)
    top = skirt + 0.42 * (height - skirt)
    solids.append(solid_hull(lathe([(0, top), (0.9 * radius, top), *outside[4:-1], (0, height)], 14, squash).vertices))
    kind = rng.choice(3)
    if kind == 0:
        brim = [
            (0.93 * radius, 0),
            (1.22 * radius, -0.004),
            (1.22 * radius, 0.004),
            (0.93 * radius, 0.014),
            (0.93 * radius, 0),
        ]
        parts.append(Part("brim", lathe(brim, 34, squash), texture if rng.random() < 0.5 else trim))
        ridge = arc((0, 0, skirt), (radius * squash * 0.97, height - skirt + 0.006), 0.35, np.pi - 0.35, "yz", 16)
        parts.append(Part("ridge", tube(ridge, 0.008, 8), main))
        # A disc below the shell would close it, so the brim is made part of the lowest ring for collisions.
        rim = hollow(
            [(1.22 * radius, 0), (1.0 * radius, 0.012)], [(0.9 * radius, 0), (0.9 * radius, 0.01)], floor=False
        )
        solids += squashed(rim, squash)
    elif kind == 1:
        band = np.array(
            [
                [1.0 * radius * np.cos(a) + 0.004, skirt * 0.6 + 0.62 * (height - skirt) * np.sin(a)]
                for a in np.linspace(0, 1.0, 5)
            ]
        )
        around = np.linspace(-0.5 * np.pi - 1.0, -0.5 * np.pi + 1.0, 11)
        panes = []
        for left, right in pairwise(around):
            for low, high in pairwise(band):
                corners = [
                    (k * r * np.cos(t), k * r * squash * np.sin(t), z)
                    for t in (left, right)
                    for r, z in (low, high)
                    for k in (0.94, 1.03)
                ]
                panes.append(hull(corners))
        glass = joined(panes)
        parts.append(Part("visor", glass, Plain(colors.dark(rng), 0.0, gloss=0.9)))
    else:
        for s in (-1, 0, 1):
            path = arc(
                (s * 0.38 * radius, 0, skirt),
                (0.9 * radius * squash, (0.94 - 0.09 * abs(s)) * (height - skirt) + 0.01),
                0.5,
                np.pi - 0.5,
                "yz",
                14,
            )
            parts.append(Part("vent", tube(path, 0.01, 8, flatten=0.9), trim))
        parts.append(Part("peak", _peak(0.75 * radius, -0.8 * radius * squash, 0.35 * radius, 0.02), trim))
        solids.append(solid_box((1.3 * radius, 0.35 * radius, 0.008), (0, -0.95 * radius * squash, -0.004)))
    return assemble("helmet", parts, solids, upright=0.75)


def knife(rng: np.random.Generator) -> Shape:
    """A knife lying on its side: a thin pointed blade, a bolster, a handle with rivets."""
    length = rng.uniform(0.18, 0.32)
    share = rng.uniform(0.5, 0.65)
    blade, deep = share * length, length * rng.uniform(0.08, 0.16)
    thick = rng.uniform(0.003, 0.005)
    grip_length, grip_deep, grip_thick = (1 - share) * length, length * rng.uniform(0.07, 0.1), rng.uniform(0.014, 0.02)
    tip = rng.uniform(-0.5, 0.5) * deep
    knee = rng.uniform(0.55, 0.85)
    outline = [(0, -deep / 2), (0, deep / 2), (knee * blade, deep / 2), (blade, tip), (0.95 * knee * blade, -deep / 2)]
    middle = grip_thick / 2
    points = [(x, y, middle + s * thick / 2 * (1.0 if y > 0 else 0.25)) for x, y in outline for s in (-1, 1)]
    steel = Plain(colors.rgb(0.78, 0.79, 0.81), 0.05, 0.01, finishes.seed_of(rng), gloss=0.9)
    grip: Texture = finishes.wooden(rng, 0) if rng.random() < 0.5 else finishes.plastic(rng)
    bow = rng.uniform(-0.2, 0.2) * grip_deep
    back = np.array([[-0.004, 0, middle], [-0.5 * grip_length, bow, middle], [-grip_length, 1.3 * bow, middle]])
    grip_radii = np.array([0.8, 1.0, 0.9]) * grip_thick / 2
    handle = tube(back, grip_radii, 12)
    # The swept cross-section is round: stretch it to the depth of the grip.
    handle.apply_scale([1, grip_deep / grip_thick, 1])
    parts = [Part("blade", hull(points), steel), Part("handle", handle, grip)]
    parts.append(
        Part(
            "bolster", box((0.014, 0.95 * grip_deep, 0.95 * grip_thick), (0, 0, middle), 0.003), finishes.metallic(rng)
        )
    )
    if rng.random() < 0.5:
        rivets = [
            cylinder(0.0035, grip_thick * 1.03, (-s * grip_length, 0.5 * bow, middle), sections=10)
            for s in (0.25, 0.5, 0.75)
        ]
        parts.append(Part("rivets", joined(rivets), finishes.metallic(rng)))
    solids = [
        solid_box((blade * 0.9, deep * 0.9, thick), (0.45 * blade, 0, middle)),
        solid_box((grip_length, grip_deep, grip_thick), (-grip_length / 2, bow * 0.5, middle)),
    ]
    return assemble("knife", parts, solids, upright=0.9)


def pillow(rng: np.random.Generator) -> Shape:
    """A pillow: a stuffed cushion, thick in the middle and thin at the seam, perhaps with piping."""
    width = rng.uniform(0.16, 0.28)
    depth, thick = width * rng.uniform(0.6, 1.0), width * rng.uniform(0.22, 0.4)
    mesh = cushion((width, depth, thick), rng.uniform(2.0, 4.0))
    parts = [Part("cushion", mesh, finishes.cloth(rng))]
    if rng.random() < 0.4:
        line = np.sin(np.linspace(-np.pi / 2, np.pi / 2, 9))
        sag_x, sag_y = 0.5 * width * (1 - 0.07 * (1 - line**2)), 0.5 * depth * (1 - 0.07 * (1 - line**2))
        piping = finishes.plastic(rng)
        radius = 0.02 * thick + 0.002
        seams = []
        for s in (-1, 1):
            seams.append(tube(np.stack([s * sag_x, line * depth / 2, 0 * line], 1), radius, 6))
            seams.append(tube(np.stack([line * width / 2, s * sag_y, 0 * line], 1), radius, 6))
        parts.append(Part("piping", joined(seams), piping))
    # Use a slightly smaller hull of every third vertex for collisions: cloth is soft.
    points = mesh.vertices[np.abs(mesh.vertices[:, 2]) > 0.1 * thick][::3] * [0.98, 0.98, 0.97]
    return assemble("pillow", parts, [solid_hull(points)], upright=0.7)


def _peak(half_width: float, edge: float, reach: float, bend: float) -> trimesh.Trimesh:
    """Return the curved plate of a peak, from y = edge to edge - reach, which hangs down at its sides."""
    steps = 13
    x = np.linspace(-1, 1, steps)
    front = edge - reach * np.sqrt(np.clip(1 - x**2, 0, 1))
    back = edge + 0.25 * reach * (x**2)
    sag = -bend * x**2
    slices = []
    for k in range(steps - 1):
        points = []
        for i in (k, k + 1):
            for y in (back[i], min(front[i], back[i] - 0.002)):
                points += [(x[i] * half_width, y, sag[i] + 0.002), (x[i] * half_width, y, sag[i] + 0.006)]
        slices.append(hull(points))
    return joined(slices)
