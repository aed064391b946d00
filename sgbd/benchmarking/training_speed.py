"""Measure speed and memory of training on cached graphs."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from sgbd.batches import FIELDS
from sgbd.benchmarking.fresh_process import MEBIBYTE
from sgbd.benchmarking.peak_memory import PeakMemory, this_process
from sgbd.benchmarking.repeated_graphs import repeat_graphs
from sgbd.checkpoint import Checkpoint
from sgbd.data import SuperpixelGraphDataset
from sgbd.sampling import EdgeSampler
from sgbd.training import Trainer


def measure_training(
    cache: Path,
    split: str,
    checkpoint: Checkpoint,
    trainer: Trainer,
    sampler: EdgeSampler,
    graphs: int,
    in_memory: bool,
    folder: Path,
) -> dict[str, Any]:
    """Train on cached graphs, repeated as needed, without validation.

    Args:
        cache: Recipe folder of the graphs.
        split: Split of the graphs.
        checkpoint: Model, objectness head and recipe; the weights are modified.
        trainer: The trainer.
        sampler: Sampler of the training pairs.
        graphs: Number of graphs per epoch.
        in_memory: Whether to keep the graphs in memory after the first reading.
        folder: An empty folder for training output.

    Returns:
        A table row; memory is that of the process before training and at its peak.
    """
    features = checkpoint.recipe["features"]
    repeated = repeat_graphs(cache, split, graphs, folder / "graphs")
    dataset = SuperpixelGraphDataset(repeated, split, features["node"], features["edge"], in_memory, FIELDS)
    statistics = dataset.statistics()
    before = psutil.Process().memory_info().rss / MEBIBYTE
    cpu, start = time.process_time(), time.perf_counter()
    with PeakMemory(this_process) as memory:
        trained = replace(trainer, progress=False).train(
            checkpoint.model,
            dataset,
            sampler=sampler,
            folder=folder / "run",
            recipe=checkpoint.recipe,
            objectness=checkpoint.objectness,
        )
    wall, cpu = time.perf_counter() - start, time.process_time() - cpu
    epochs = np.asarray(trained.history["seconds"], float)
    return {
        "graphs": graphs,
        "nodes": statistics["nodes_per_graph"],
        "edges": statistics["edges_per_graph"],
        "epochs": len(epochs),
        "seconds": wall,
        "cpu_seconds": cpu,
        "median_epoch_seconds": float(np.median(epochs)),
        "graphs_per_second": graphs / float(np.median(epochs)),
        "in_memory": in_memory,
        "before_mib": before,
        "peak_mib": memory.resident_mib,
    }
