"""Binder, stand, tool, assembly, tray: made-up composite objects whose parts differ in appearance and shape.

They teach a model that the parts of an unknown object belong together despite a crease, a step or a change of colour
between them. None of them resembles one of the 25 categories.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh

from sgbd.sources.synthetic import finishes, prints
from sgbd.sources.synthetic.log_uniform import log_uniform
from sgbd.sources.synthetic.meshes import (
    Points,
    block,
    box,
    cylinder,
    ellipsoid,
    frustum,
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
    solid_box,
    solid_cylinder,
    solid_hull,
)
from sgbd.sources.synthetic.textures import Printed, Texture


def binder(rng: np.random.Generator) -> Shape:
    """Two leaves joined along one side, from nearly closed to flat open; something may lie on the inside of each."""
    width = log_uniform(rng, 0.1, 0.36)
    depths = width * rng.uniform(0.55, 1.4) * np.array([1.0, rng.choice([1.0, rng.uniform(0.5, 1.0)])])
    thick = np.array([log_uniform(rng, 0.005, 0.035) for _ in range(2)])
    opening = rng.uniform(0.5, np.pi)
    turn = rotation("x", -opening)
    hinge = np.array([0.0, depths[0] / 2, thick[0]])
    outside = surface(rng)
    covers = [outside, outside if rng.random() < 0.6 else surface(rng)]
    # Leaf 0 lies flat; leaf 1 is rotated about the hinge, starting from lying on leaf 0.
    poses = [(np.eye(3), np.array([0.0, 0.0, thick[0] / 2])), (turn, hinge)]
    centers = [np.zeros(3), np.array([0.0, -depths[1] / 2, thick[1] / 2])]
    parts, solids = [], []
    for leaf, (rotate, shift) in enumerate(poses):
        size = np.array([width, depths[leaf], thick[leaf]])
        parts.append(Part("leaf", moved(box(size, centers[leaf], 0.002), rotate, shift), covers[leaf]))
        solids.append(solid_box(size, rotate @ centers[leaf] + shift, rotate))
        if rng.random() < 0.75:
            layer = rng.uniform(0.002, 0.012)
            inset = size * [*rng.uniform(0.6, 0.97, 2), 0] + [0, 0, layer]
            inner = centers[leaf] + [0, 0, (thick[leaf] + layer) / 2 * (1 if leaf == 0 else -1)]
            parts.append(Part("inside", moved(box(inset, inner), rotate, shift), surface(rng)))
    return assemble("binder", parts, solids, upright=0.75)


def stand(rng: np.random.Generator) -> Shape:
    """Something held up by a stem on a foot: a lamp, a sign, a trophy, a toy."""
    reach, low = rng.uniform(0.035, 0.11), rng.uniform(0.006, 0.03)
    stem, rise = rng.uniform(0.004, 0.022), log_uniform(rng, 0.015, 0.2)
    foot_finish = surface(rng)
    stem_finish = foot_finish if rng.random() < 0.5 else surface(rng)
    head_finish = foot_finish if rng.random() < 0.25 else surface(rng)
    parts, solids = [], []
    if rng.random() < 0.5:
        parts.append(Part("foot", cylinder(reach, low, (0, 0, low / 2)), foot_finish))
        solids.append(solid_cylinder(reach, low, (0, 0, low / 2)))
    else:
        plate = (2 * reach, 2 * reach * rng.uniform(0.5, 1.0), low)
        parts.append(Part("foot", box(plate, (0, 0, low / 2), 0.002), foot_finish))
        solids.append(solid_box(plate, (0, 0, low / 2)))
    parts.append(Part("stem", cylinder(stem, rise + 0.01, (0, 0, low + rise / 2)), stem_finish))
    solids.append(solid_cylinder(stem, rise, (0, 0, low + rise / 2)))
    top = low + rise
    if rng.random() < 0.5:
        size = np.array([log_uniform(rng, 0.08, 0.36), rng.uniform(0.008, 0.04), log_uniform(rng, 0.06, 0.24)])
        tilt = rotation("x", rng.uniform(-0.4, 0.4))
        middle = np.array([0, 0, top + 0.42 * size[2]])
        parts.append(Part("head", moved(box(size, (0, 0, 0), 0.002), tilt, middle), head_finish))
        solids.append(solid_box(size, middle, tilt))
        if rng.random() < 0.5:
            front = np.array([0, -size[1] / 2, 0])
            pane = box(size * [0.88, 0, 0.85] + [0, 0.003, 0], front)
            parts.append(Part("pane", moved(pane, tilt, middle), surface(rng)))
    else:
        head, solid = convex(rng, rng.uniform(0.06, 0.2) * np.exp(rng.normal(0, 0.25, 3)), np.array([0, 0, top]))
        parts.append(Part("head", head, head_finish))
        solids.append(solid)
    return assemble("stand", parts, solids, upright=0.75)


def tool(rng: np.random.Generator) -> Shape:
    """A handle, a thin shaft and perhaps a head, in a row: a hammer, a brush, a torch, a spoon without its bowl."""
    length = log_uniform(rng, 0.1, 0.34)
    grip = length * rng.uniform(0.25, 0.6)
    thick = rng.uniform(0.006, 0.018)
    flat = rng.uniform(0.4, 1.0)
    thin = thick * rng.uniform(0.25, 0.9)
    middle = thick
    handle = tube(
        np.array([[-grip, 0, middle], [-grip / 2, rng.normal(0, 0.05) * grip, middle], [0.0, 0, middle]]),
        thick * rng.uniform(0.7, 1.0, 3),
        10,
    )
    handle.apply_translation([0, 0, -middle])
    handle.apply_scale([1, 1, flat])
    handle.apply_translation([0, 0, middle])
    shaft = (length - grip, 2 * thin, 2 * thin * rng.uniform(0.2, 1.0))
    along = np.array([(length - grip) / 2, 0, middle])
    finish = surface(rng)
    parts = [
        Part("handle", handle, surface(rng)),
        Part("shaft", box(shaft, along), finish),
    ]
    solids = [
        solid_box((grip, 1.7 * thick, 1.7 * thick * flat), (-grip / 2, 0, middle)),
        solid_box(shaft, along),
    ]
    if rng.random() < 0.6:
        size = np.array([rng.uniform(0.1, 0.3), rng.uniform(0.15, 0.5), 0.0]) * length
        size[2] = rng.uniform(0.5, 2.5) * thick
        head, solid = convex(rng, size, np.array([length - grip, 0, middle - size[2] / 2]))
        parts.append(Part("head", head, finish if rng.random() < 0.5 else surface(rng)))
        solids.append(solid)
    return assemble("tool", parts, solids, upright=0.9)


def assembly(rng: np.random.Generator) -> Shape:
    """Two to four convex bodies on and beside each other: an appliance, a toy, a building set."""
    size = np.clip(log_uniform(rng, 0.06, 0.2) * np.exp(rng.normal(0, 0.35, 3)), 0.02, 0.3)
    finish = surface(rng)
    body, solid = convex(rng, size, np.zeros(3))
    parts, solids = [Part("body", body, finish)], [solid]
    for _ in range(int(rng.integers(1, 4))):
        low, high = parts[-1].mesh.bounds
        extent = high - low
        small = np.minimum(extent * rng.uniform(0.35, 1.15, 3), 0.25)
        if rng.random() < 0.6:
            place = np.array([*((low + high)[:2] / 2 + 0.15 * rng.normal(size=2) * extent[:2]), high[2] - 0.004])
        else:
            side, sign = int(rng.integers(2)), rng.choice([-1, 1])
            place = np.array([*(low + high)[:2] / 2, low[2]])
            place[side] += sign * ((extent[side] + small[side]) / 2 - 0.004)
        body, solid = convex(rng, small, place)
        parts.append(Part("body", body, finish if rng.random() < 0.35 else surface(rng)))
        solids.append(solid)
    return assemble("assembly", parts, solids, upright=0.7)


def tray(rng: np.random.Generator) -> Shape:
    """An open vessel with four to eight flat walls that objects can fall into: a tray, a crate, an open box."""
    sides = int(rng.choice([4, 4, 4, 5, 6, 8]))
    radius = log_uniform(rng, 0.06, 0.2)
    height = log_uniform(rng, 0.02, 0.16)
    wall, floor = rng.uniform(0.003, 0.012), rng.uniform(0.003, 0.01)
    flare, stretch = rng.uniform(1.0, 1.35), rng.uniform(0.55, 1.0)
    angles = 2 * np.pi * (np.arange(sides + 1) + 0.5) / sides
    corner = np.stack([np.cos(angles), stretch * np.sin(angles)], axis=1)

    def at(scale: float, z: float) -> Points:
        return np.column_stack([corner * scale, np.full(len(corner), z)])

    outer, inner = (
        (at(radius, 0), at(radius * flare, height)),
        (at(radius - wall, floor), at(radius * flare - wall, height)),
    )
    walls = [np.concatenate([ring[k : k + 2] for ring in (*outer, *inner)]) for k in range(sides)]
    bottom = np.concatenate([outer[0], at(radius - wall / 2, floor)])
    finish = surface(rng)
    parts = [
        Part("walls", joined([hull(points) for points in walls]), finish),
        Part("floor", hull(bottom), finish if rng.random() < 0.6 else surface(rng)),
    ]
    return assemble("tray", parts, [solid_hull(points) for points in [*walls, bottom]], upright=0.7)


SUNDRIES: tuple[Callable[[np.random.Generator], Shape], ...] = (binder, stand, tool, assembly, tray)
"""All made-up objects, drawn with equal probability."""


def convex(rng: np.random.Generator, size: Points, foot: Points) -> tuple[trimesh.Trimesh, Solid]:
    """Draw a convex body as mesh and as collision solid: a box, tapered box, roof, cylinder, cone or egg.

    Args:
        rng: Random generator.
        size: Lengths along x, y, z [3], metres.
        foot: Centre of its bottom [3].
    """
    kind = int(rng.integers(6))
    middle = foot + np.array([0, 0, size[2] / 2])
    if kind == 0:
        return box(size, middle, 0.08 * float(size.min())), solid_box(size, middle)
    if kind in (1, 2):
        top = size[:2] * (rng.uniform(0.4, 1.0, 2) if kind == 1 else np.array([rng.uniform(0.7, 1.05), 0.03]))
        corners = frustum(size[:2], top, float(size[2]), at=foot)
        return block(corners), solid_hull(corners)
    if kind in (3, 4):
        top_radius = 0.5 * (1.0 if kind == 3 else rng.uniform(0.2, 0.8))
        mesh = lathe([(0, 0), (0.5, 0), (top_radius, 1), (0, 1)], 32)
    else:
        mesh = ellipsoid((0.5, 0.5, 0.5), (0, 0, 0.5), 3)
    mesh.apply_scale(size)
    mesh.apply_translation(foot)
    # The collision hull is coarser than the mesh and only slightly smaller.
    return mesh, solid_hull(mesh.vertices[:: 1 if kind < 5 else 3])


def surface(rng: np.random.Generator) -> Texture:
    """Draw any finish; one third of them have a print."""
    makers = (finishes.plastic, finishes.plastic, finishes.casing, finishes.metallic, finishes.wooden, finishes.cloth)
    base: Texture = makers[int(rng.integers(len(makers)))](rng)
    if rng.random() < 0.33:
        picture = prints.pattern(rng, 96, 96) if rng.random() < 0.5 else prints.label(rng, 192, 128)
        half = log_uniform(rng, 0.03, 0.15)
        base = Printed(picture, base, "box", (-half, -half), (half, half), gloss=base.gloss)
    return base
