"""Speed of training on cached graphs."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sgbd.batches import FIELDS
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
    """Train on cached graphs, repeated until there are enough, without validation.

    Args:
        cache: Recipe folder of the graphs.
        split: Their split.
        checkpoint: Model, objectness head and recipe to start from; the weights change.
        trainer: How to train.
        sampler: What picks the pairs.
        graphs: Graphs of an epoch.
        in_memory: Keep the graphs in memory after their first reading.
        folder: An empty folder for what training writes.

    Returns:
        The row of a report.
    """
    features = checkpoint.recipe["features"]
    dataset = SuperpixelGraphDataset(cache, split, features["node"], features["edge"], in_memory, FIELDS)
    repeated = dataset.index_select([number % len(dataset) for number in range(graphs)])
    statistics = dataset.statistics()
    cpu, start = time.process_time(), time.perf_counter()
    trained = replace(trainer, progress=False).train(
        checkpoint.model,
        repeated,
        sampler=sampler,
        folder=folder,
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
    }
