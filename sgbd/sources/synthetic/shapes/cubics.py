"""Dishwasher, microwave, printer, washer: box-shaped appliances, in the small scale of the dataset. Fronts face -y."""

from __future__ import annotations

import numpy as np

from sgbd.sources.synthetic import colors, finishes, prints
from sgbd.sources.synthetic.meshes import box, cylinder, frustum, hull, joined, moved, ring, rotation, tube
from sgbd.sources.synthetic.shapes.part import Part, Shape, assemble, solid_box, solid_hull
from sgbd.sources.synthetic.textures import Plain, Printed, Texture


def washer(rng: np.random.Generator) -> Shape:
    """A washing machine: an upright box with a round door of dark glass and a panel with a knob and a drawer."""
    width = rng.uniform(0.13, 0.20)
    depth, height = width * rng.uniform(0.8, 1.05), width * rng.uniform(1.2, 1.5)
    shell = finishes.casing(rng)
    front = -depth / 2
    panel_height = 0.16 * height
    panel_middle = height - panel_height / 2 - 0.02 * height
    parts = [
        Part("shell", box((width, depth, height), (0, 0, height / 2), 0.004), shell),
        Part("panel", box((0.94 * width, 0.006, panel_height), (0, front - 0.001, panel_middle)), finishes.casing(rng)),
        Part(
            "drawer",
            box((0.28 * width, 0.006, 0.7 * panel_height), (-0.3 * width, front - 0.003, panel_middle)),
            finishes.plastic(rng),
        ),
        Part(
            "knob",
            cylinder(0.3 * panel_height, 0.014, (0.05 * width, front - 0.007, panel_middle), "y"),
            finishes.metallic(rng),
        ),
    ]
    buttons = [
        box((0.05 * width, 0.006, 0.2 * panel_height), ((0.2 + 0.08 * k) * width, front - 0.004, panel_middle))
        for k in range(4)
    ]
    parts.append(Part("buttons", joined(buttons), finishes.plastic(rng)))
    radius = width * rng.uniform(0.27, 0.36)
    door = (0.0, front - 0.004, height * 0.45)
    parts.append(
        Part(
            "door",
            ring(0.72 * radius, radius, 0.016, door, "y", 36),
            finishes.metallic(rng) if rng.random() < 0.5 else finishes.casing(rng),
        )
    )
    parts.append(Part("glass", cylinder(0.74 * radius, 0.012, door, "y", 32), finishes.glass_dark(rng)))
    solids = [
        solid_box((width, depth, height), (0, 0, height / 2)),
        solid_box((2 * radius, 0.01, 2 * radius), (0, front - 0.005, door[2])),
    ]
    return assemble("washer", parts, solids)


