"""Camera, cellular telephone, clock, keyboard, display, laptop, loudspeaker, telephone. Fronts face -y."""

from __future__ import annotations

import numpy as np
import trimesh

from sgbd.sources.synthetic import colors, finishes, prints
from sgbd.sources.synthetic.meshes import (
    arc,
    block,
    box,
    cylinder,
    ellipsoid,
    frustum,
    hull,
    joined,
    lathe,
    moved,
    placed,
    ring,
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
from sgbd.sources.synthetic.textures import Bands, Plain, Printed, Texture


def camera(rng: np.random.Generator) -> Shape:
    """A photo camera: a box body, a lens barrel of steps in front, a viewfinder hump, a shutter button, a grip."""
    width = rng.uniform(0.10, 0.16)
    depth, height = width * rng.uniform(0.28, 0.42), width * rng.uniform(0.56, 0.7)
    front = -depth / 2
    skin = Plain(colors.dark(rng), 0.3, 0.002, finishes.seed_of(rng), gloss=0.1)
    top = finishes.metallic(rng) if rng.random() < 0.5 else finishes.plastic(rng)
    shell: Texture = Bands((skin, top), (0.72 * height,)) if rng.random() < 0.7 else finishes.plastic(rng)
    parts = [Part("body", box((width, depth, height), (0, 0, height / 2), 0.006), shell)]
    radius = height * rng.uniform(0.33, 0.46)
    long = depth * rng.uniform(0.6, 1.6)
    steps = [
        (0, 0),
        (radius, 0),
        (radius, 0.35 * long),
        (0.92 * radius, 0.4 * long),
        (0.92 * radius, 0.75 * long),
        (radius, 0.8 * long),
        (radius, long),
        (0.8 * radius, long),
        (0.65 * radius, 0.8 * long),
        (0, 0.8 * long),
    ]
    x = rng.uniform(-0.08, 0.1) * width
    lens = placed(lathe(steps, 28), (x, front + 0.002, 0.46 * height), "-y")
    parts.append(
        Part("lens", lens, finishes.plastic(rng, colors.dark(rng)) if rng.random() < 0.7 else finishes.metallic(rng))
    )
    glass = ellipsoid((0.64 * radius, 0.2 * radius, 0.64 * radius), (x, front - 0.76 * long, 0.46 * height), 2)
    parts.append(Part("glass", glass, Plain(colors.rgb(0.12, 0.1, 0.22), 0.0, gloss=1.0)))
    hump = frustum((0.36 * width, 0.95 * depth), (0.2 * width, 0.6 * depth), 0.22 * height, at=(x, 0, height - 0.002))
    parts.append(Part("viewfinder", hull(hump), top))
    button = cylinder(0.05 * width, 0.05 * height + 0.008, (0.36 * width, 0, height + 0.004), sections=16)
    parts.append(Part("shutter", button, finishes.metallic(rng)))
    grip = box((0.16 * width, 0.4 * depth, 0.86 * height), (-0.4 * width, front - 0.1 * depth, 0.45 * height), 0.006)
    parts.append(Part("grip", grip, skin))
    solids = [
        solid_box((width, depth, height), (0, 0, height / 2)),
        solid_cylinder(radius, long, (x, front - long / 2, 0.46 * height), "y"),
        solid_hull(hump),
        solid_box((0.16 * width, 0.4 * depth, 0.86 * height), (-0.4 * width, front - 0.1 * depth, 0.45 * height)),
    ]
    return assemble("camera", parts, solids, upright=0.6)


def cellular_telephone(rng: np.random.Generator) -> Shape:
    """A mobile phone lying flat: a slate with a screen, a bar with keys and an aerial, or an open folding one."""
    length = rng.uniform(0.13, 0.20)
    width, thick = length * rng.uniform(0.42, 0.54), length * rng.uniform(0.07, 0.13)
    body = finishes.plastic(rng)
    kind = rng.choice(3, p=(0.5, 0.3, 0.2))

    def face(low: float, high: float, z: float, picture: np.ndarray, name: str) -> Part:
        size = (0.86 * width, (high - low) * length, 0.002)
        where = (0, (low + high) / 2 * length, z)
        edge = (0.42 * width, (high - low) / 2 * length * 0.98)
        image = Printed(
            picture,
            Plain(colors.dark(rng), gloss=0.8),
            "+z",
            (-edge[0], where[1] - edge[1]),
            (edge[0], where[1] + edge[1]),
            gloss=0.8,
        )
        return Part(name, box(size, where), image)

    keys = prints.keypad(rng, 3, 4, colors.dark(rng))
    picture = prints.screen(rng, 96, 150)
    if kind == 0:
        slab = box((width, length, thick), (0, 0, thick / 2), 0.35 * thick)
        parts = [Part("body", slab, body), face(-0.38, 0.42, thick, picture, "screen")]
        parts.append(
            Part(
                "button", cylinder(0.08 * width, 0.003, (0, -0.44 * length, thick), sections=16), finishes.metallic(rng)
            )
        )
        solids = [solid_box((width, length, thick), (0, 0, thick / 2))]
    elif kind == 1:
        thick *= 1.4
        slab = hull(frustum((width, length), (0.9 * width, 0.96 * length), thick))
        parts = [
            Part("body", slab, body),
            face(0.08, 0.42, thick, picture, "screen"),
            face(-0.42, 0.02, thick, keys, "keys"),
            Part(
                "aerial",
                tube(
                    np.array([[0.35, 0.45, 0.5], [0.35, 0.55, 0.5], [0.35, 0.68, 0.5]]) * [width, length, thick],
                    0.25 * thick,
                    8,
                ),
                Plain(colors.dark(rng)),
            ),
        ]
        solids = [
            solid_box((width, length, thick), (0, 0, thick / 2)),
            solid_box((0.5 * thick, 0.2 * length, 0.5 * thick), (0.35 * width, 0.58 * length, 0.5 * thick)),
        ]
    else:
        length *= 0.6
        turn = rotation("x", rng.uniform(0.5, 1.2))
        hinge = np.array([0, length / 2, 0.8 * thick])
        lid = moved(box((width, length, 0.6 * thick), (0, length / 2, 0.3 * thick), 0.002), turn, hinge)
        glass = moved(box((0.8 * width, 0.7 * length, 0.002), (0, 0.52 * length, 0.6 * thick)), turn, hinge)
        parts = [
            Part("body", box((width, length, 0.8 * thick), (0, 0, 0.4 * thick), 0.002), body),
            face(-0.42, 0.36, 0.8 * thick, keys, "keys"),
            Part("lid", lid, body if rng.random() < 0.5 else finishes.plastic(rng)),
            Part("screen", glass, Plain(colors.any_color(rng), 0.0, gloss=0.7)),
        ]
        solids = [
            solid_box((width, length, 0.8 * thick), (0, 0, 0.4 * thick)),
            solid_box((width, length, 0.6 * thick), hinge + turn @ [0, length / 2, 0.3 * thick], turn),
        ]
    return assemble("cellular_telephone", parts, solids, upright=0.75)


def clock(rng: np.random.Generator) -> Shape:
    """A clock: round on feet, with two bells on top, or in a square or arched wooden case; a dial with hands."""
    radius = rng.uniform(0.055, 0.11)
    depth = radius * rng.uniform(0.4, 0.8)
    front = -depth / 2
    kind = rng.choice(4, p=(0.3, 0.3, 0.25, 0.15))
    body = (finishes.plastic, finishes.plastic, finishes.wooden, finishes.plastic)[kind](rng)
    accent = finishes.metallic(rng) if rng.random() < 0.6 else finishes.plastic(rng)
    lift = 0.12 * radius if kind < 2 else 0.0
    middle = lift + radius * (1.0 if kind < 2 else 1.15)
    face_radius = 0.86 * radius
    dial: Texture = Printed(
        prints.dial(rng),
        Plain(colors.light(rng)),
        "-y",
        (-face_radius, middle - face_radius),
        (face_radius, middle + face_radius),
        gloss=0.3,
    )
    parts = [Part("dial", cylinder(face_radius, 0.006, (0, front - 0.003, middle), "y", 36), dial)]
    solids: list[Solid] = []
    if kind < 2:
        parts.append(Part("case", cylinder(radius, depth, (0, 0, middle), "y", 36), body))
        parts.append(
            Part("bezel", ring(0.86 * radius, 1.03 * radius, 0.014, (0, front - 0.004, middle), "y", 36), accent)
        )
        solids.append(solid_cylinder(radius, depth + 0.012, (0, -0.004, middle), "y"))
        feet = [
            cylinder(
                0.06 * radius + 0.002,
                1.1 * (middle - 0.6 * radius),
                (s * 0.6 * radius, 0, 0.52 * (middle - 0.6 * radius)),
                sections=10,
            )
            for s in (-1, 1)
        ]
        parts.append(Part("feet", joined(feet), accent))
        solids.append(solid_box((1.4 * radius, 0.5 * depth, 0.3 * radius), (0, 0, 0.15 * radius)))
    else:
        width = 2.15 * radius
        if kind == 2:
            points = frustum((width, depth), (width, depth), middle)
            crown = arc((0, 0, middle), (width / 2, width / 2), 0, np.pi, "xz", 13)
            half = np.array([0, depth / 2, 0])
            points = np.concatenate([points, crown + half, crown - half])
            plinth = box((1.2 * width, 1.3 * depth, 0.14 * radius), (0, 0, 0.07 * radius), 0.003)
            parts.append(Part("plinth", plinth, body))
            solids.append(solid_box((1.2 * width, 1.3 * depth, 0.14 * radius), (0, 0, 0.07 * radius)))
        else:
            points = frustum((width, depth), (width, 0.7 * depth), 2.3 * radius, (0, 0.15 * depth))
            points[:, 1] = np.where(points[:, 1] < 0, front, points[:, 1])
        parts.append(Part("case", hull(points), body))
        solids.append(solid_hull(points))
    if kind == 1:
        for s in (-1, 1):
            bell = moved(
                lathe(
                    [
                        (0, 0),
                        (0.42 * radius, 0),
                        (0.36 * radius, 0.16 * radius),
                        (0.2 * radius, 0.28 * radius),
                        (0, 0.32 * radius),
                    ],
                    20,
                ),
                rotation("y", s * 0.5),
                (s * 0.5 * radius, 0, middle + 0.92 * radius),
            )
            parts.append(Part("bell", bell, accent))
            solids.append(solid_cylinder(0.38 * radius, 0.3 * radius, (s * 0.56 * radius, 0, middle + 1.05 * radius)))
        parts.append(
            Part(
                "carrier",
                tube(arc((0, 0, middle + 0.95 * radius), (0.3 * radius, 0.5 * radius), 0, np.pi), 0.004, 6),
                accent,
            )
        )
    ink = Plain(colors.dark(rng) if rng.random() < 0.8 else colors.vivid(rng), 0.0)
    for share in (0.5, 0.72):
        angle = rng.uniform(0, 2 * np.pi)
        hand = box((0.07 * radius, 0.003, share * face_radius), (0, 0, share * face_radius / 2 - 0.05 * radius))
        parts.append(Part("hand", moved(hand, rotation("y", angle), (0, front - 0.007, middle)), ink))
    return assemble("clock", parts, solids, upright=0.7)


def computer_keyboard(rng: np.random.Generator) -> Shape:
    """A keyboard: a long flat wedge with rows of keys, a space bar, often a number block."""
    width = rng.uniform(0.28, 0.42)
    depth, thick = width * rng.uniform(0.3, 0.4), width * rng.uniform(0.03, 0.055)
    slope = rng.uniform(0.0, 0.6) * thick
    ground = (
        colors.any_color(rng) if rng.random() < 0.3 else (colors.dark(rng) if rng.random() < 0.6 else colors.light(rng))
    )
    key_color = (
        colors.contrasting(rng, ground, 0.2) if rng.random() < 0.7 else ground * np.float32(1.3) + np.float32(0.05)
    )
    plate = frustum((width, depth), (0.985 * width, 0.95 * depth), thick)
    plate[:, 2] += np.where((plate[:, 1] > 0) & (plate[:, 2] > 0), slope, 0)
    parts = [Part("plate", hull(plate), Plain(ground, 0.03, gloss=0.2))]
    columns, rows = int(rng.integers(14, 19)), 5
    area = (0.94 * width, 0.8 * depth)
    pitch = (area[0] / columns, area[1] / rows)
    gap = rng.uniform(0.1, 0.2)
    rise = rng.uniform(0.004, 0.008)
    number_block = rng.random() < 0.7
    keys: list[trimesh.Trimesh] = []
    special: list[trimesh.Trimesh] = []
    for row in range(rows):
        y = -area[1] / 2 + (row + 0.5) * pitch[1]
        z = thick + slope * (y + depth / 2) / depth
        column = 0
        while column < columns:
            if number_block and column == columns - 4:
                column += 1
                continue
            span = 1
            if row == 0 and column == 3:
                span = 6
            elif column == 0 and row > 0:
                span = 1 + row % 2
            x = -area[0] / 2 + (column + span / 2) * pitch[0]
            cap = block(
                frustum(
                    ((span - gap) * pitch[0], (1 - gap) * pitch[1]),
                    ((span - 2.2 * gap) * pitch[0], (1 - 2.2 * gap) * pitch[1]),
                    rise,
                    at=(x, y, z - 0.001),
                )
            )
            (special if span > 1 and rng.random() < 0.6 else keys).append(cap)
            column += span
    parts.append(Part("keys", joined(keys), Plain(np.clip(key_color, 0, 1), 0.05, 0.01, gloss=0.15)))
    if special:
        parts.append(Part("special keys", joined(special), Plain(colors.any_color(rng), gloss=0.15)))
    body = plate.copy()
    body[:, 2] += np.where(body[:, 2] > 0, rise * 0.8, 0)
    return assemble("computer_keyboard", parts, [solid_hull(body)], upright=0.8)


def display(rng: np.random.Generator) -> Shape:
    """A monitor: a thin upright panel with a screen, a neck and a foot."""
    width = rng.uniform(0.20, 0.32)
    height, thick = width * rng.uniform(0.55, 0.75), rng.uniform(0.012, 0.025)
    lift = rng.uniform(0.3, 0.5) * height
    frame = finishes.plastic(rng, colors.dark(rng)) if rng.random() < 0.6 else finishes.casing(rng)
    tilt = rotation("x", -rng.uniform(0.0, 0.2))
    hinge = np.array([0, 0, lift])
    border = rng.uniform(0.03, 0.08)
    view = Printed(
        prints.screen(rng),
        Plain(colors.dark(rng)),
        "-y",
        (-width * (0.5 - border), lift),
        (width * (0.5 - border), lift + height * 0.96),
        gloss=0.6,
    )
    panel = box((width, thick, height), (0, 0, height / 2), 0.003)
    screen = box((width * (1 - 2 * border), 0.003, height * (1 - 2.4 * border)), (0, -thick / 2, height / 2))
    parts = [
        Part("panel", moved(panel, tilt, hinge), frame),
        Part("screen", moved(screen, tilt, hinge), view),
    ]
    stand = frame if rng.random() < 0.6 else finishes.metallic(rng)
    top = lift + 0.4 * height
    neck_y = thick / 2 + 0.012 + 0.2 * height * 0.1
    parts.append(Part("neck", box((0.12 * width, 0.02, top), (0, neck_y, top / 2), 0.004), stand))
    base_y = neck_y - 0.12 * width
    if rng.random() < 0.5:
        parts.append(
            Part(
                "foot",
                lathe([(0, 0), (0.27 * width, 0), (0.26 * width, 0.006), (0.1 * width, 0.014), (0, 0.016)], 28),
                stand,
            )
        )
        parts[-1].mesh.apply_translation([0, base_y + 0.06 * width, 0])
        solids = [solid_cylinder(0.27 * width, 0.01, (0, base_y + 0.06 * width, 0.005))]
    else:
        parts.append(Part("foot", box((0.6 * width, 0.36 * width, 0.012), (0, base_y, 0.006), 0.004), stand))
        solids = [solid_box((0.6 * width, 0.36 * width, 0.012), (0, base_y, 0.006))]
    solids.append(solid_box((width, thick, height), hinge + tilt @ [0, 0, height / 2], tilt))
    solids.append(solid_box((0.12 * width, 0.02, top), (0, neck_y, top / 2)))
    return assemble("display", parts, solids, upright=0.7)


def laptop(rng: np.random.Generator) -> Shape:
    """A laptop: a flat base with keys and a touch pad, and a lid with a screen, open at a hinge."""
    width = rng.uniform(0.22, 0.34)
    depth, thick = width * rng.uniform(0.64, 0.75), rng.uniform(0.012, 0.02)
    casing = finishes.metallic(rng) if rng.random() < 0.5 else finishes.plastic(rng)
    ground = colors.dark(rng)
    keys = Printed(
        prints.keypad(rng, 14, 5, ground, 18),
        Plain(ground),
        "+z",
        (-0.43 * width, -0.02 * depth),
        (0.43 * width, 0.4 * depth),
        gloss=0.1,
    )
    parts = [
        Part("base", box((width, depth, thick), (0, 0, thick / 2), 0.003), casing),
        Part("keys", box((0.86 * width, 0.42 * depth, 0.002), (0, 0.19 * depth, thick + 0.0006)), keys),
        Part("pad", box((0.26 * width, 0.2 * depth, 0.001), (0, -0.26 * depth, thick + 0.0004)), finishes.plastic(rng)),
    ]
    # Rotate the lid by the opening angle, starting from closed (0).
    opening = rng.uniform(1.25, 2.2)
    turn = rotation("x", -opening)
    hinge = np.array([0, depth / 2 - 0.004, thick + 0.002])
    lid_thick = 0.6 * thick
    lid = box((width, depth, lid_thick), (0, -depth / 2, lid_thick / 2), 0.003)
    view = prints.screen(rng)
    border = rng.uniform(0.03, 0.07)
    glass = box(((1 - 2 * border) * width, (1 - 2.6 * border) * depth, 0.002), (0, -depth / 2, 0.0))
    upright = opening > np.pi / 4
    # Map the screen image to the box face that the tilted lid faces most.
    tall = depth * abs(np.sin(opening))
    shown: Texture = Plain(colors.dark(rng), gloss=0.7)
    if upright:
        shown = Printed(view, shown, "-y", (-0.5 * width, hinge[2]), (0.5 * width, hinge[2] + tall), gloss=0.6)
    parts.append(Part("lid", moved(lid, turn, hinge), casing if rng.random() < 0.6 else finishes.plastic(rng)))
    parts.append(Part("screen", moved(glass, turn, hinge), shown))
    solids = [
        solid_box((width, depth, thick), (0, 0, thick / 2)),
        solid_box((width, depth, lid_thick), hinge + turn @ [0, -depth / 2, lid_thick / 2], turn),
    ]
    return assemble("laptop", parts, solids, upright=0.8)


def loudspeaker(rng: np.random.Generator) -> Shape:
    """A loudspeaker: a tall box with one to three round drivers set into its front, or a cloth grille."""
    width = rng.uniform(0.08, 0.15)
    depth, height = width * rng.uniform(0.8, 1.2), width * rng.uniform(1.4, 2.4)
    front = -depth / 2
    case = finishes.wooden(rng, 2) if rng.random() < 0.5 else finishes.casing(rng)
    parts = [Part("case", box((width, depth, height), (0, 0, height / 2), 0.003), case)]
    board_color = colors.dark(rng) if rng.random() < 0.7 else colors.any_color(rng)
    board: Texture = Plain(board_color, 0.1, 0.004, gloss=0.05)
    if rng.random() < 0.3:
        board = Printed(
            prints.grille(rng, board_color),
            board,
            "-y",
            (-0.45 * width, 0.03 * height),
            (0.45 * width, 0.97 * height),
            gloss=0.05,
        )
    parts.append(
        Part("baffle", box((0.92 * width, 0.008, 0.95 * height), (0, front - 0.002, height / 2), 0.002), board)
    )
    count = int(rng.integers(1, 4))
    sizes = width * np.sort(rng.uniform(0.2, 0.42, count))[::-1]
    sizes *= min(1.0, 0.46 * 0.92 * height / float(sizes.sum()))
    room = 0.92 * height - 2 * float(sizes.sum())
    z = 0.04 * height
    surround, cone = finishes.plastic(rng), finishes.plastic(rng)
    for size in sizes:
        z += room / (count + 1) + size
        dish = [(0, 0), (0.84 * size, 0), (0.84 * size, 0.012), (0.3 * size, 0.004), (0.22 * size, 0.010), (0, 0.012)]
        parts.append(Part("driver", placed(lathe(dish, 28), (0, front - 0.004, z), "-y"), cone))
        parts.append(Part("surround", ring(0.8 * size, size, 0.016, (0, front - 0.009, z), "y", 28), surround))
        z += size
    return assemble(
        "loudspeaker", parts, [solid_box((width, depth + 0.012, height), (0, -0.006, height / 2))], upright=0.6
    )


def telephone(rng: np.random.Generator) -> Shape:
    """A desk telephone: a sloping base with keys or a dial, a handset lying across or beside, a curly cord."""
    width = rng.uniform(0.15, 0.22)
    depth, height = width * rng.uniform(0.85, 1.15), width * rng.uniform(0.3, 0.45)
    body = finishes.plastic(rng)
    low = height * rng.uniform(0.3, 0.6)
    base = frustum((width, depth), (0.9 * width, 0.85 * depth), height)
    base[:, 2] = np.where(base[:, 2] > 0, np.where(base[:, 1] > 0, height, low), 0)
    slope = np.arctan2(height - low, 0.85 * depth)
    middle = np.array([0.0, 0.0, (height + low) / 2])
    parts = [Part("base", hull(base), body)]
    solids = [solid_hull(base)]
    tilt = rotation("x", slope)
    offset = 0.16 * width
    if rng.random() < 0.7:
        field = Printed(
            prints.keypad(rng, 3, 4, colors.dark(rng)),
            Plain(colors.dark(rng)),
            "+z",
            (offset - 0.24 * width, -0.3 * depth),
            (offset + 0.24 * width, 0.26 * depth),
        )
        parts.append(
            Part("keys", moved(box((0.5 * width, 0.58 * depth, 0.005), (offset, 0, 0.001)), tilt, middle), field)
        )
    else:
        disc = joined(
            [
                ring(0.12 * width, 0.25 * width, 0.008, (offset, 0, 0.004)),
                cylinder(0.1 * width, 0.012, (offset, 0, 0.004)),
            ]
        )
        parts.append(Part("dial", moved(disc, tilt, middle), finishes.plastic(rng)))
    grip = body if rng.random() < 0.5 else finishes.plastic(rng)
    # The handset: a bowed bar between an ear piece and a mouth piece.
    long, thick = 0.95 * depth, 0.11 * width
    bow = arc((0, 0, 0.02), (0.42 * long, 0.25 * height + 0.01), 0.15, np.pi - 0.15, "yz", 12)
    handset = [tube(bow, 0.5 * thick, 8, flatten=1.3)]
    for s in (-1, 1):
        cup = [(0, -0.012), (0.9 * thick, -0.012), (1.05 * thick, 0.008), (0.6 * thick, 0.024), (0, 0.026)]
        handset.append(moved(lathe(cup, 20), None, (0, s * 0.4 * long, 0.012)))
    place = middle + tilt @ [-0.3 * width, 0, 0.016]
    parts.append(Part("handset", moved(joined(handset), tilt, place), grip))
    solids.append(solid_box((2.0 * thick, long, 0.04), place + tilt @ [0, 0, 0.012], tilt))
    turns = np.linspace(0, 2 * np.pi * 9, 120)
    run = np.linspace(-0.45, 0.3, 120) * depth
    cord = np.stack([-0.5 * width - 0.012 + 0.006 * np.cos(turns), run, 0.008 + 0.006 * np.sin(turns)], axis=1)
    parts.append(Part("cord", tube(cord, 0.002, 5), grip))
    solids.append(solid_box((0.016, 0.75 * depth, 0.016), (-0.5 * width - 0.012, -0.075 * depth, 0.008)))
    return assemble("telephone", parts, solids, upright=0.8)
