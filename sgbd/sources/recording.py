"""Base class for recordings: pairs of colour and depth images of one camera, without ground truth."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from pathlib import Path

from sgbd.sources.dataset_folder import DatasetFolder


class Recording(DatasetFolder):
    """The frames of a recording; all belong to the split "test".

    Subclasses pair the images (`_frames`) and implement `read` and `options`.
    """

    split = "test"

    @property
    def names(self) -> tuple[str, ...]:
        """File name of each colour image without its suffix, in recording order."""
        return tuple(self._frames)

    @property
    def splits(self) -> tuple[str, ...]:
        """The only split, "test"."""
        return ("test",)

    def files(self, index: int) -> tuple[Path, ...]:
        """Return the colour and depth image of a frame."""
        return self._files[index]

    @cached_property
    @abstractmethod
    def _frames(self) -> dict[str, tuple[Path, Path]]:
        """The colour and depth image of each frame, by frame name."""

    @cached_property
    def _files(self) -> tuple[tuple[Path, Path], ...]:
        return tuple(self._frames.values())
