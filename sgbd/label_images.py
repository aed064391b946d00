"""Segmentations of another system, read from a folder of label images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sgbd.frame import Frame
from sgbd.sources.errors import FrameReadError
from sgbd.sources.image import read_labels


class LabelImagesError(ValueError):
    """Raised if a folder contains no label image of the frames; the message says what is expected."""


class LabelImages:
    """A folder with one label image per frame: PNG, 8 or 16 bits, 0 = not an object, every other id an object.

    The image of frame NAME is `NAME.png` or, as written by `python -m sgbd.predict`, `NAME_labels.png`. A `/` in a name
    stands for a subfolder or `_`.

    Args:
        folder: The folder.
        first_object: The smallest id of an object, for example 2 if 1 is the supporting surface. Smaller ids are not
            objects.

    Raises:
        LabelImagesError: If there is no such folder, or `first_object` is below 1.
    """

    decides_objects = True

    def __init__(self, folder: str | Path, first_object: int = 1) -> None:
        self.folder = Path(folder).expanduser()
        if not self.folder.is_dir():
            raise LabelImagesError(
                f"there is no folder {self.folder}. Give the folder of another system's label images: NAME.png or "
                "NAME_labels.png for every frame NAME"
            )
        if first_object < 1:
            raise LabelImagesError(f"first_object must be at least 1, for 0 is no object; got {first_object}")
        self.first_object = first_object

    def path(self, name: str) -> Path | None:
        """Return the label image of a frame, or None if there is none.

        Args:
            name: Name of the frame.
        """
        for stem in dict.fromkeys((name, name.replace("/", "_"))):
            for ending in (".png", "_labels.png"):
                path = self.folder / f"{stem}{ending}"
                if path.is_file():
                    return path
        return None

    def missing(self, names: Sequence[str]) -> list[str]:
        """Return the names of frames without a label image.

        Args:
            names: Names of the frames.

        Raises:
            LabelImagesError: If no frame has one: the folder or the names are wrong.
        """
        absent = [name for name in names if self.path(name) is None]
        if names and len(absent) == len(names):
            there = sorted(path.name for path in self.folder.glob("*.png"))
            held = f"it holds {', '.join(there[:3])}" + (", ..." if len(there) > 3 else "") if there else "no PNG files"
            raise LabelImagesError(
                f"{self.folder} has no label image of any of the {len(names)} frames ({held}). Expected "
                f"{names[0]}.png or {names[0]}_labels.png, '/' as a subfolder or '_', and so on"
            )
        return absent

    def __call__(self, frame: Frame) -> npt.NDArray[np.int32]:
        """Read the label image of a frame.

        Args:
            frame: The frame; only its name and its size are used.

        Returns:
            int32 [H, W], 0 = not an object.

        Raises:
            FrameReadError: If the image is missing, damaged, not a label image or not of the frame's size.
        """
        path = self.path(frame.name)
        if path is None:
            raise FrameReadError(self.folder / f"{frame.name}.png", "the frame has no label image")
        labels = read_labels(path)
        if labels.shape != frame.depth.shape:
            raise FrameReadError(
                path,
                f"the label image is {labels.shape[1]}x{labels.shape[0]} pixels and its frame {frame.width}x"
                f"{frame.height}. Scale it to the frame with nearest-neighbour interpolation, which mixes no ids.",
            )
        return np.where(labels >= self.first_object, labels, 0).astype(np.int32)
