"""Read point cloud files of the Point Cloud Library (PCD) and convert them to images."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sgbd.frame import Intrinsics
from sgbd.sources.errors import FrameReadError, MissingExtraError

LEAST_SHARE_INSIDE = 0.5
"""Minimum share of an unorganised cloud's points that must fall into the image; below it the camera must be wrong."""


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points of one view.

    Attributes:
        xyz: float32 [P, 3], metres, x to the right, y down, z along the optical axis; z is NaN or 0 if missing.
        rgb: uint8 [P, 3]; None if the points have no colours.
        labels: int32 [P]; None if they have no labels.
        height: Number of image rows of an organised cloud (one point per pixel, row by row); 1 if unorganised.
        width: Number of image columns, or number of points if unorganised.
    """

    xyz: npt.NDArray[np.float32]
    rgb: npt.NDArray[np.uint8] | None
    labels: npt.NDArray[np.int32] | None
    height: int
    width: int

    @property
    def organized(self) -> bool:
        """Whether the points are the pixels of an image."""
        return self.height > 1

    def depth(self) -> npt.NDArray[np.float32]:
        """Return the depth image of an organised cloud, float32 [H, W], metres; 0 = missing."""
        z = self.xyz[:, 2].reshape(self.height, self.width)
        return np.where(np.isfinite(z) & (z > 0), z, np.float32(0))

    def intrinsics(self) -> Intrinsics | None:
        """Estimate the pinhole camera of an organised cloud from its points by least squares.

        Returns:
            The camera, or None if the points do not determine it.
        """
        seen = (self.depth() > 0).ravel()
        rows, columns = np.divmod(np.flatnonzero(seen), self.width)
        x, y, z = self.xyz[seen].T.astype(np.float64)
        if seen.sum() < 2 or np.ptp(x / z) == 0 or np.ptp(y / z) == 0:
            return None
        fx, cx = np.polyfit(x / z, columns, 1)
        fy, cy = np.polyfit(y / z, rows, 1)
        return Intrinsics(float(fx), float(fy), float(cx), float(cy)) if fx > 0 and fy > 0 else None

    def projected(self, intrinsics: Intrinsics, height: int, width: int) -> PointCloud:
        """Project the points to an organised cloud; a pixel hit by several points keeps the nearest.

        Args:
            intrinsics: The camera.
            height: Rows of the image.
            width: Columns of the image.

        Returns:
            The organised cloud. Pixels without a point have z = 0, black colour and label 0.

        Raises:
            ValueError: If most of the points lie outside the image.
        """
        x, y, z = self.xyz.T.astype(np.float64)
        present = np.flatnonzero(np.isfinite(self.xyz).all(axis=1) & (z > 0))
        column = np.round(intrinsics.fx * x[present] / z[present] + intrinsics.cx)
        row = np.round(intrinsics.fy * y[present] / z[present] + intrinsics.cy)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        if inside.sum() < LEAST_SHARE_INSIDE * present.size or not inside.any():
            raise ValueError(
                f"only {int(inside.sum())} of {present.size} points lie in the {width}x{height} pixels of "
                f"{intrinsics}; state the camera in the dataset's `intrinsics`"
            )
        point = present[inside]
        pixel = row[inside].astype(np.int64) * width + column[inside].astype(np.int64)
        # Of several assignments to a pixel the last one remains: sort from far to near.
        order = np.argsort(-z[point], kind="stable")
        source = np.full(height * width, -1, np.int64)
        source[pixel[order]] = point[order]
        filled = source >= 0

        def image(values: npt.NDArray) -> npt.NDArray:
            return np.where(filled.reshape(-1, *[1] * (values.ndim - 1)), values[source], values.dtype.type(0))

        return PointCloud(
            image(self.xyz),
            None if self.rgb is None else image(self.rgb),
            None if self.labels is None else image(self.labels),
            height,
            width,
        )


def read_point_cloud(path: str | Path) -> PointCloud:
    """Read a PCD file in ascii, binary or binary_compressed format.

    Args:
        path: The file. It needs the fields x, y and z; `rgb` or `rgba` (colours) and `label` are optional.

    Returns:
        The points, organised or not.

    Raises:
        FrameReadError: If the file is missing, truncated, damaged, or not a PCD file.
        MissingExtraError: If pypcd4 is not installed.
    """
    try:
        # Imported here because it is an optional dependency.
        from pypcd4 import PointCloud as File
    except ImportError as error:
        raise MissingExtraError(
            f"point clouds are read with pypcd4, which cannot be imported ({error}). "
            "Install the extra: pip install 'sgbd[pcd]'."
        ) from error
    try:
        file = File.from_path(path)
        columns = np.atleast_1d(file.pc_data)
    except FileNotFoundError:
        raise FrameReadError(path, "the file does not exist") from None
    # Depending on where the data is damaged, the reader raises different exceptions.
    except (OSError, ValueError, LookupError, TypeError, RuntimeError, struct.error) as error:
        raise FrameReadError(
            path, f"this is no point cloud (PCD), or a damaged one ({_first_line(error)}); copy or download it again"
        ) from error
    height, width, names = file.metadata.height, file.metadata.width, columns.dtype.names or ()
    if len(columns) != height * width or not len(columns):
        raise FrameReadError(
            path, f"the cloud holds {len(columns)} points instead of {width}x{height}; copy or download it again"
        )
    if not {"x", "y", "z"} <= set(names):
        raise FrameReadError(path, f"the points need the fields x, y and z; the file has {', '.join(names)}")
    color = next((name for name in ("rgb", "rgba") if name in names), None)
    if color is not None and columns.dtype[color].itemsize != 4:
        raise FrameReadError(
            path, f"the colours ({color}) must have 4 bytes; they have {columns.dtype[color].itemsize}"
        )
    return PointCloud(
        xyz=np.stack([columns[name] for name in "xyz"], axis=1).astype(np.float32),
        rgb=None if color is None else File.decode_rgb(np.ascontiguousarray(columns[color])),
        labels=columns["label"].astype(np.int32) if "label" in names else None,
        height=height,
        width=width,
    )


def organized_depth(path: Path, intrinsics: Intrinsics | None) -> tuple[npt.NDArray[np.float32], Intrinsics | None]:
    """Read the depth of an organised point cloud.

    Args:
        path: The PCD file.
        intrinsics: Its camera; None to fit it to the points.

    Returns:
        The depth, float32 [H, W], metres, 0 = missing; and the camera.

    Raises:
        FrameReadError: If the cloud is missing, damaged, or unorganised.
    """
    cloud = read_point_cloud(path)
    if not cloud.organized:
        raise FrameReadError(path, f"the {cloud.width} points are in no order of rows; an organised cloud is needed")
    return cloud.depth(), intrinsics or cloud.intrinsics()


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0] or type(error).__name__
