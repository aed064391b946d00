"""The processors that this process may run on."""

from __future__ import annotations

import os


def usable_processors() -> list[int]:
    """Return the numbers of the processors that this process may run on.

    On systems that do not tell (macOS, Windows), these are all processors of the machine.
    """
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))
