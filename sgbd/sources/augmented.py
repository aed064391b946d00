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
from sgbd.sources.source import FrameSource

if TYPE_CHECKING:
    from sgbd.frame_augmentation import FrameAugmentation


class Augmented(FrameSource):
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
        self.source = source(split=split)
        self.augmentation = augmentation
        self.split = self.source.split
        self.copies = copies if self.split == "train" else 0
        self.seed = seed
        self._asked = copies

    @property
    def category_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """All categories of the underlying dataset."""
        return self.source.category_names

    @property
    def seen(self) -> frozenset[str]:  # type: ignore[override]
        """The categories that occur in training frames."""
        return self.source.seen

    @property
    def root(self) -> Path | None:
        """Folder of the underlying dataset, if it has one."""
        return getattr(self.source, "root", None)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each frame, followed by the names of its copies: NAME~1, NAME~2."""
        endings = ["", *(f"~{number}" for number in range(1, self.copies + 1))]
        return tuple(name + ending for name in self.source.names for ending in endings)

    @property
    def splits(self) -> tuple[str, ...]:
        """The splits of the underlying dataset."""
        return self.source.splits

    def generate(self, workers: int = 0, progress: bool = True) -> None:
        """Generate the underlying dataset, if it is a synthetic one."""
        make = getattr(self.source, "generate", None)
        if make is not None:
            make(workers=workers, progress=progress)

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

        kind = type(self.source)
        source = {"_target_": f"{kind.__module__}.{kind.__qualname__}", **self.source.options()}
        changes = describe(self.augmentation, "augmentation")
        return {"copies": self._asked, "seed": self.seed, "augmentation": changes, "source": source}