def dishwasher(rng: np.random.Generator) -> Shape:
    """A dishwasher: an upright box with a flat door, a bar handle across, a dark strip of buttons, a plinth on feet."""
    width = rng.uniform(0.13, 0.21)
    depth, height = width * rng.uniform(0.85, 1.1), width * rng.uniform(1.2, 1.5)
    front = -depth / 2
    plinth = 0.1 * height
    strip = rng.uniform(0.09, 0.15) * height
    door_height = height - plinth - strip - 0.02 * height
    door = finishes.metallic(rng) if rng.random() < 0.5 else finishes.casing(rng)
    parts = [
        Part("shell", box((width, depth, height - plinth), (0, 0, (height + plinth) / 2), 0.003), finishes.casing(rng)),
        Part(
            "plinth",
            box((0.92 * width, 0.88 * depth, plinth + 0.01), (0, 0.02 * depth, plinth / 2 + 0.005)),
            Plain(colors.dark(rng)),
        ),
        Part(
            "door",
            box(
                (0.96 * width, 0.014, door_height), (0, front - 0.004, plinth + door_height / 2 + 0.005 * height), 0.002
            ),
            door,
        ),
        Part(
            "controls",
            box((0.96 * width, 0.01, strip), (0, front - 0.002, height - strip / 2 - 0.006 * height), 0.002),
            Plain(colors.dark(rng), gloss=0.6),
        ),
    ]
    buttons = [
        box((0.035 * width, 0.006, 0.3 * strip), ((x - 0.5) * 0.8 * width, front - 0.007, height - 0.55 * strip))
        for x in np.linspace(0, 1, rng.integers(4, 9))
    ]
    parts.append(Part("buttons", joined(buttons), finishes.plastic(rng)))
    z = plinth + 0.9 * door_height
    bar = [
        tube(
            np.array([[-0.38 * width, front - 0.026, z], [0, front - 0.026, z], [0.38 * width, front - 0.026, z]]),
            0.006,
            8,
        )
    ]
    bar += [box((0.012, 0.024, 0.01), (s * 0.34 * width, front - 0.014, z)) for s in (-1, 1)]
    parts.append(Part("handle", joined(bar), finishes.metallic(rng)))
    solids = [
        solid_box((width, depth, height - plinth), (0, 0, (height + plinth) / 2)),
        solid_box((0.92 * width, 0.88 * depth, plinth), (0, 0.02 * depth, plinth / 2)),
        solid_box((0.76 * width, 0.034, 0.012), (0, front - 0.016, z)),
        solid_box((0.96 * width, 0.012, door_height), (0, front - 0.005, plinth + door_height / 2)),
    ]
    return assemble("dishwasher", parts, solids)


