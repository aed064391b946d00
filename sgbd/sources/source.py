"""The interface of all frame sources."""

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

    Subclasses set `split` and implement `names`, `splits`, `files`, `read` and `options`. Frames are read on access and
    not cached. Sources store only paths and options, so that they can be sent to worker processes.

    Attributes:
        split: The split that this source reads.
        category_names: All categories of the dataset in the order of their ids, from 1; empty if objects have no
            categories.
        seen: The categories that occur in training frames; empty if there is no division into seen and unseen.
    """

    split: str
    category_names: tuple[str, ...] = ()
    seen: frozenset[str] = frozenset()

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """A unique and stable name for each frame, in dataset order; path components are separated by `/`."""

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
            FrameReadError: If a file is missing, damaged or of the wrong kind.
            FrameError: If the files do not form a valid frame.
        """

    @abstractmethod
    def options(self) -> Mapping[str, Any]:
        """Return the options that affect what is read from the same files, as plain JSON values."""

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
        """Return a hex digest that changes if the frames may have changed.

        It covers the names and order of the frames, the size and modification time of each file and the options of the
        reader, but neither the file contents nor the location of the dataset on disk.
        """
        digest = hashlib.sha256()
        header = [type(self).__name__, self.split, list(self.category_names), sorted(self.seen), self.options()]
        digest.update(json.dumps(header, sort_keys=True).encode())
        for name, files in self._fingerprinted():
            stats = [_size_and_time(path) for path in files]
            digest.update(json.dumps([name, stats]).encode())
        return digest.hexdigest()

    def _fingerprinted(self) -> Iterator[tuple[str, tuple[Path, ...]]]:
        """Yield name and files of each frame that the fingerprint covers; by default all frames."""
        return ((name, self.files(index)) for index, name in enumerate(self.names))

    def plot(self, index: int) -> Figure:
        """Draw one frame: colours, depth and, if present, the ground truth.

        Args:
            index: Index of the frame; negative values count from the end.

        Returns:
            A figure with one panel for each, created without pyplot, so that it does not need to be closed.
        """
        from matplotlib.figure import Figure

        # Imported here to keep drawing code out of the code digest in the cache key of graphs.
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
    """Return size in bytes and modification time in ns, or None for a missing file (reading it reports the error)."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns
