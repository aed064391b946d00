"""Convert camera intrinsics from and to configuration values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from sgbd.frame import FrameError, Intrinsics

_FIELDS = ("fx", "fy", "cx", "cy")


def intrinsics_from(value: Intrinsics | Mapping[str, Any] | None) -> Intrinsics | None:
    """Convert a mapping, such as a YAML node, to intrinsics.

    Args:
        value: Intrinsics, a mapping with exactly the keys fx, fy, cx and cy in pixels, or None for an unknown camera.

    Raises:
        FrameError: If a key is missing or unknown, or a value is not a valid number.
    """
    if value is None or isinstance(value, Intrinsics):
        return value
    if not isinstance(value, Mapping) or set(value) != set(_FIELDS):
        raise FrameError(f"intrinsics need exactly the values {', '.join(_FIELDS)}, in pixels; got {value}")
    try:
        fx, fy, cx, cy = (float(value[key]) for key in _FIELDS)
    except (TypeError, ValueError):
        raise FrameError(f"intrinsics must be numbers, in pixels; got {value}") from None
    return Intrinsics(fx, fy, cx, cy)


def intrinsics_option(camera: Intrinsics | None) -> list[float] | None:
    """Return fx, fy, cx and cy as a JSON value for `sgbd.sources.FrameSource.options`; None for an unknown camera."""
    return None if camera is None else [camera.fx, camera.fy, camera.cx, camera.cy]


def intrinsics_from_view(width: int, height: int, vertical_degrees: float) -> Intrinsics:
    """Return the intrinsics of a rendered view with square pixels and the principal point at the image centre.

    Args:
        width: Image width, pixels.
        height: Image height, pixels.
        vertical_degrees: Vertical field of view, degrees.
    """
    focal = height / 2 / math.tan(math.radians(vertical_degrees) / 2)
    return Intrinsics(focal, focal, (width - 1) / 2, (height - 1) / 2)
