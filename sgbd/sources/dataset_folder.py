"""A dataset that lies in one folder, and the error where it does not."""

from __future__ import annotations

from pathlib import Path

from sgbd.sources.errors import DatasetNotFoundError
from sgbd.sources.source import FrameSource


class DatasetFolder(FrameSource):
    """Frames below one folder.

    Attributes:
        root: The folder.
        layout: How the files must lie in it, for people.
        remedy: How to get or make the data.
    """

    root: Path
    layout: str
    remedy: str

    def _require_root(self) -> None:
        if not self.root.is_dir():
            raise self._not_found("the folder does not exist")

    def _not_found(self, missing: str) -> DatasetNotFoundError:
        return DatasetNotFoundError(self.root, missing, self.layout, self.remedy)
