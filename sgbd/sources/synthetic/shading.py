"""Pixel passes of the renderer that are written as loops and compiled."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]


@numba.njit(cache=True)
def edge_aware_mean(
    values: Floats, part: npt.NDArray[np.int32], depth: Floats, normals: Floats, radius: int, out: Floats
) -> None:
    """Average noisy light over neighbours on the same smooth surface.

    Args:
        values: float32 [H, W, C].
        part: int32 [H, W], which part each pixel shows; -1 nothing.
        depth: float32 [H, W], metres.
        normals: float32 [H, W, 3], unit length.
        radius: Half side of the square window, pixels.
        out: float32 [H, W, C], written.
    """
    height, width, channels = values.shape
    total = np.empty(channels, dtype=np.float32)
    for i in range(height):
        for j in range(width):
            total[:] = 0
            weight = np.float32(0)
            here, z = part[i, j], depth[i, j]
            nx, ny, nz = normals[i, j, 0], normals[i, j, 1], normals[i, j, 2]
            for y in range(max(0, i - radius), min(height, i + radius + 1)):
                for x in range(max(0, j - radius), min(width, j + radius + 1)):
                    if part[y, x] != here or abs(depth[y, x] - z) > np.float32(0.03) * z:
                        continue
                    alike = nx * normals[y, x, 0] + ny * normals[y, x, 1] + nz * normals[y, x, 2]
                    if alike < np.float32(0.8):
                        continue
                    weight += 1
                    for c in range(channels):
                        total[c] += values[y, x, c]
            for c in range(channels):
                out[i, j, c] = total[c] / weight
