"""The interface of every place frames come from."""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sgbd.frame import SUPPORT, Frame

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class FrameSource(ABC):
    """The frames of one split of a dataset, as a read-only sequence.

    A subclass sets `split`, and says which frames there are (`names`), which files each is read from (`files`), how
    (`read`) and with which options (`options`). Frames are read on access and not kept. Sources hold only paths and
    options, so that they can be sent to worker processes.

    Attributes:
        split: The split that this source reads.
        category_names: All categories of the dataset in the order of their ids (the first is 1); empty if its objects
            have no categories.
        seen: The categories that training frames hold; empty if there is no division into seen and unseen.
    """

    split: str
    category_names: tuple[str, ...] = ()
    seen: frozenset[str] = frozenset()

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """A unique and stable name of each frame, in the order of the dataset; `/` is the only separator in it."""

    @property
    @abstractmethod
    def splits(self) -> tuple[str, ...]:
        """The splits that exist, in the order train, val, test."""

    @abstractmethod
    def files(self, index: int) -> tuple[Path, ...]:
        """Return the files that frame `index` is read from."""

    @abstractmethod
    def read(self, index: int) -> Frame:
        """Read frame `index`, 0 <= index < len(self).

        Raises:
            FrameReadError: If a file is missing, damaged or not what it should be.
            FrameError: If the files don't make a valid frame together.
        """

    @abstractmethod
    def options(self) -> Mapping[str, Any]:
        """Return the options that change what is read from the same files, as plain JSON values."""

    def __len__(self) -> int:
        return len(self.names)

    def __getitem__(self, index: int) -> Frame:
        size = len(self)
        if not -size <= index < size:
            raise IndexError(f"frame {index} of split {self.split!r}, which has {size} frames")
        return self.read(index % size)

    def __iter__(self) -> Iterator[Frame]:
        return (self.read(index) for index in range(len(self)))

    def fingerprint(self) -> str:
        """Return a hex digest that changes whenever the frames may have changed.

        It covers the frames' names, their order, the size and modification time of each file and the reader's options,
        not the files' contents, and not the place of the dataset on disk.
        """
        digest = hashlib.sha256()
        header = [type(self).__name__, self.split, list(self.category_names), sorted(self.seen), self.options()]
        digest.update(json.dumps(header, sort_keys=True).encode())
        for name, files in self._fingerprinted():
            stats = [_size_and_time(path) for path in files]
            digest.update(json.dumps([name, stats]).encode())
        return digest.hexdigest()

    def _fingerprinted(self) -> Iterator[tuple[str, tuple[Path, ...]]]:
        """Yield name and files of what a fingerprint covers, by default all frames."""
        return ((name, self.files(index)) for index, name in enumerate(self.names))

    def plot(self, index: int) -> Figure:
        """Draw one frame: colours, depth and, where there is one, the ground truth.

        Args:
            index: Which frame; negative values count from the end.

        Returns:
            A figure with one panel each, made without pyplot: nothing needs to be closed.
        """
        from matplotlib.figure import Figure

        # Here, so that what pictures look like is no part of what graphs are made by.
        from sgbd.reporting.overlay import overlay

        frame = self[index]
        panels = 2 if frame.instances is None else 3
        figure = Figure(figsize=(4.2 * panels, 3.6), layout="constrained")
        axes = figure.subplots(1, panels)
        axes[0].imshow(frame.rgb)
        axes[0].set_title(frame.name)
        depth = axes[1].imshow(np.ma.masked_equal(frame.depth, 0), cmap="viridis")
        axes[1].set_facecolor("black")
        axes[1].set_title("depth (m)")
        figure.colorbar(depth, ax=axes[1], shrink=0.8)
        if frame.instances is not None:
            objects = np.unique(frame.instances[frame.instances > SUPPORT])
            axes[2].imshow(overlay(frame.rgb, frame.instances, first=SUPPORT + 1, opacity=0.8))
            axes[2].set_title(f"{objects.size} objects")
            for identity in objects:
                if identity in frame.categories:
                    row, column = np.argwhere(frame.instances == identity).mean(axis=0)
                    axes[2].text(column, row, frame.categories[int(identity)], fontsize=6, ha="center", color="black")
        for axis in axes:
            axis.set_xticks([])
            axis.set_yticks([])
        return figure


def _size_and_time(path: Path) -> tuple[int, int] | None:
    """Return size in bytes and modification time in ns, or None for a missing file (reading it reports that)."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns
