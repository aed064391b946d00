"""Draw random but realistic colours of objects and materials."""

from __future__ import annotations

import colorsys

import numpy as np
import numpy.typing as npt

Color = npt.NDArray[np.float32]

_WOODS = ((0.80, 0.66, 0.48), (0.68, 0.50, 0.33), (0.52, 0.34, 0.20), (0.38, 0.25, 0.16), (0.87, 0.77, 0.62))
_METALS = ((0.72, 0.73, 0.75), (0.58, 0.59, 0.61), (0.80, 0.79, 0.76), (0.62, 0.53, 0.40))


def rgb(red: float, green: float, blue: float) -> Color:
    """Return a colour from its components, 0 to 1."""
    return np.array([red, green, blue], dtype=np.float32)


def _near(rng: np.random.Generator, base: tuple[float, float, float], spread: float) -> Color:
    return np.clip(np.asarray(base) + rng.normal(0, spread, 3), 0.03, 0.97).astype(np.float32)


def vivid(rng: np.random.Generator) -> Color:
    """Draw a saturated colour: packaging, plastic, paint."""
    rgb = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.4, 0.82), rng.uniform(0.4, 0.85))
    return np.asarray(rgb, dtype=np.float32)


def muted(rng: np.random.Generator) -> Color:
    """Draw a colour of low saturation: cloth, ceramics, walls."""
    rgb = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.1, 0.45), rng.uniform(0.35, 0.85))
    return np.asarray(rgb, dtype=np.float32)


def light(rng: np.random.Generator) -> Color:
    """Draw a near-white colour."""
    return _near(rng, (0.87, 0.86, 0.84), 0.03)


def dark(rng: np.random.Generator) -> Color:
    """Draw a near-black colour."""
    gray = rng.uniform(0.08, 0.22)
    return _near(rng, (gray, gray, gray), 0.015)


def gray(rng: np.random.Generator) -> Color:
    """Draw a neutral colour between black and white."""
    value = rng.uniform(0.3, 0.7)
    return _near(rng, (value, value, value), 0.015)


def metal(rng: np.random.Generator) -> Color:
    """Draw the colour of a metal."""
    return _near(rng, _METALS[rng.integers(len(_METALS))], 0.02)


def wood(rng: np.random.Generator) -> Color:
    """Draw the colour of a wood."""
    return _near(rng, _WOODS[rng.integers(len(_WOODS))], 0.03)


def any_color(rng: np.random.Generator) -> Color:
    """Draw the colour of an object: often vivid, sometimes light, dark, grey or muted."""
    kinds = (vivid, muted, light, dark, gray)
    return kinds[rng.choice(len(kinds), p=(0.42, 0.22, 0.16, 0.12, 0.08))](rng)


def contrasting(rng: np.random.Generator, other: Color, least: float = 0.35) -> Color:
    """Draw a colour that differs from another one by at least `least` in one component."""
    for _ in range(20):
        color = any_color(rng)
        if float(np.abs(color - other).max()) >= least:
            return color
    return light(rng) if float(other.mean()) < 0.5 else dark(rng)
