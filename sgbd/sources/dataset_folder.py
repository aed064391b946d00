"""Base class for datasets stored in one folder, with a helpful error if the folder is not as expected."""

from __future__ import annotations

from pathlib import Path

from sgbd.sources.errors import DatasetNotFoundError
from sgbd.sources.source import FrameSource


class DatasetFolder(FrameSource):
    """A dataset stored in one folder.

    Attributes:
        root: The folder.
        layout: Description of the expected files, shown in error messages.
        remedy: How to obtain or generate the data, shown in error messages.
    """

    root: Path
    layout: str
    remedy: str

    def _require_root(self) -> None:
        if not self.root.is_dir():
            raise self._not_found("the folder does not exist")

    def _not_found(self, missing: str) -> DatasetNotFoundError:
        return DatasetNotFoundError(self.root, missing, self.layout, self.remedy)
