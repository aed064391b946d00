"""Draw images for `textures.Printed`: labels, screens, clock faces, keys, grilles and patterns."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from sgbd.sources.synthetic.colors import Color, any_color, contrasting, dark, light, vivid

Picture = npt.NDArray[np.float32]

_SYLLABLES = (
    "ba",
    "ko",
    "ri",
    "ta",
    "lo",
    "mi",
    "ne",
    "su",
    "va",
    "zo",
    "fe",
    "pa",
    "ga",
    "du",
    "li",
    "or",
    "en",
    "ix",
)
_LINE_HEIGHT = 7


def label(rng: np.random.Generator, width: int = 256, height: int = 128, repeats: int = 1) -> Picture:
    """Draw a printed label: coloured areas, a name, small print and, optionally, a badge and a bar code.

    Args:
        rng: Random generator.
        width: Image width, pixels.
        height: Image height, pixels.
        repeats: Number of copies of the motif side by side.
    """
    ground = any_color(rng)
    image = Image.new("RGB", (width, height), _rgb(ground))
    draw = ImageDraw.Draw(image)
    for _ in range(rng.integers(1, 4)):
        _field(rng, draw, width, height, ground)
    ink = contrasting(rng, ground, 0.5)
    panel = width / repeats
    size = int(np.clip(rng.uniform(0.16, 0.32) * height, 9, panel / 3))
    top = rng.uniform(0.08, 0.45) * height
    name, lines = word(rng), int(rng.integers(0, 5))
    badge = vivid(rng) if rng.random() < 0.5 else None
    bar_code = rng.random() < 0.5
    for k in range(repeats):
        left = k * panel + 0.08 * panel
        if badge is not None:
            radius = 0.17 * min(panel, height)
            cx, cy = left + 0.72 * panel, 0.75 * height
            draw.ellipse((cx - radius, cy - radius, cx + radius, cy + radius), fill=_rgb(badge), outline=_rgb(ink))
        draw.text((left, top), name, font=_font(size), fill=_rgb(ink))
        _small_print(rng, draw, left, top + 1.4 * size, 0.5 * panel, lines, ink)
        if bar_code:
            _bar_code(rng, draw, left, 0.86 * height, 0.3 * panel, 0.1 * height)
    return _floats(image)


def screen(rng: np.random.Generator, width: int = 192, height: int = 120) -> Picture:
    """Draw the content of a screen: a background with windows, or a dark screen."""
    if rng.random() < 0.35:
        return np.tile(dark(rng) * np.float32(0.6), (height, width, 1)).astype(np.float32)
    top, bottom = any_color(rng), any_color(rng)
    fade = np.linspace(0, 1, height, dtype=np.float32)[:, None, None]
    ground = np.broadcast_to(top * (1 - fade) + bottom * fade, (height, width, 3))
    image = Image.fromarray((ground * 255).astype(np.uint8))
    draw = ImageDraw.Draw(image)
    for _ in range(rng.integers(0, 4)):
        x, y = rng.uniform(0, 0.6) * width, rng.uniform(0, 0.6) * height
        w, h = rng.uniform(0.25, 0.6) * width, rng.uniform(0.25, 0.6) * height
        paper = light(rng) if rng.random() < 0.7 else dark(rng)
        draw.rectangle((x, y, x + w, y + h), fill=_rgb(paper))
        draw.rectangle((x, y, x + w, y + 0.07 * height), fill=_rgb(any_color(rng)))
        _small_print(rng, draw, x + 4, y + 0.12 * height, w - 8, int(h / (1.8 * _LINE_HEIGHT)), contrasting(rng, paper))
    draw.rectangle((0, 0.94 * height, width, height), fill=_rgb(dark(rng)))
    return _floats(image)


def dial(rng: np.random.Generator, size: int = 160) -> Picture:
    """Draw a clock face: hour marks or numbers on a plain background."""
    ground = light(rng) if rng.random() < 0.65 else any_color(rng)
    ink = contrasting(rng, ground, 0.5)
    image = Image.new("RGB", (size, size), _rgb(ground))
    draw = ImageDraw.Draw(image)
    middle, numbers = size / 2, rng.random() < 0.5
    for hour in range(12):
        angle = 2 * np.pi * (hour + 1) / 12 - np.pi / 2
        x, y = np.cos(angle), np.sin(angle)
        if numbers:
            draw.text(
                (middle + 0.38 * size * x, middle + 0.38 * size * y),
                str(hour + 1),
                font=_font(max(9, size // 10)),
                fill=_rgb(ink),
                anchor="mm",
            )
        else:
            long = 0.32 if hour % 3 == 2 else 0.38
            ends = [(middle + r * size * x, middle + r * size * y) for r in (long, 0.45)]
            draw.line(ends, fill=_rgb(ink), width=4 if hour % 3 == 2 else 2)
    return _floats(image)


def keypad(rng: np.random.Generator, columns: int, rows: int, ground: Color, cell: int = 20) -> Picture:
    """Draw a grid of keys."""
    key = contrasting(rng, ground, 0.3)
    ink = contrasting(rng, key, 0.4)
    image = Image.new("RGB", (columns * cell, rows * cell), _rgb(ground))
    draw = ImageDraw.Draw(image)
    for row in range(rows):
        for column in range(columns):
            x, y = column * cell, row * cell
            draw.rounded_rectangle((x + 2, y + 2, x + cell - 3, y + cell - 3), 3, fill=_rgb(key))
            draw.text(
                (x + cell / 2, y + cell / 2),
                str((row * columns + column) % 10),
                font=_font(9),
                fill=_rgb(ink),
                anchor="mm",
            )
    return _floats(image)


def grille(rng: np.random.Generator, ground: Color, columns: int = 24, rows: int = 24, cell: int = 6) -> Picture:
    """Draw a plate with a grid of round holes."""
    image = Image.new("RGB", (columns * cell, rows * cell), _rgb(ground))
    draw = ImageDraw.Draw(image)
    hole = _rgb(ground * np.float32(rng.uniform(0.25, 0.5)))
    for row in range(rows):
        for column in range(columns):
            x, y = column * cell, row * cell
            draw.ellipse((x + 1, y + 1, x + cell - 2, y + cell - 2), fill=hole)
    return _floats(image)


def pattern(rng: np.random.Generator, width: int = 192, height: int = 192) -> Picture:
    """Draw a regular pattern of discs or flowers on a plain background: cloth, china, wrapping paper."""
    ground = any_color(rng)
    inks = [contrasting(rng, ground) for _ in range(rng.integers(1, 4))]
    image = Image.new("RGB", (width, height), _rgb(ground))
    draw = ImageDraw.Draw(image)
    step = int(rng.integers(16, 48))
    petals, reach = int(rng.integers(0, 7)), rng.uniform(0.2, 0.42) * step
    for row, y in enumerate(range(0, height + step, step)):
        for column, x in enumerate(range(0, width + step, step)):
            ink = _rgb(inks[(row + column) % len(inks)])
            cx, cy = x + (row % 2) * step / 2, float(y)
            if petals >= 3:
                for k in range(petals):
                    angle = 2 * np.pi * k / petals
                    px, py = cx + 0.6 * reach * np.cos(angle), cy + 0.6 * reach * np.sin(angle)
                    r = 0.45 * reach
                    draw.ellipse((px - r, py - r, px + r, py + r), fill=ink)
            else:
                draw.ellipse((cx - reach, cy - reach, cx + reach, cy + reach), fill=ink)
    return _floats(image)


def word(rng: np.random.Generator) -> str:
    """Draw a made-up name."""
    return "".join(rng.choice(_SYLLABLES, size=rng.integers(2, 4))).capitalize()


def _field(rng: np.random.Generator, draw: ImageDraw.ImageDraw, width: int, height: int, ground: Color) -> None:
    color = _rgb(contrasting(rng, ground, 0.25))
    x, y = rng.uniform(-0.1, 0.8) * width, rng.uniform(-0.1, 0.8) * height
    w, h = rng.uniform(0.2, 0.7) * width, rng.uniform(0.2, 0.6) * height
    kind = rng.integers(4)
    if kind == 0:
        draw.rectangle((0, y, width, y + 0.5 * h), fill=color)
    elif kind == 1:
        draw.ellipse((x, y, x + w, y + h), fill=color)
    elif kind == 2:
        draw.polygon([(x, y + h), (x + w / 2, y), (x + w, y + h)], fill=color)
    else:
        draw.rectangle((x, y, x + w, y + h), fill=color)


def _small_print(
    rng: np.random.Generator, draw: ImageDraw.ImageDraw, x: float, y: float, width: float, lines: int, ink: Color
) -> None:
    for k in range(lines):
        length = width * rng.uniform(0.5, 1.0)
        top = y + k * 1.6 * _LINE_HEIGHT
        draw.rectangle((x, top, x + length, top + _LINE_HEIGHT * 0.4), fill=_rgb(ink))


def _bar_code(
    rng: np.random.Generator, draw: ImageDraw.ImageDraw, x: float, y: float, width: float, height: float
) -> None:
    draw.rectangle((x - 3, y - 2, x + width + 3, y + height + 2), fill=(245, 245, 245))
    at = round(x)
    while at < x + width:
        bar = rng.integers(1, 4)
        draw.rectangle((at, y, at + int(bar) - 1, y + height), fill=(20, 20, 20))
        at += int(bar + rng.integers(1, 4))


@cache
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def _rgb(color: Color) -> tuple[int, int, int]:
    r, g, b = (np.clip(color, 0, 1) * 255).astype(int)
    return int(r), int(g), int(b)


def _floats(image: Image.Image) -> Picture:
    return np.asarray(image, dtype=np.float32) / np.float32(255)
