"""Progress bars: drawn in place on a terminal, a line now and then in a log."""

from __future__ import annotations

import logging
import sys
import time
from typing import Any

from tqdm import tqdm

INTERVAL = 30.0
"""Seconds between two lines of a bar where nothing can be drawn in place: in a file, a pipe, a CI job."""


class ProgressBar(tqdm):
    """A bar of tqdm, with its arguments, that fills no log with copies of itself.

    Where standard error is no terminal, a bar leaves a line every `INTERVAL` seconds, and none if it takes less; where
    there is none, as in a program with windows, nothing.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        options["file"] = None if sys.stderr is not None and sys.stderr.isatty() else _LogLines()
        super().__init__(*args, **options)


class _LogLines:
    """Takes all that a bar draws, and lets a line through now and then."""

    def __init__(self) -> None:
        self._last = time.monotonic()

    def write(self, text: str) -> None:
        """Write a drawing of a bar as a line, if the last one is long enough ago."""
        now = time.monotonic()
        if sys.stderr is not None and text.strip() and now - self._last >= INTERVAL:
            sys.stderr.write(f"{text.strip()}\n")
            self._last = now

    def flush(self) -> None:
        """Show what was written."""
        if sys.stderr is not None:
            sys.stderr.flush()


class ConsoleHandler(logging.StreamHandler[Any]):
    """Messages above the bars on a terminal, not within them."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a message, and draw the bars again below it."""
        try:
            tqdm.write(self.format(record), file=self.stream)
        except Exception:
            self.handleError(record)
