"""The only input type of the package: an RGB-D frame, validated once on construction."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

BACKGROUND = 0
"""Ground-truth id of pixels that belong to nothing of interest."""
SUPPORT = 1
"""Ground-truth id of the supporting surface (table, floor). Larger ids are objects."""
IGNORE = -1
"""Ground-truth id of pixels that are ignored in training and evaluation."""

MILLIMETERS = 0.001

NEAREST = 0.01
"""Metres. If most of a frame is nearer, its depth is in another unit: no depth camera measures that near."""
FARTHEST = 100.0
"""Metres. If most of a frame is farther away, its depth is in another unit."""
USUAL = (0.2, 10.0)
"""Metres. If most of a frame is outside this range, its depth is probably in another unit. If less is beyond its end,
that part counts as missing."""


log = logging.getLogger(__name__)

_told_of_unit: list[str] = []


class FrameError(ValueError):
    """Raised if a frame is invalid; the message says what was given, what is expected and what to do."""


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion.

    Attributes:
        fx: Focal length along x, pixels.
        fy: Focal length along y, pixels.
        cx: Principal point along x, pixels from the centre of the left-most column.
        cy: Principal point along y, pixels from the centre of the top row.
    """

    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        """Validate the camera and convert all values to floats.

        Numba compiles a function again for every new argument type, which takes seconds. Integers and NumPy scalars
        would be such types.

        Raises:
            FrameError: If a focal length is not positive or a value is not a finite number.
        """
        for name in ("fx", "fy", "cx", "cy"):
            try:
                object.__setattr__(self, name, float(getattr(self, name)))
            except (TypeError, ValueError):
                raise FrameError(f"intrinsics must be numbers, in pixels; got {self}") from None
        if not np.isfinite([self.fx, self.fy, self.cx, self.cy]).all() or self.fx <= 0 or self.fy <= 0:
            raise FrameError(f"intrinsics must be finite, in pixels, with fx > 0 and fy > 0; got {self}")

    @classmethod
    def default(cls, width: int, height: int) -> Intrinsics:
        """Return a typical RGB-D camera (59° horizontal field of view) for frames without calibration."""
        focal = 0.89 * width
        return cls(focal, focal, (width - 1) / 2, (height - 1) / 2)


@dataclass(frozen=True, eq=False)
class Frame:
    """One RGB-D image, with ground truth if available.

    Attributes:
        rgb: uint8 [H, W, 3], 0 to 255.
        depth: float32 [H, W], metres along the optical axis; 0 = missing. On construction, integers are taken as
            millimetres and floats as metres. NaN, infinite and negative values become 0, and so does what is beyond
            10 m in a frame that is mostly nearer.
        intrinsics: The camera; None if unknown.
        instances: int32 [H, W]: -1 ignore, 0 background, 1 supporting surface, 2 and more objects.
        categories: Category name of each instance id.
        name: Name of the frame in reports and file names.

    Raises:
        FrameError: On construction, if the arrays are not a valid frame.
    """

    rgb: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    intrinsics: Intrinsics | None = None
    instances: npt.NDArray[np.int32] | None = None
    categories: Mapping[int, str] = field(default_factory=dict)
    name: str = ""

    def __post_init__(self) -> None:
        """Validate the arrays and convert them to the documented dtypes."""
        label = f"frame {self.name!r}" if self.name else "frame"
        if self.intrinsics is not None and not isinstance(self.intrinsics, Intrinsics):
            raise FrameError(
                f"{label}: intrinsics must be sgbd.Intrinsics(fx, fy, cx, cy), in pixels, or None; got "
                f"{type(self.intrinsics).__name__}. Of a camera matrix K take Intrinsics(K[0, 0], K[1, 1], K[0, 2], "
                "K[1, 2])."
            )
        object.__setattr__(self, "rgb", _checked_rgb(self.rgb, label))
        object.__setattr__(self, "depth", _checked_depth(self.depth, self.rgb.shape[:2], label))
        if self.instances is not None:
            object.__setattr__(self, "instances", _checked_instances(self.instances, self.rgb.shape[:2], label))
        unknown = [key for key in self.categories if not isinstance(key, (int, np.integer))]
        if unknown:
            raise FrameError(f"{label}: categories must map integer instance ids to names; got the keys {unknown[:5]}")

    def __repr__(self) -> str:
        truth = "without truth" if self.instances is None else "with truth"
        return (
            f"Frame({self.name!r}, {self.width}x{self.height} pixels, {self.intrinsics or 'unknown camera'}, {truth})"
        )

    @property
    def height(self) -> int:
        """Rows of the frame, pixels."""
        return int(self.rgb.shape[0])

    @property
    def width(self) -> int:
        """Columns of the frame, pixels."""
        return int(self.rgb.shape[1])

    @property
    def camera(self) -> Intrinsics:
        """The intrinsics, or `Intrinsics.default` if they are unknown."""
        return self.intrinsics or Intrinsics.default(self.width, self.height)


def _array(value: npt.ArrayLike, what: str, label: str) -> npt.NDArray[Any]:
    array = np.asarray(value)
    if array.ndim == 0:
        raise FrameError(
            f"{label}: {what} must be an array of the pixels; got {type(value).__name__}. Read image files first, for "
            f"instance with {what} = imageio.v3.imread(path)."
        )
    return array