def microwave(rng: np.random.Generator) -> Shape:
    """A microwave oven: a wide low box with a window, a handle bar and a column of keys at the right."""
    width = rng.uniform(0.20, 0.30)
    depth, height = width * rng.uniform(0.6, 0.78), width * rng.uniform(0.5, 0.62)
    front = -depth / 2
    shell = finishes.casing(rng)
    split = rng.uniform(0.2, 0.27) * width
    face_color = colors.dark(rng) if rng.random() < 0.5 else colors.light(rng)
    door_width = 0.97 * width - split
    door_x = -0.485 * width + door_width / 2
    panel_x = width / 2 - 0.015 * width - split / 2
    lift = 0.012
    middle = lift + height / 2
    keys = prints.keypad(rng, 3, 5, face_color)
    panel: Texture = Printed(
        keys,
        Plain(face_color, gloss=0.3),
        "-y",
        (panel_x - 0.4 * split, lift + 0.1 * height),
        (panel_x + 0.4 * split, lift + 0.6 * height),
        gloss=0.3,
    )
    clock = Plain(colors.vivid(rng) * np.float32(0.5), gloss=0.6)
    parts = [
        Part("shell", box((width, depth, height), (0, 0, middle), 0.005), shell),
        Part(
            "door",
            box((door_width, 0.014, 0.94 * height), (door_x, front - 0.004, middle), 0.003),
            finishes.casing(rng),
        ),
        Part(
            "window",
            box((0.72 * door_width, 0.006, 0.62 * height), (door_x - 0.04 * door_width, front - 0.0095, middle)),
            finishes.glass_dark(rng),
        ),
        Part("panel", box((split, 0.012, 0.94 * height), (panel_x, front - 0.003, middle), 0.002), panel),
        Part(
            "clock", box((0.75 * split, 0.004, 0.14 * height), (panel_x, front - 0.0085, lift + 0.82 * height)), clock
        ),
    ]
    bar_x = door_x + 0.43 * door_width
    handle = [box((0.012, 0.012, 0.7 * height), (bar_x, front - 0.028, middle), 0.003)]
    handle += [box((0.01, 0.022, 0.01), (bar_x, front - 0.018, middle + s * 0.3 * height)) for s in (-1, 1)]
    parts.append(Part("handle", joined(handle), finishes.metallic(rng)))
    feet = [
        cylinder(0.01, lift + 0.004, (x * 0.4 * width, y * 0.36 * depth, (lift + 0.004) / 2), sections=12)
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    parts.append(Part("feet", joined(feet), Plain(colors.dark(rng))))
    solids = [
        solid_box((width, depth, height), (0, 0, middle)),
        solid_box((0.86 * width, 0.78 * depth, lift), (0, 0, lift / 2)),
        solid_box((0.012, 0.034, 0.7 * height), (bar_x, front - 0.017, middle)),
    ]
    return assemble("microwave", parts, solids)


def printer(rng: np.random.Generator) -> Shape:
    """A desk printer: a stepped box with a sloping paper rest behind, sheets in it, and an output tray in front."""
    width = rng.uniform(0.20, 0.30)
    depth, height = width * rng.uniform(0.6, 0.85), width * rng.uniform(0.32, 0.5)
    front = -depth / 2
    shell = finishes.casing(rng)
    slant = rng.uniform(0.0, 0.3) * depth
    base = frustum((width, depth), (0.97 * width, depth - slant), 0.9 * height, (0, slant / 2))
    top_width = rng.uniform(0.7, 0.95) * width
    parts = [
        Part("shell", hull(base), shell),
        Part(
            "cover",
            box((top_width, 0.6 * (depth - slant), 0.1 * height), (0, slant / 2 + 0.03 * depth, 0.95 * height), 0.004),
            finishes.casing(rng),
        ),
        Part(
            "slot",
            box((0.8 * width, 0.02, 0.16 * height), (0, front - 0.001 + 0.15 * slant, 0.28 * height)),
            Plain(colors.dark(rng) * np.float32(0.5)),
        ),
    ]
    reach = rng.uniform(0.15, 0.4) * depth
    tray_z = 0.16 * height
    parts.append(
        Part(
            "tray",
            box((0.76 * width, reach + 0.02, 0.008), (0, front - reach / 2, tray_z), 0.002),
            finishes.plastic(rng, colors.dark(rng)),
        )
    )
    paper = Plain(colors.rgb(0.95, 0.95, 0.94), 0.01)
    parts.append(Part("sheet", box((0.62 * width, reach, 0.003), (0, front - reach / 2 + 0.01, tray_z + 0.006)), paper))
    buttons = prints.keypad(rng, 4, 1, colors.dark(rng), 24)
    strip = Printed(buttons, Plain(colors.dark(rng)), "+z", (0.2 * width, -0.1 * depth), (0.44 * width, -0.02 * depth))
    parts.append(
        Part(
            "buttons",
            box(
                (0.26 * width, 0.1 * depth, 0.006),
                (0.33 * width * top_width / width, slant / 2 - 0.06 * depth, 1.0 * height),
                0.001,
            ),
            strip,
        )
    )
    solids = [
        solid_hull(base),
        solid_box((top_width, 0.6 * (depth - slant), 0.12 * height), (0, slant / 2 + 0.03 * depth, 0.94 * height)),
    ]
    solids.append(solid_box((0.76 * width, reach, 0.012), (0, front - reach / 2, tray_z + 0.001)))
    long = rng.uniform(0.5, 1.0) * height
    lean = rotation("x", -rng.uniform(0.2, 0.45))
    hinge = np.array([0, depth / 2 - 0.02, 0.85 * height])
    rest = box((0.7 * width, 0.006, long), (0, 0, long / 2), 0.002)
    parts.append(Part("rest", moved(rest, lean, hinge), finishes.plastic(rng)))
    pile = box((0.6 * width, 0.004, 1.15 * long), (0, -0.005, 0.58 * long))
    parts.append(Part("paper", moved(pile, lean, hinge), paper))
    solids.append(solid_box((0.7 * width, 0.012, 1.1 * long), hinge + lean @ [0, -0.002, 0.55 * long], lean))
    return assemble("printer", parts, solids, upright=0.7)
