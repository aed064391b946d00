"""Frames to measure on: real ones from a folder, or scenes that are made up on the spot and need no dataset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sgbd.frame import MILLIMETERS, Frame, Intrinsics
from sgbd.jobs.configuration import ConfigurationError
from sgbd.sources import Folder

OBJECTS = 14


@dataclass(frozen=True, eq=False)
class RawFrame:
    """What a camera's driver hands over: decoded images, not validated yet.

    Attributes:
        rgb: uint8 [H, W, 3].
        depth: uint16 [H, W], millimetres, 0 = missing.
        intrinsics: The camera, if it is known.
        instances: int32 [H, W], the truth, if there is one.
        name: What to call the frame.
    """

    rgb: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.uint16]
    intrinsics: Intrinsics | None
    instances: npt.NDArray[np.int32] | None
    name: str

    def frame(self) -> Frame:
        """Return the validated frame, with truth where there is one."""
        return Frame(self.rgb, self.depth, self.intrinsics, self.instances, name=self.name)  # type: ignore[arg-type]


def made_up_scene(width: int, height: int, seed: int) -> RawFrame:
    """Draw a table in front of a wall with boxes and balls on it, shaded, textured and with holes in the depth.

    It has the number of superpixels and borders of a real frame, which is what time depends on. It is no picture of
    anything: datasets to learn from are made by `sgbd.sources.synthetic`.

    Args:
        width: Columns, pixels.
        height: Rows, pixels.
        seed: Fixes the scene.

    Returns:
        The scene, the same for the same arguments.
    """
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    v, u = rows / height, columns / width
    horizon = np.float32(0.3)
    wall = v < horizon
    depth = np.where(wall, np.float32(2.6), 2.6 - 1.7 * (v - horizon) / (1 - horizon)).astype(np.float32)
    texture = 12 * np.sin(60 * u + 7 * v + rng.uniform(0, 6)) * np.sin(35 * v)
    base = np.where(wall[..., None], rng.uniform(150, 230, 3), rng.uniform(80, 150, 3))
    rgb = base + texture[..., None] * ~wall[..., None]
    instances = np.where(wall, 0, 1).astype(np.int32)
    # From back to front, so that near objects cover far ones.
    for number, place in enumerate(np.sort(rng.uniform(horizon + 0.08, 0.95, OBJECTS)).tolist(), start=2):
        center, size = rng.uniform(0.05, 0.95), rng.uniform(0.05, 0.13)
        x, y = (u - center) / size, (v - place + size) / size
        is_ball = rng.random() < 0.5
        inside = x**2 + y**2 < 1 if is_ball else (abs(x) < rng.uniform(0.6, 1)) & (abs(y) < 1)
        bulge = np.sqrt(np.clip(1 - x**2 - y**2, 0, 1)) if is_ball else np.where(y < -0.3, 0.5 + y / 2, 1 - x / 3)
        distance = 2.6 - 1.7 * (place - horizon) / (1 - horizon)
        depth = np.where(inside, distance - 0.12 * bulge, depth)
        color = rng.uniform(30, 240, 3)
        stripes = 1 + rng.uniform(0, 0.3) * np.sign(np.sin(x * rng.uniform(2, 12)))
        rgb = np.where(inside[..., None], color * ((0.55 + 0.45 * bulge) * stripes)[..., None], rgb)
        instances[inside] = number
    # Sensors lose depth at the silhouettes, and here and there.
    edges = np.zeros(depth.shape, bool)
    edges[:, 1:] = abs(np.diff(depth, axis=1)) > 0.04
    missing = edges | np.roll(edges, 2, axis=1) | (rng.random(depth.shape) < 0.01)
    depth = np.where(missing, 0, depth + rng.normal(0, 0.002, depth.shape))
    return RawFrame(
        rgb=np.clip(rgb + rng.normal(0, 4, rgb.shape), 0, 255).astype(np.uint8),
        depth=np.clip(depth / MILLIMETERS, 0, 65535).astype(np.uint16),
        intrinsics=None,
        instances=instances,
        name=f"scene{seed}",
    )


def raw_frames(folder: str | None, size: tuple[int, int] | None, count: int, seed: int) -> list[RawFrame]:
    """Return the frames to measure on.

    Args:
        folder: A folder of real frames, as `sgbd.sources.Folder` reads it; None makes scenes up.
        size: Width and height, pixels; real frames of another size are resampled. None for their own, 640 x 480 if
            they are made up.
        count: How many at the most; a folder is sampled evenly.
        seed: Of the first scene that is made up.

    Returns:
        The frames.

    Raises:
        ConfigurationError: If the size or the count is impossible, or the folder's frames have several sizes.
        DatasetNotFoundError: If the folder holds no frames.
    """
    if count < 1:
        raise ConfigurationError(f"frame_count must be at least 1; got {count}")
    if size is not None and (len(size) != 2 or min(size) < 1):
        raise ConfigurationError(f"size must be [width, height] in pixels, for example [640,480]; got {list(size)}")
    if folder is None:
        width, height = size or (640, 480)
        return [made_up_scene(width, height, seed + number) for number in range(count)]
    source = Folder(Path(folder))
    places = np.unique(np.linspace(0, len(source) - 1, count).round().astype(int))
    frames = [_resampled(source[int(place)], size) for place in places]
    sizes = sorted({(raw.rgb.shape[1], raw.rgb.shape[0]) for raw in frames})
    if len(sizes) > 1:
        raise ConfigurationError(
            f"the frames in {folder} have several sizes ({', '.join(f'{w}x{h}' for w, h in sizes)}), so that their "
            "times do not compare. Give the size to resample them to, for example size=[640,480]"
        )
    return frames


def _resampled(frame: Frame, size: tuple[int, int] | None) -> RawFrame:
    """Take the nearest pixels: no values between those of two surfaces, no mixed labels."""
    width, height = size or (frame.width, frame.height)
    rows = (np.arange(height) + 0.5) * frame.height // height
    columns = (np.arange(width) + 0.5) * frame.width // width
    grid = np.ix_(rows.astype(int), columns.astype(int))
    camera = frame.intrinsics
    if camera is not None:
        x, y = width / frame.width, height / frame.height
        camera = Intrinsics(camera.fx * x, camera.fy * y, (camera.cx + 0.5) * x - 0.5, (camera.cy + 0.5) * y - 0.5)
    return RawFrame(
        rgb=np.ascontiguousarray(frame.rgb[grid]),
        depth=np.clip(frame.depth[grid] / MILLIMETERS, 0, 65535).round().astype(np.uint16),
        intrinsics=camera,
        instances=None if frame.instances is None else np.ascontiguousarray(frame.instances[grid]),
        name=frame.name,
    )
