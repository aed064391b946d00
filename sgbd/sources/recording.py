"""A recording: pairs of a colour and a depth image in one folder, all of one camera and without truth."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from pathlib import Path

from sgbd.sources.dataset_folder import DatasetFolder


class Recording(DatasetFolder):
    """The frames of a recording, all of them in the split "test".

    A subclass pairs the images (`_frames`), and says how a pair is read.
    """

    split = "test"

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each colour image without its suffix, in the order of the recording."""
        return tuple(self._frames)

    @property
    def splits(self) -> tuple[str, ...]:
        """The one split, "test"."""
        return ("test",)

    def files(self, index: int) -> tuple[Path, ...]:
        """Return the colour and the depth image of a frame."""
        return self._files[index]

    @cached_property
    @abstractmethod
    def _frames(self) -> dict[str, tuple[Path, Path]]:
        """Colour and depth image of each frame, by its name."""

    @cached_property
    def _files(self) -> tuple[tuple[Path, Path], ...]:
        return tuple(self._frames.values())
