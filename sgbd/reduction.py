"""Reduction of frames by an integer factor, and enlargement of the label maps found in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sgbd.adjacency import LabelMap
from sgbd.frame import Frame, FrameError, Intrinsics


def check_factor(name: str, factor: object) -> None:
    """Raise a ValueError if the factor, given as the argument `name`, is not a positive integer."""
    if isinstance(factor, bool) or not isinstance(factor, int) or factor < 1:
        raise ValueError(f"{name} must be a positive integer, 2 for half the width and height; got {factor!r}")


def reduced(frame: Frame, factor: int) -> Frame:
    """Reduce a frame.

    A pixel of the result has the mean colour of a square of pixels, and the depth and ground truth of its central
    pixel, because a mean over the edge of an object would lie on no surface. Squares at the right and lower rim may be
    incomplete.

    Args:
        frame: The frame, H x W pixels.
        factor: Width and height of a square, pixels.

    Returns:
        The frame of ceil(H / factor) x ceil(W / factor) pixels, with the camera that sees it.

    Raises:
        FrameError: If none of the central pixels has depth.
    """
    from PIL import Image  # imported on use: most frames are not reduced

    rows, columns = (
        np.minimum(np.arange(0, size, factor) + factor // 2, size - 1) for size in (frame.height, frame.width)
    )
    central = np.ix_(rows, columns)
    depth = frame.depth[central]
    if not depth.any():
        raise FrameError(f"{frame.name or 'frame'}: no depth is left after a reduction by {factor}; use a smaller one")
    camera = frame.camera
    return replace(
        frame,
        rgb=np.asarray(Image.fromarray(frame.rgb).reduce(factor)),
        depth=depth,
        instances=None if frame.instances is None else frame.instances[central],
        intrinsics=Intrinsics(
            camera.fx / factor, camera.fy / factor, (camera.cx + 0.5) / factor - 0.5, (camera.cy + 0.5) / factor - 0.5
        ),
    )


def enlarged(label_map: LabelMap, factor: int, height: int, width: int) -> LabelMap:
    """Enlarge a label map of a reduced frame to the size of the frame.

    Args:
        label_map: int32 [height / factor, width / factor], rounded up.
        factor: Factor by which the frame was reduced.
        height: Rows of the frame, pixels.
        width: Columns of the frame, pixels.

    Returns:
        int32 [height, width].
    """
    return label_map.repeat(factor, axis=0)[:height].repeat(factor, axis=1)[:, :width]
