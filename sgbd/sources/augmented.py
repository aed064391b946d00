"""Add augmented copies of the training frames to a dataset."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sgbd.frame import Frame
from sgbd.sources.derived import Derived
from sgbd.sources.source import FrameSource

if TYPE_CHECKING:
    from sgbd.frame_augmentation import FrameAugmentation


class Augmented(Derived):
    """The frames of a dataset plus, for training, augmented copies of each; for datasets too small to train on.

    A copy depends only on its frame's name, its number and the seed, and therefore not on the number of workers or the
    order of reading. Validation and test frames are unchanged.

    Args:
        source: Factory of the dataset, called as ``source(split=...)``.
        augmentation: Called as ``augmentation(frame, rng)`` to change a frame; e.g.
            `sgbd.frame_augmentation.FrameAugmentation`.
        split: "train", "val" or "test".
        copies: Number of augmented copies of each training frame.
        seed: Random seed of the copies.

    Raises:
        ValueError: If `copies` or `seed` is negative.
    """

    def __init__(
        self,
        source: Callable[..., FrameSource],
        augmentation: FrameAugmentation | Callable[[Frame, np.random.Generator], Frame],
        split: str = "train",
        copies: int = 2,
        seed: int = 0,
    ) -> None:
        if copies < 0 or seed < 0:
            raise ValueError(f"copies and seed must not be negative; got copies={copies}, seed={seed}")
        super().__init__(source(split=split))
        self.augmentation = augmentation
        self.copies = copies if self.split == "train" else 0
        self.seed = seed
        self._asked = copies

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each frame, followed by the names of its copies: NAME~1, NAME~2."""
        endings = ["", *(f"~{number}" for number in range(1, self.copies + 1))]
        return tuple(name + ending for name in self.source.names for ending in endings)

    def files(self, index: int) -> tuple[Path, ...]:
        """Return the files of frame `index`; those of the original if the frame is a copy."""
        return self.source.files(index // (self.copies + 1))

    def read(self, index: int) -> Frame:
        """Read a frame and augment it if it is a copy; raises the errors of the underlying dataset's `read`."""
        original, number = divmod(index, self.copies + 1)
        frame = self.source.read(original)
        if number == 0:
            return frame
        digest = hashlib.sha256(self.source.names[original].encode()).digest()
        rng = np.random.default_rng([self.seed, number, int.from_bytes(digest[:8], "little")])
        return replace(self.augmentation(frame, rng), name=f"{frame.name}~{number}")

    def options(self) -> Mapping[str, Any]:
        """Return the options of the copies, with class and options of the underlying dataset."""
        # Imported here to avoid a circular import.
        from sgbd.recipe import describe

        changes = describe(self.augmentation, "augmentation")
        return {"copies": self._asked, "seed": self.seed, "augmentation": changes, **super().options()}
