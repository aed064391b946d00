"""A dataset of tiny frames on disk, one .npz file each, and grids as the simplest superpixels."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sgbd.frame import Frame
from sgbd.sources.source import FrameSource

CATEGORIES = ("mug", "bowl")


class Boxes(FrameSource):
    """Frames of 24 x 32 pixels, written by `write_boxes`."""

    splits = ("train", "test")
    category_names = CATEGORIES
    seen = frozenset({"mug"})

    def __init__(self, root: Path, split: str = "train") -> None:
        self.root = Path(root)
        self.split = split
        self._paths = sorted((self.root / split).rglob("*.npz"))

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(path.relative_to(self.root).with_suffix("").as_posix() for path in self._paths)

    def files(self, index: int) -> tuple[Path, ...]:
        return (self._paths[index],)

    def options(self) -> Mapping[str, Any]:
        return {}

    def read(self, index: int) -> Frame:
        with np.load(self._paths[index]) as arrays:
            return Frame(**arrays, categories={2: "bowl"}, name=self.names[index])


def write_boxes(root: Path, count: int, split: str = "train") -> None:
    """Write frames with a background, a table and one box (instance 2, a bowl)."""
    for number in range(count):
        generator = np.random.default_rng(number)
        instances = np.zeros((24, 32), np.int32)
        instances[8:] = 1
        row, column = generator.integers(4, 12), generator.integers(2, 20)
        instances[row : row + 8, column : column + 9] = 2
        rgb = generator.integers(0, 40, (24, 32, 3)) + 70 * instances[..., None]
        depth = np.float32([1.5, 1.2, 1.0])[instances] + generator.normal(0, 0.002, instances.shape)
        path = root / split / f"scene_{number // 4}" / f"{number:05d}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, rgb=rgb.astype(np.uint8), depth=depth.astype(np.float32), instances=instances)


class Grid:
    """Square superpixels."""

    def __init__(self, size: int = 4) -> None:
        self.size = size

    def __call__(self, frame: Frame) -> npt.NDArray[np.int32]:
        rows, columns = np.indices(frame.depth.shape) // self.size
        return (rows * (columns.max() + 1) + columns).astype(np.int32)


class SlowGrid(Grid):
    """A grid that waits SLOW_GRID_SECONDS (environment variable) per frame, so that a test can interrupt it."""

    def __call__(self, frame: Frame) -> npt.NDArray[np.int32]:
        time.sleep(float(os.environ.get("SLOW_GRID_SECONDS", "0.01")))
        return super().__call__(frame)
