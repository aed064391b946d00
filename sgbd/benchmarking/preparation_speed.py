"""Measure speed and memory of preparation, from image files to cached graphs."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from sgbd.benchmarking.peak_memory import PeakMemory, this_process, worker_processes
from sgbd.data import SuperpixelGraphDataset
from sgbd.graph_file import SUFFIX
from sgbd.preparation import prepare
from sgbd.segmenter import Segmenter
from sgbd.sources import FrameSource


def measure_preparation(
    source: FrameSource, segmenter: Segmenter, workers: int, folder: Path, progress: bool = False
) -> tuple[dict[str, Any], Path]:
    """Prepare frames. Everything should be compiled before.

    Args:
        source: Frames on disk.
        segmenter: Provides the superpixels and the graph.
        workers: Number of worker processes; 0 to run in this process.
        folder: An empty folder for the cache.
        progress: Whether to show a progress bar.

    Returns:
        A table row, and the recipe folder of the graphs.
    """
    cpu, start = time.process_time(), time.time()
    with PeakMemory(worker_processes) as of_workers, PeakMemory(this_process) as of_this:
        cache = prepare_frames(source, segmenter, workers, folder, progress)
    wall, cpu = time.time() - start, time.process_time() - cpu
    stages = SuperpixelGraphDataset(cache, source.split).statistics()["seconds_per_frame"]
    first_graph = min(path.stat().st_mtime for path in (cache / source.split).glob(f"*{SUFFIX}"))
    started = first_graph - start
    row = {
        "superpixels": type(segmenter.superpixels).__name__,
        "workers": workers,
        "frames": len(source),
        "seconds": wall,
        # Import time of the workers, negligible in a long preparation.
        "seconds_to_first_graph": started,
        "frames_per_second_then": len(source) / (wall - started),
        "seconds_per_frame_and_core": (wall - started) * max(workers, 1) / len(source),
        # The processor time of worker processes is only known after they have ended.
        "cpu_seconds_per_frame": None if workers else cpu / len(source),
        **{f"{stage}_ms": 1000 * seconds for stage, seconds in stages.items()},
        "worker_resident_mib": of_workers.resident_mib if workers else None,
        "worker_own_mib": of_workers.own_mib if workers else None,
        "main_process_mib": of_this.resident_mib,
    }
    return row, cache


def prepare_frames(
    source: FrameSource, segmenter: Segmenter, workers: int, folder: Path, progress: bool = False
) -> Path:
    """Prepare frames and return the recipe folder of the graphs."""
    return prepare(
        source, segmenter.superpixels, segmenter.graph, folder, workers=workers, on_error="fail", progress=progress
    )
