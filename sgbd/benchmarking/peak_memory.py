"""How much memory processes hold at most while something runs."""

from __future__ import annotations

import contextlib
import multiprocessing
import threading
from collections.abc import Callable, Sequence

import psutil

from sgbd.benchmarking.fresh_process import MEBIBYTE


def this_process() -> list[psutil.Process]:
    """Return this process alone."""
    return [psutil.Process()]


def worker_processes() -> list[psutil.Process]:
    """Return the worker processes: children of the server that copies itself, or of this process without one."""
    children = psutil.Process().children()
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return children
    workers = []
    for child in children:
        with contextlib.suppress(psutil.Error):
            workers += child.children()
    return workers


class PeakMemory:
    """Watches how much memory any one of some processes holds at most, while it is entered.

    Args:
        processes: Gives the processes that are there at the moment.

    Attributes:
        resident_mib: Largest resident memory of any one of them, MiB; None if there was none. What all of them share
            (the imported libraries, where workers are copies of one process) counts in each.
        own_mib: Largest memory that one of them shares with no other process, MiB: what one more worker costs.
    """

    INTERVAL = 0.1

    def __init__(self, processes: Callable[[], Sequence[psutil.Process]]) -> None:
        self.processes = processes
        self.resident_mib: float | None = None
        self.own_mib: float | None = None
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> PeakMemory:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._done.wait(self.INTERVAL):
            self._look()
        # What ends before the first look is seen, too.
        self._look()

    def _look(self) -> None:
        for process in self.processes():
            with contextlib.suppress(psutil.Error):  # it has just ended
                held = process.memory_full_info()
                self.resident_mib = max(held.rss / MEBIBYTE, self.resident_mib or 0.0)
                self.own_mib = max(held.uss / MEBIBYTE, self.own_mib or 0.0)
