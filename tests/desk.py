"""A ray-cast frame that resembles a camera's: three boxes on a table in front of a wall, to test trained models."""

from __future__ import annotations

import numpy as np

from sgbd.frame import Frame, Intrinsics

CAMERA = Intrinsics(525.0, 525.0, 319.5, 239.5)
BOXES = (
    ((-0.28, 0.0, 0.70), (-0.14, 0.16, 0.82), (190, 50, 45)),
    ((-0.04, 0.0, 0.78), (0.10, 0.10, 0.92), (60, 140, 70)),
    ((0.18, 0.0, 0.68), (0.28, 0.20, 0.78), (60, 80, 180)),
)
"""Two opposite corners of each box in metres (x right, y up from the table, z away from the camera), and colour."""


def desk() -> Frame:
    """Return a frame of 480 x 640 pixels: 0 wall, 1 table, 2 to 4 boxes; with reproducible sensor-like noise."""
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[:480, :640]
    right, down = (columns - CAMERA.cx) / CAMERA.fx, (rows - CAMERA.cy) / CAMERA.fy
    slope = np.radians(35)
    # Rays are scaled so that the ray parameter is the depth in metres.
    rays = np.stack([right, -down * np.cos(slope) - np.sin(slope), np.cos(slope) - down * np.sin(slope)], axis=-1)
    eye = np.array([0.0, 0.6, 0.0])
    with np.errstate(divide="ignore", invalid="ignore"):
        table, wall = -eye[1] / rays[..., 1], 2.0 / rays[..., 2]
    depth = np.where((table > 0) & (table < wall), table, wall)
    instances = (depth == table).astype(np.int32)
    colors = np.where(instances[..., None] == 1, (165, 130, 95), (205, 205, 195)).astype(np.float64)
    for number, (lower, upper, color) in enumerate(BOXES, start=2):
        with np.errstate(divide="ignore"):
            crossed = np.stack([(np.array(corner) - eye) / rays for corner in (lower, upper)])
        entry, leave = crossed.min(axis=0), crossed.max(axis=0).min(axis=-1)
        reached = entry.max(axis=-1)
        seen = (reached < leave) & (reached > 0) & (reached < depth)
        shade = np.array([0.7, 1.0, 0.85])[entry.argmax(axis=-1)]
        depth[seen], instances[seen] = reached[seen], number
        colors[seen] = (shade[..., None] * color)[seen]
    rgb = np.clip(colors + rng.normal(0, 4, colors.shape), 0, 255).astype(np.uint8)
    depth = (depth + rng.normal(0, 0.004, depth.shape)).astype(np.float32)
    return Frame(rgb, depth, CAMERA, instances, name="desk")
