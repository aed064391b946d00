"""Measure the peak memory of processes while something runs."""

from __future__ import annotations

import contextlib
import multiprocessing
import threading
from collections.abc import Callable, Sequence

import psutil

from sgbd.benchmarking.fresh_process import MEBIBYTE


def this_process() -> list[psutil.Process]:
    """Return only this process."""
    return [psutil.Process()]


def worker_processes() -> list[psutil.Process]:
    """Return the worker processes: children of the fork server or, without one, of this process."""
    children = psutil.Process().children()
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return children
    workers = []
    for child in children:
        with contextlib.suppress(psutil.Error):
            workers += child.children()
    return workers


class PeakMemory:
    """Context manager that records the largest memory of any single process of a group.

    Args:
        processes: Returns the currently running processes.

    Attributes:
        resident_mib: Largest resident memory of a single process, MiB; None if there was no process. Memory shared
            between processes (imported libraries of forked workers) counts in each.
        own_mib: Largest unshared memory of a single process, MiB: the cost of an additional worker.
    """

    # Seconds. A measurement takes some 10 ms per process, which would slow down what is measured.
    INTERVAL = 0.5

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
            self._measure()
        # Measure at least once, even if the context ends before the first interval.
        self._measure()

    def _measure(self) -> None:
        for process in self.processes():
            with contextlib.suppress(psutil.Error):  # it has just ended
                info = process.memory_full_info()
                self.resident_mib = max(info.rss / MEBIBYTE, self.resident_mib or 0.0)
                self.own_mib = max(info.uss / MEBIBYTE, self.own_mib or 0.0)
