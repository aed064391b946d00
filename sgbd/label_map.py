"""Compressed label maps: run-length encoding and zlib."""

from __future__ import annotations

import zlib

import numpy as np
import numpy.typing as npt


def pack(label_map: npt.NDArray[np.integer]) -> npt.NDArray[np.uint8]:
    """Compress a label map without loss.

    Args:
        label_map: int [H, W]; ids must fit into int32.

    Returns:
        uint8 [B].
    """
    flat = label_map.ravel()
    starts = np.flatnonzero(np.concatenate([[True], flat[1:] != flat[:-1]])) if flat.size else np.empty(0, np.int64)
    lengths = np.diff(starts, append=flat.size)
    # All lengths first, then all ids: similar adjacent numbers compress better, even at zlib's fastest level.
    runs = np.concatenate([lengths, flat[starts]]).astype("<i4")
    return np.frombuffer(bytearray(zlib.compress(runs.tobytes(), 1)), np.uint8)


def unpack(packed: npt.ArrayLike, shape: tuple[int, int]) -> npt.NDArray[np.int32]:
    """Restore a label map.

    Args:
        packed: uint8 [B] from `pack`, an array or a tensor on the CPU.
        shape: (H, W).

    Returns:
        int32 [H, W].

    Raises:
        ValueError: If the bytes are not a packed label map of that size.
    """
    try:
        lengths, ids = np.frombuffer(zlib.decompress(np.asarray(packed, np.uint8).tobytes()), "<i4").reshape(2, -1)
        return np.repeat(ids, lengths).astype(np.int32).reshape(shape)
    except (zlib.error, ValueError) as error:
        raise ValueError(f"not a packed label map of {shape[0]}x{shape[1]} pixels: {error}") from error
