"""Label maps in little space: zlib over the differences of neighbouring pixels, as a plain byte tensor."""

from __future__ import annotations

import zlib

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor


def pack(label_map: npt.NDArray[np.integer]) -> Tensor:
    """Compress a map of ids without loss.

    Args:
        label_map: int [H, W]; ids that fit into int32.

    Returns:
        uint8 [B].
    """
    # Along a row most differences are 0, which zlib's fastest level already turns into next to nothing.
    steps = np.diff(label_map.astype("<i4"), axis=1, prepend=np.int32(0)).astype("<i4")
    return torch.frombuffer(bytearray(zlib.compress(steps.tobytes(), 1)), dtype=torch.uint8)


def unpack(packed: Tensor, shape: tuple[int, int]) -> npt.NDArray[np.int32]:
    """Restore a map of ids.

    Args:
        packed: uint8 [B] of `pack`.
        shape: (H, W).

    Returns:
        int32 [H, W].

    Raises:
        ValueError: If the bytes are not a packed map of that size.
    """
    try:
        steps = np.frombuffer(zlib.decompress(packed.contiguous().numpy().tobytes()), "<i4").reshape(shape)
    except (zlib.error, ValueError) as error:
        raise ValueError(f"not a packed label map of {shape[0]}x{shape[1]} pixels: {error}") from error
    return np.cumsum(steps, axis=1, dtype=np.int32)