def _checked_rgb(rgb: npt.ArrayLike, label: str) -> npt.NDArray[np.uint8]:
    array = _array(rgb, "rgb", label)
    if array.ndim != 3 or array.shape[2] != 3:
        raise FrameError(
            f"{label}: rgb must be uint8 [H, W, 3]; got shape {array.shape}. Drop an alpha channel with rgb[..., :3], "
            "put channels last with rgb.transpose(1, 2, 0), repeat a grey image three times."
        )
    if array.dtype != np.uint8:
        raise FrameError(
            f"{label}: rgb must be uint8 with values 0 to 255; got {array.dtype}. Convert colours of 0 to 1 with "
            "(rgb * 255).round().astype(numpy.uint8)."
        )
    if array.shape[0] == 0 or array.shape[1] == 0:
        raise FrameError(f"{label}: rgb holds no pixels (shape {array.shape})")
    # Arrays that wrap a message or the bytes of a file are read-only, a type for which Numba would compile every
    # function again. Copying takes a fraction of a millisecond.
    return np.require(array, requirements=["C", "W"])


def _checked_depth(depth: npt.ArrayLike, shape: tuple[int, ...], label: str) -> npt.NDArray[np.float32]:
    array = _array(depth, "depth", label)
    if array.ndim != 2 and array.ndim - array.shape.count(1) == 2:
        raise FrameError(
            f"{label}: depth must be [H, W], one distance a pixel; got shape {array.shape}. Give depth.squeeze()."
        )
    if array.ndim != 2:
        raise FrameError(
            f"{label}: depth must be [H, W], one distance a pixel; got shape {array.shape}. "
            "A three-channel image is a picture of the depth, not the depth: export the raw sensor values."
        )
    if array.shape != shape:
        raise FrameError(
            f"{label}: rgb is {shape[1]}x{shape[0]} and depth {array.shape[1]}x{array.shape[0]} pixels; both must be "
            "of one size and registered to each other. Align the depth to the colour camera first."
        )
    if array.dtype == np.uint8 or array.dtype == np.bool_:
        raise FrameError(
            f"{label}: depth has 8 bits a pixel, too few for distances. Give uint16 millimetres or float metres."
        )
    if np.issubdtype(array.dtype, np.integer):
        meters = np.multiply(array, np.float32(MILLIMETERS), dtype=np.float32)
    elif np.issubdtype(array.dtype, np.floating):
        meters = array.astype(np.float32)
    else:
        raise FrameError(f"{label}: depth must be uint16 millimetres or float metres; got {array.dtype}")
    # NaN fails both comparisons. Unsigned integers cannot be negative, NaN or infinite.
    valid = meters > 0 if array.dtype.kind == "u" else (meters > 0) & (meters < np.inf)
    count = np.count_nonzero(valid)
    if not count:
        raise FrameError(
            f"{label}: every depth value is missing (0, negative, NaN or infinite). "
            "Check the sensor stream and the unit: floats are metres, integers millimetres."
        )
    near, far = np.count_nonzero(valid & (meters < USUAL[0])), np.count_nonzero(valid & (meters > USUAL[1]))
    if 2 * max(near, far) > count:
        _judge_unit(float(np.median(meters[valid])), label)
    # Features are relative to the farthest pixel. So one wild pixel of a stereo camera at 60 m, or a background that a
    # renderer marks with 1e10, would make all of a table equally near. Depth cameras do not measure that far.
    if far or (count < meters.size and array.dtype.kind != "u"):
        kept = valid & (meters <= FARTHEST)
        usual = kept & (meters <= USUAL[1])
        meters[~(usual if 2 * np.count_nonzero(usual) >= np.count_nonzero(kept) else kept)] = 0
    return np.ascontiguousarray(meters)


def _judge_unit(median: float, label: str) -> None:
    """Reject a median depth that no camera measures; warn, once per process, of one that is rare."""
    if median < NEAREST:
        raise FrameError(
            f"{label}: the median depth is {1000 * median:.2g} mm. "
            "Floats are taken as metres, integers as millimetres: convert other units first."
        )
    if median > FARTHEST:
        raise FrameError(
            f"{label}: the median depth is {median:.0f} m. "
            "Floats are taken as metres: divide millimetres by 1000, centimetres by 100. Set missing depth to 0."
        )
    if not _told_of_unit:
        _told_of_unit.append(label)
        log.warning(
            "%s: the median depth is %.2g m, which is rare: is it of another unit? Floats are taken as metres and "
            "integers as millimetres, unless a depth_scale is given. (Said once.)",
            label,
            median,
        )


def _checked_instances(instances: npt.ArrayLike, shape: tuple[int, ...], label: str) -> npt.NDArray[np.int32]:
    array = np.asarray(instances)
    if array.shape != shape:
        raise FrameError(f"{label}: instances must be [H, W] = {shape}, like rgb; got shape {array.shape}")
    if not np.issubdtype(array.dtype, np.integer):
        raise FrameError(f"{label}: instances must be integer ids; got {array.dtype}")
    if array.size and int(array.min()) < IGNORE:
        raise FrameError(
            f"{label}: instances must be -1 (ignore), 0 (background), 1 (supporting surface) or an object's id from 2; "
            f"got {int(array.min())}"
        )
    if array.size and int(array.max()) > np.iinfo(np.int32).max:
        raise FrameError(
            f"{label}: instance ids must be at most {np.iinfo(np.int32).max}; got {int(array.max())}. Number the "
            "objects anew, from 2 on."
        )
    return np.ascontiguousarray(array.astype(np.int32))
