"""Progress bars: redrawn in place on a terminal, an occasional line in a log."""

from __future__ import annotations

import logging
import sys
import time
from typing import Any

from tqdm import tqdm

INTERVAL = 30.0
"""Seconds between two lines of a bar that cannot be redrawn in place: in a file, a pipe or a CI job."""


class ProgressBar(tqdm):
    """A bar of tqdm, with its arguments, that does not flood a log with copies of itself.

    If standard error is not a terminal, the bar writes one line every `INTERVAL` seconds, and none if it takes less
    time. If there is no standard error, as in a program with windows, it writes nothing.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        options["file"] = None if sys.stderr is not None and sys.stderr.isatty() else _LogLines()
        super().__init__(*args, **options)


class _LogLines:
    """A file for a bar to draw into that lets only an occasional line through."""

    def __init__(self) -> None:
        self._last = time.monotonic()

    def write(self, text: str) -> None:
        """Write a drawing of a bar as a line, if the previous one was written long enough ago."""
        now = time.monotonic()
        if sys.stderr is not None and text.strip() and now - self._last >= INTERVAL:
            sys.stderr.write(f"{text.strip()}\n")
            self._last = now

    def flush(self) -> None:
        """Flush standard error."""
        if sys.stderr is not None:
            sys.stderr.flush()


class ConsoleHandler(logging.StreamHandler[Any]):
    """Writes messages above the bars on a terminal, not into them."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a message, and redraw the bars below it."""
        try:
            tqdm.write(self.format(record), file=self.stream)
        except Exception:
            self.handleError(record)
