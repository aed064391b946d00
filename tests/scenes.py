"""Small frames with a table and boxes on it, for tests that need whole frames, and a dataset of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np

from sgbd.frame import Frame
from sgbd.sources import FrameSource

HEIGHT, WIDTH = 48, 64
CATEGORIES = ("can", "mug", "bowl")
SEEN = frozenset({"can", "mug"})
COLORS = ((200, 40, 40), (40, 160, 60), (50, 70, 200))


def scene(number: int) -> Frame:
    """Return a frame with a table, a wall and three boxes of different colours at random positions."""
    rng = np.random.default_rng(number)
    rgb = np.full((HEIGHT, WIDTH, 3), (150, 120, 90), np.uint8)
    depth = np.tile(np.linspace(1.5, 1.0, HEIGHT, dtype=np.float32)[:, None], (1, WIDTH))
    instances = np.ones((HEIGHT, WIDTH), np.int32)
    rgb[:10], depth[:10], instances[:10] = (220, 220, 210), 3.0, 0
    for place in range(3):
        top, left = int(rng.integers(14, 24)), 4 + 20 * place + int(rng.integers(0, 4))
        box = np.s_[top : top + 14, left : left + 13]
        rgb[box], depth[box], instances[box] = COLORS[place], 0.8 + 0.02 * place, place + 2
    rgb = np.clip(rgb + rng.integers(-6, 7, rgb.shape), 0, 255).astype(np.uint8)
    names = {place + 2: CATEGORIES[(place + number) % 3] for place in range(3)}
    return Frame(rgb, depth, None, instances, names, f"scene{number}")


def write_pair(frame: Frame, rgb: Path, depth: Path) -> None:
    """Write colours and depth of a frame to two files, the depth in millimetres; their folders are created."""
    for path, image in ((rgb, frame.rgb), (depth, (frame.depth * 1000).round().astype(np.uint16))):
        path.parent.mkdir(parents=True, exist_ok=True)
        iio.imwrite(path, image)


class Scenes(FrameSource):
    """Scenes made up on the fly: training frames 0 to 5, validation 6 and 7, test 8 to 10."""

    category_names = CATEGORIES
    seen = SEEN

    def __init__(self, split: str = "train") -> None:
        self.split = split
        self.numbers = {"train": range(6), "val": range(6, 8), "test": range(8, 11)}[split]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"scene{number}" for number in self.numbers)

    @property
    def splits(self) -> tuple[str, ...]:
        return ("train", "val", "test")

    def files(self, index: int) -> tuple[Path, ...]:
        return ()

    def read(self, index: int) -> Frame:
        return scene(self.numbers[index])

    def options(self) -> Mapping[str, Any]:
        return {}
