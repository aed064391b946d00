"""Cameras as recording programs write them: Open3D's and librealsense's JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sgbd.frame import FrameError, Intrinsics
from sgbd.sources.errors import FrameReadError

CAMERA_FILES = (
    "camera_intrinsic.json",
    "camera_intrinsics.json",
    "intrinsic.json",
    "intrinsics.json",
)
"""File names that a camera is looked for under, in this order."""


@dataclass(frozen=True)
class CameraFile:
    """What a camera's file says.

    Attributes:
        path: The file.
        form: "Open3D" or "librealsense".
        intrinsics: The camera.
        size: Width and height of its images in pixels, if the file has them.
        depth_scale: Metres of one unit of its depth images, if the file has it.
        distorted: Whether the file has distortion coefficients that are not zero, which a pinhole camera leaves out.
    """

    path: Path
    form: str
    intrinsics: Intrinsics
    size: tuple[int, int] | None = None
    depth_scale: float | None = None
    distorted: bool = False


def find_camera_file(folder: str | Path) -> Path | None:
    """Return the file of `CAMERA_FILES` that lies in a folder, or None."""
    return next((path for name in CAMERA_FILES if (path := Path(folder) / name).is_file()), None)


def read_camera_file(path: str | Path) -> CameraFile:
    """Read a camera.

    Open3D writes `intrinsic_matrix`, the 3x3 matrix column by column as 9 numbers, with `width` and `height`;
    librealsense's programs write `fx`, `fy`, `ppx`, `ppy` (or `cx`, `cy`), `coeffs`, alone or below `color`. A
    `depth_scale` of 1 and more is Open3D's units a metre; below 1 it is librealsense's metres a unit.

    Args:
        path: JSON file.

    Returns:
        What it says.

    Raises:
        FrameReadError: If the file is missing, no JSON, or holds no camera.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FrameReadError(path, "the file does not exist") from None
    except (OSError, ValueError) as error:
        raise FrameReadError(path, f"the camera's file cannot be read as JSON: {error}") from error
    outer = content if isinstance(content, Mapping) else {}
    inner = next((outer[key] for key in ("color", "rgb", "intrinsics") if isinstance(outer.get(key), Mapping)), outer)
    try:
        form, intrinsics = _intrinsics(inner)
        size = (int(inner["width"]), int(inner["height"])) if {"width", "height"} <= set(inner) else None
        scale = inner.get("depth_scale", outer.get("depth_scale"))
        depth_scale = None if scale is None else _meters_a_unit(float(scale))
        distorted = bool(np.any(np.asarray(inner.get("coeffs", []), np.float64)))
    except KeyError as error:
        raise FrameReadError(
            path,
            f"{error.args[0]} is missing. Expected Open3D's intrinsic_matrix (9 numbers, column by column), or "
            "librealsense's fx, fy, ppx and ppy. Or state the camera: intrinsics='{fx: …, fy: …, cx: …, cy: …}'.",
        ) from None
    except (TypeError, ValueError) as error:
        if isinstance(error, FrameReadError):
            raise
        raise FrameReadError(path, f"the camera cannot be read from it: {error}") from error
    return CameraFile(path, form, intrinsics, size, depth_scale, distorted)


def _intrinsics(values: Mapping[str, Any]) -> tuple[str, Intrinsics]:
    if "intrinsic_matrix" in values:
        numbers = np.asarray(values["intrinsic_matrix"], np.float64)
        if numbers.size != 9:
            raise FrameError(f"intrinsic_matrix needs 9 numbers, column by column; got {values['intrinsic_matrix']}")
        # Eigen's order, columns first. Rows of rows, as people write them, are the matrix itself.
        matrix = numbers if numbers.shape == (3, 3) else numbers.reshape(3, 3, order="F")
        if not np.array_equal(matrix[2], [0, 0, 1]):
            raise FrameError(
                f"the last row of intrinsic_matrix must be 0 0 1 (9 numbers, in order of columns); got {matrix[2]}"
            )
        return "Open3D", Intrinsics(*(float(matrix[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2))))
    center = ("ppx", "ppy") if "ppx" in values else ("cx", "cy")
    fx, fy, cx, cy = (float(values[key]) for key in ("fx", "fy", *center))
    return "librealsense", Intrinsics(fx, fy, cx, cy)


def _meters_a_unit(scale: float) -> float:
    if not 0 < scale < float("inf"):
        raise FrameError(f"depth_scale must be positive; got {scale}")
    return 1 / scale if scale >= 1 else scale
