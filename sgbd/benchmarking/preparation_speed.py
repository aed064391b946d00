"""Measure speed and memory of preparation, from image files to cached graphs."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sgbd.benchmarking.peak_memory import PeakMemory, worker_processes
from sgbd.data import SuperpixelGraphDataset
from sgbd.graph_file import SUFFIX
from sgbd.preparation import prepare
from sgbd.segmenter import Segmenter
from sgbd.sources import FrameSource


def measure_preparation(
    source: FrameSource, segmenter: Segmenter, counts: Sequence[int], folder: Path, progress: bool = False
) -> tuple[list[dict[str, Any]], Path]:
    """Prepare the same frames with different numbers of workers, after an uncounted warm-up.

    Args:
        source: Frames on disk.
        segmenter: Provides the superpixels and the graph.
        counts: Numbers of worker processes; 0 to run in this process.
        folder: An empty folder for the caches.
        progress: Whether to show progress bars.

    Returns:
        One row per number of workers, and the recipe folder of the graphs.
    """
    cache = prepare_frames(source, segmenter, 0, folder / "warm_up", progress)
    rows = []
    for count in counts:
        cpu, start = time.process_time(), time.time()
        with PeakMemory(worker_processes) as memory:
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
                # Import time of the workers, negligible in a long preparation.
                "seconds_to_first_graph": started,
                "frames_per_second_then": len(source) / (wall - started),
                "seconds_per_frame_and_core": (wall - started) * max(count, 1) / len(source),
                # The processor time of worker processes is only known after they have ended.
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
    """Prepare frames and return the recipe folder of the graphs."""
    return prepare(
        source, segmenter.superpixels, segmenter.graph, folder, workers=workers, on_error="fail", progress=progress
    )
