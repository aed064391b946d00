"""Measure the speed of evaluation on cached graphs, without and with contours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sgbd.benchmarking.timing import Stopwatch
from sgbd.data import SuperpixelGraphDataset
from sgbd.evaluation import Evaluator
from sgbd.segmentation import classify, partition_graph
from sgbd.segmenter import Segmenter

STAGES = ("reading", "model and partition", "scores without contours", "scores with contours")


def measure_evaluation(cache: Path, split: str, segmenter: Segmenter, repeats: int) -> list[dict[str, Any]]:
    """Time the evaluation of cached graphs, frame by frame and as a whole.

    Args:
        cache: Recipe folder of the graphs.
        split: Split of the graphs.
        segmenter: Provides model, partition and features.
        repeats: Number of passes over the graphs.

    Returns:
        One row per stage of `STAGES` with the times per frame, and two rows for `Evaluator` on the whole dataset,
        without and with contours, with the time of a pass divided by the number of frames.
    """
    features = segmenter.recipe["features"]
    dataset = SuperpixelGraphDataset(cache, split, features["node"], features["edge"])
    evaluators = {
        contours: Evaluator(segmenter.partition, segmenter.rule, boundaries=contours) for contours in (False, True)
    }
    stopwatch, passes = Stopwatch(), Stopwatch()
    _frame_by_frame(dataset, segmenter, evaluators, Stopwatch())
    for _ in range(repeats):
        _frame_by_frame(dataset, segmenter, evaluators, stopwatch)
        for contours, evaluator in evaluators.items():
            with passes.step(f"Evaluator {'with' if contours else 'without'} contours"):
                evaluator(dataset, segmenter.model, segmenter.objectness)
    for name, seconds in passes.seconds.items():
        stopwatch.seconds[name] = [(wall / len(dataset), cpu / len(dataset)) for wall, cpu in seconds]
    return [{"stage": name, **timing.row()} for name, timing in stopwatch.timings().items()]


def _frame_by_frame(
    dataset: SuperpixelGraphDataset, segmenter: Segmenter, evaluators: dict[bool, Evaluator], stopwatch: Stopwatch
) -> None:
    for index in range(len(dataset)):
        with stopwatch.step(STAGES[0]):
            data = dataset[index]
        with stopwatch.step(STAGES[1]):
            classification = classify(segmenter.model, segmenter.objectness, data)
            segments = partition_graph(data, classification, segmenter.partition, segmenter.rule, segmenter.calibration)
        for stage, evaluator in zip(STAGES[2:], evaluators.values(), strict=True):
            with stopwatch.step(stage):
                evaluator.score(data, segments, dataset.category_names, unaided=segmenter.objectness is not None)
