"""Errors of reading datasets and frames."""

from __future__ import annotations

from pathlib import Path

from sgbd.frame import FrameError

MOST_NAMED = 6
"""Maximum number of file and folder names listed in an error message."""


class DatasetNotFoundError(FileNotFoundError):
    """A dataset folder does not contain what its reader expects.

    Args:
        root: The given folder.
        missing: What was not found there.
        layout: The folder layout that the reader expects.
        remedy: How to obtain or generate the data.
    """

    def __init__(self, root: str | Path, missing: str, layout: str, remedy: str) -> None:
        self.root = Path(root)
        self.missing = missing
        self.layout = layout
        self.remedy = remedy
        super().__init__(missing)

    def __reduce__(self) -> tuple[type[DatasetNotFoundError], tuple[Path, str, str, str]]:
        # OSError interprets its arguments itself, so that the default pickling, needed by worker processes, fails.
        return type(self), (self.root, self.missing, self.layout, self.remedy)

    def __str__(self) -> str:
        layout = "\n".join(f"    {line}" for line in self.layout.strip().splitlines())
        held = _held_in(self.root)
        return f"no dataset in {self.root}: {self.missing}{held}\n  Expected layout:\n{layout}\n  {self.remedy}"


def _held_in(folder: Path) -> str:
    """Describe the actual content of a folder, which often shows the mistake; empty if there is no folder."""
    try:
        names = sorted(f"{path.name}/" if path.is_dir() else path.name for path in folder.iterdir())
    except OSError:
        return ""
    shown = ", ".join(names[:MOST_NAMED]) + (f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else "")
    return f"\n  It holds {shown or 'nothing'}"


class MissingExtraError(ImportError):
    """A required optional package is not installed; the message says how to install it."""


class FrameReadError(FrameError):
    """A file of a frame cannot be read.

    Args:
        path: The file.
        reason: What is wrong with it and, if known, what to do.
    """

    def __init__(self, path: str | Path, reason: str) -> None:
        self.path = Path(path)
        self.reason = reason
        super().__init__(path, reason)

    def __str__(self) -> str:
        return f"{self.path}: {self.reason}"
