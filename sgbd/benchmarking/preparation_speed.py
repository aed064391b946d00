"""Speed and memory of preparation: image files to cached graphs."""

from __future__ import annotations

import contextlib
import multiprocessing
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psutil

from sgbd.benchmarking.fresh_process import MEBIBYTE
from sgbd.data import SuperpixelGraphDataset
from sgbd.graph_file import SUFFIX
from sgbd.preparation import prepare
from sgbd.segmenter import Segmenter
from sgbd.sources import FrameSource


class WorkerMemory:
    """Watches how much memory the worker processes of this process hold at most, while it is entered.

    Attributes:
        resident_mib: Largest resident memory of any one of them, MiB; None if there was none. What all of them share
            (the imported libraries, where workers are copies of one process) counts in each.
        own_mib: Largest memory that one of them shares with no other process, MiB: what one more worker costs.
    """

    INTERVAL = 0.1

    def __init__(self) -> None:
        self.resident_mib: float | None = None
        self.own_mib: float | None = None
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> WorkerMemory:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._done.wait(self.INTERVAL):
            for worker in _workers():
                with contextlib.suppress(psutil.Error):  # it has just ended
                    held = worker.memory_full_info()
                    self.resident_mib = max(held.rss / MEBIBYTE, self.resident_mib or 0.0)
                    self.own_mib = max(held.uss / MEBIBYTE, self.own_mib or 0.0)


def _workers() -> list[psutil.Process]:
    """Return the worker processes: children of the server that copies itself, or of this process without one."""
    children = psutil.Process().children()
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return children
    workers = []
    for child in children:
        with contextlib.suppress(psutil.Error):
            workers += child.children()
    return workers


def measure_preparation(
    source: FrameSource, segmenter: Segmenter, counts: Sequence[int], folder: Path, progress: bool = False
) -> tuple[list[dict[str, Any]], Path]:
    """Prepare the same frames by several numbers of workers, after a warm-up that does not count.

    Args:
        source: Frames on disk.
        segmenter: Gives the superpixels and the graph.
        counts: Numbers of worker processes; 0 is this process.
        folder: An empty folder for the caches.
        progress: Whether to show progress bars.

    Returns:
        A row for each number of workers, and the recipe folder of the graphs.
    """
    cache = prepare_frames(source, segmenter, 0, folder / "warm_up", progress)
    rows = []
    for count in counts:
        cpu, start = time.process_time(), time.time()
        with WorkerMemory() as memory:
            cache = prepare_frames(source, segmenter, count, folder / f"workers_{count}", progress)
        wall, cpu = time.time() - start, time.process_time() - cpu
        stages = SuperpixelGraphDataset(cache, source.split).statistics()["seconds_per_frame"]
        written = sorted(path.stat().st_mtime for path in (cache / source.split).glob(f"*{SUFFIX}"))
        started = written[0] - start
        rows.append(
            {
                "superpixels": type(segmenter.superpixels).__name__,
                "workers": count,
                "frames": len(source),
                "seconds": wall,
                # Workers import first; in a long preparation that does not count.
                "seconds_to_first_graph": started,
                "frames_per_second_then": len(source) / (wall - started),
                "seconds_per_frame_and_core": (wall - started) * max(count, 1) / len(source),
                # Of worker processes the system tells the processor time only after they have ended.
                "cpu_seconds_per_frame": cpu / len(source) if count == 0 else None,
                **{f"{stage}_ms": 1000 * seconds for stage, seconds in stages.items()},
                "worker_resident_mib": memory.resident_mib if count else None,
                "worker_own_mib": memory.own_mib if count else None,
            }
        )
    return rows, cache


def prepare_frames(
    source: FrameSource, segmenter: Segmenter, workers: int, folder: Path, progress: bool = False
) -> Path:
    """Prepare frames; returns the recipe folder of the graphs."""
    return prepare(
        source, segmenter.superpixels, segmenter.graph, folder, workers=workers, on_error="fail", progress=progress
    )
