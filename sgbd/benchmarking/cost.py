"""Measure the cost of methods: parameters, bytes, memory, and time per frame with and without pre-processing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf

from sgbd.baselines.baseline import Baseline, SuperpixelBaseline
from sgbd.benchmarking.environment import environment, limited_to
from sgbd.benchmarking.frames import RawFrame
from sgbd.benchmarking.fresh_process import in_fresh_process, save_frames
from sgbd.benchmarking.report import Report
from sgbd.benchmarking.stages import STAGES, segment_in_stages
from sgbd.benchmarking.timing import Stopwatch
from sgbd.checkpoint import Checkpoint, find_checkpoint
from sgbd.frame import MILLIMETERS
from sgbd.jobs.configuration import ConfigurationError
from sgbd.machine.progress_bar import ProgressBar
from sgbd.segmenter import Segmenter
from sgbd.sources import FrameSource

BEFORE, AFTER = STAGES[:3], STAGES[3:]
"""Stages of a trained model: pre-processing (frame to graph) and the remaining ones."""

PREPROCESSING, METHOD = "pre-processing", "method"

MEMORY_FRAMES = 6
"""Number of frames over which the peak memory of a fresh process is measured."""


def measure_costs(
    config: DictConfig, segmenters: Mapping[str, Segmenter], methods: Mapping[str, Any], source: FrameSource
) -> Report:
    """Measure the time of methods in turns, single-threaded, and the memory of each in a separate process.

    Args:
        config: Configuration with the keys of conf/compare.yaml.
        segmenters: Trained models by name.
        methods: Other methods by name. Only baselines are measured; label images have no cost.
        source: Frames to sample evenly from.

    Returns:
        A report with the table `cost`.

    Raises:
        ConfigurationError: If there is no method to measure.
    """
    runs: dict[str, Callable[[RawFrame, Stopwatch], Any]] = {}
    for name, segmenter in segmenters.items():
        runs[name] = partial(segment_in_stages, segmenter)
    for name, method in methods.items():
        if isinstance(method, Baseline):
            runs[name] = partial(_run_baseline, method)
    if not runs:
        raise ConfigurationError("there is no method to measure. Give checkpoints='{name: file}' or baseline=[…]")
    frames = sample_frames(source, config.cost_frames)
    height, width = frames[0].depth.shape
    with limited_to(None, 1):
        settings: dict[str, Any] = OmegaConf.to_container(config, resolve=True)  # type: ignore[assignment]
        notes = [f"{len(frames)} frames of {source.split}, {width}x{height}, {config.cost_repeats} repetitions"]
        report = Report(environment(), settings, notes)
        watches = {name: Stopwatch() for name in runs}
        for number in ProgressBar(range(config.cost_repeats + 1), "cost", unit="turn"):
            for name, run in runs.items():
                # The first turn triggers compilation and is not counted.
                run(frames[number % len(frames)], watches[name] if number else Stopwatch())
        rows = []
        for name in runs:
            model = segmenters.get(name)
            before, after = (BEFORE, AFTER) if model else ((PREPROCESSING,), (METHOD,))
            rows.append(
                {
                    "method": name,
                    **(_size(config, name) if model else {"parameters": 0, "kilobytes": 0.0}),
                    **_times(watches[name], before, after),
                    "peak_mib": _peak(config, name, frames, model is not None),
                }
            )
    report.add(
        "cost",
        "Cost of each method; median milliseconds a frame. Memory: peak of a fresh process beyond its imports",
        rows,
    )
    return report


def sample_frames(source: FrameSource, count: int) -> list[RawFrame]:
    """Sample frames evenly from a source, in the form that a camera driver delivers.

    Args:
        source: The frames.
        count: Maximum number of frames.

    Raises:
        ConfigurationError: If there are no frames, or their sizes differ, so that times are not comparable.
    """
    if len(source) == 0:
        raise ConfigurationError("there are no frames to measure on: the split is empty")
    frames = []
    for place in np.unique(np.linspace(0, len(source) - 1, count).round().astype(int)).tolist():
        frame = source[place]
        depth = np.clip(frame.depth / MILLIMETERS, 0, 65535).round().astype(np.uint16)
        frames.append(RawFrame(frame.rgb, depth, frame.intrinsics, None, frame.name))
    if len({raw.depth.shape for raw in frames}) > 1:
        raise ConfigurationError("the frames have several sizes, so that times do not compare: choose cost_frames=1")
    return frames


def _run_baseline(method: Baseline, raw: RawFrame, stopwatch: Stopwatch) -> None:
    """Segment a frame, timing pre-processing and the method itself."""
    if not isinstance(method, SuperpixelBaseline):
        with stopwatch.step(PREPROCESSING):
            frame = raw.frame()
        with stopwatch.step(METHOD):
            method(frame)
        return
    with stopwatch.step(PREPROCESSING):
        frame = raw.frame()
        label_map = method.superpixels(frame)
    with stopwatch.step(METHOD):
        method.merge(frame, label_map)


def _times(stopwatch: Stopwatch, before: tuple[str, ...], after: tuple[str, ...]) -> dict[str, float]:
    whole = stopwatch.sums((*before, *after))
    return {
        "frame_ms": whole.median,
        "p90_ms": whole.p90,
        "frame_cpu_ms": whole.cpu,
        "preprocessing_ms": stopwatch.sums(before).median,
        "without_preprocessing_ms": stopwatch.sums(after).median,
    }


def count_parameters(checkpoint: Checkpoint) -> int:
    """Return the number of parameters in a checkpoint, including all stages and objectness heads."""
    modules = [module for module in (checkpoint.model, checkpoint.objectness) if module is not None]
    own = sum(parameter.numel() for module in modules for parameter in module.parameters())
    return own + (0 if checkpoint.first_stage is None else count_parameters(checkpoint.first_stage))


def _size(config: DictConfig, name: str) -> dict[str, Any]:
    path = find_checkpoint(config.checkpoints[name], config.output_dir)
    return {
        "parameters": count_parameters(Checkpoint.load(path, tuple(config.trust))),
        "kilobytes": path.stat().st_size / 1000,
    }


def _peak(config: DictConfig, name: str, frames: list[RawFrame], is_model: bool) -> float | None:
    """Return the peak memory (MiB) of a fresh process beyond its imports; None if the system does not report it."""
    with TemporaryDirectory(prefix="sgbd_cost_") as folder:
        path = Path(folder) / "frames.npz"
        save_frames(frames, path)
        job: dict[str, Any] = {
            "method": "ours" if is_model else "baseline",
            "frames": str(path),
            "n": 0,
            "count": MEMORY_FRAMES,
            "checkpoint": str(find_checkpoint(config.checkpoints[name], config.output_dir)) if is_model else "",
            "trust": list(config.trust),
            "torch_threads": 1,
            "baseline": None if is_model else OmegaConf.to_container(config.baseline[name], resolve=True),
        }
        found = in_fresh_process(job, timeout=1800)
    return None if found["peak_mib"] is None else found["peak_mib"] - found["imports_mib"]
