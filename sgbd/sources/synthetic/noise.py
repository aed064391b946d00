"""Three-dimensional value noise, used as surface grain."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.machine.compiled import compiled


@compiled(inline="always")
def _lattice(i: int, j: int, k: int, seed: int) -> float:
    # Integer hash (xor-shift and multiply) of a lattice point; gives the same value on every machine.
    h = (i * 374761393 + j * 668265263 + k * 2147483647 + seed * 1274126177) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 1274126177) & 0xFFFFFFFF
    h = ((h ^ (h >> 16)) * 2246822519) & 0xFFFFFFFF
    return (h ^ (h >> 15)) / 4294967296.0


@compiled
def _noise(points: npt.NDArray[np.float32], octaves: int, seed: int, out: npt.NDArray[np.float32]) -> None:
    for n in range(points.shape[0]):
        total, weight, scale, norm = 0.0, 1.0, 1.0, 0.0
        for octave in range(octaves):
            x, y, z = points[n, 0] * scale, points[n, 1] * scale, points[n, 2] * scale
            fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
            i, j, k = int(fx), int(fy), int(fz)
            tx, ty, tz = x - fx, y - fy, z - fz
            tx, ty, tz = tx * tx * (3 - 2 * tx), ty * ty * (3 - 2 * ty), tz * tz * (3 - 2 * tz)
            s = seed + 101 * octave
            a = _lattice(i, j, k, s) * (1 - tx) + _lattice(i + 1, j, k, s) * tx
            b = _lattice(i, j + 1, k, s) * (1 - tx) + _lattice(i + 1, j + 1, k, s) * tx
            c = _lattice(i, j, k + 1, s) * (1 - tx) + _lattice(i + 1, j, k + 1, s) * tx
            d = _lattice(i, j + 1, k + 1, s) * (1 - tx) + _lattice(i + 1, j + 1, k + 1, s) * tx
            total += weight * ((a * (1 - ty) + b * ty) * (1 - tz) + (c * (1 - ty) + d * ty) * tz)
            norm += weight
            weight *= 0.5
            scale *= 2.03
        out[n] = total / norm


def fractal_noise(points: npt.NDArray[np.float32], octaves: int = 3, seed: int = 0) -> npt.NDArray[np.float32]:
    """Return value noise summed over octaves, each with about half the cell size and half the strength.

    Args:
        points: float32 [n, 3], in units of the coarsest lattice cell.
        octaves: Number of octaves.
        seed: Random seed.

    Returns:
        float32 [n], 0 to 1, mean 0.5.
    """
    out = np.empty(len(points), dtype=np.float32)
    _noise(np.ascontiguousarray(points, dtype=np.float32), octaves, seed, out)
    return out


def cell_values(*indices: npt.NDArray[np.int64], seed: int = 0) -> npt.NDArray[np.float32]:
    """Return a pseudo-random number, 0 to 1, for each grid cell, given by its integer indices."""
    mixed = np.full(indices[0].shape, np.uint64(seed + 0x9E3779B9), dtype=np.uint64)
    for index in indices:
        mixed = (mixed ^ index.astype(np.uint64)) * np.uint64(0xBF58476D1CE4E5B9)
        mixed ^= mixed >> np.uint64(29)
    return ((mixed >> np.uint64(40)).astype(np.float32)) / np.float32(1 << 24)
