"""Read camera files (JSON) written by Open3D and librealsense."""

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
"""Possible names of the camera file, in search order."""


@dataclass(frozen=True)
class CameraFile:
    """Content of a camera file.

    Attributes:
        path: The file.
        form: Format of the file, "Open3D" or "librealsense".
        intrinsics: The camera.
        size: Image width and height in pixels, if given.
        depth_scale: Metres per unit of the depth images, if given.
        distorted: Whether the file has non-zero distortion coefficients, which the pinhole camera ignores.
    """

    path: Path
    form: str
    intrinsics: Intrinsics
    size: tuple[int, int] | None = None
    depth_scale: float | None = None
    distorted: bool = False


def find_camera_file(folder: str | Path) -> Path | None:
    """Return the first of `CAMERA_FILES` that exists in a folder, or None."""
    return next((path for name in CAMERA_FILES if (path := Path(folder) / name).is_file()), None)


def read_camera_file(path: str | Path) -> CameraFile:
    """Read a camera file.

    Open3D writes `intrinsic_matrix` (the 3x3 matrix as 9 numbers, column by column), `width` and `height`. librealsense
    tools write `fx`, `fy`, `ppx`, `ppy` (or `cx`, `cy`) and `coeffs`, at the top level or below `color`. A
    `depth_scale` of 1 or more is in units per metre (Open3D), a smaller one in metres per unit (librealsense).

    Args:
        path: JSON file.

    Returns:
        The content of the file.

    Raises:
        FrameReadError: If the file is missing, is not JSON or contains no camera.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))  # editors on Windows write a byte order mark
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
        # A flat list is in Eigen's column-major order; nested lists, as written by hand, are the rows.
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
