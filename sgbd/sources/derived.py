"""Datasets whose frames are made from those of another dataset."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sgbd.sources.source import FrameSource


class Derived(FrameSource):
    """Frames made from those of another dataset, with the same categories and splits.

    Subclasses implement `read` and, if the frames have other names, `names` and `files`.

    Args:
        source: The other dataset.
    """

    def __init__(self, source: FrameSource) -> None:
        self.source = source
        self.split = source.split

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

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the underlying dataset's frames."""
        return self.source.names

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
        """Return the files of the frame that frame `index` is made from."""
        return self.source.files(index)

    def options(self) -> Mapping[str, Any]:
        """Return class and options of the underlying dataset."""
        kind = type(self.source)
        return {"source": {"_target_": f"{kind.__module__}.{kind.__qualname__}", **self.source.options()}}
