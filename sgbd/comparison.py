"""Comparison of trained models, classical baselines and other systems on the same frames with the same metrics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd
from hydra.utils import instantiate
from omegaconf import DictConfig

from sgbd.checkpoint import Checkpoint, find_checkpoint
from sgbd.evaluation import Evaluation, Evaluator, mean_scores, with_truth
from sgbd.failures import Failures, classify_failures
from sgbd.frame import Frame
from sgbd.jobs.configuration import ConfigurationError
from sgbd.jobs.pipeline import graphs_for
from sgbd.label_images import LabelImages
from sgbd.label_map_evaluation import LabelMapMethod, evaluate_label_maps
from sgbd.machine.progress_bar import ProgressBar
from sgbd.machine.torch_threads import torch_threads
from sgbd.metrics import ContingencyTable, objects_by_majority, oracle_table
from sgbd.segmentation import classify, partition_graph
from sgbd.segmenter import Segmenter
from sgbd.sources import FrameSource

MODEL, BASELINE, LABEL_IMAGES = "model", "baseline", "label images"

Predict = Callable[[Frame], npt.NDArray[np.int32]]
"""Maps a frame to its predicted objects, int32 [H, W], 0 = not an object."""


@dataclass(frozen=True)
class Judged:
    """The results of one method on all frames.

    Attributes:
        name: Name of the method.
        kind: `MODEL`, `BASELINE` or `LABEL_IMAGES`.
        evaluation: Its scores.
        failures: Its failures on each frame.
        predict: Finds the objects of a frame.
        aided: Whether the ground truth decides which segments are objects, because the method does not.
        segmenter: The segmenter of a trained model; None for other methods.
    """

    name: str
    kind: str
    evaluation: Evaluation
    failures: list[Failures]
    predict: Predict
    aided: bool
    segmenter: Segmenter | None = None

    @property
    def title(self) -> str:
        """The name, marked if the method is aided by the ground truth."""
        return f"{self.name} (aided)" if self.aided else self.name

    @property
    def overlap_f(self) -> pd.Series:
        """Overlap F of each frame: of the protocol `all` if the method is aided, else of `unaided`."""
        return self.evaluation.frames["overlap_f_measure" if self.aided else "unaided_overlap_f_measure"]

    @property
    def ranking(self) -> list[str]:
        """Names of the frames, worst overlap F first."""
        return [str(name) for name in self.overlap_f.sort_values(kind="stable").index]


def load_segmenters(config: DictConfig) -> dict[str, Segmenter]:
    """Load the trained models of a comparison.

    Args:
        config: A configuration with `checkpoints` (files or folders of trainings by name), `output_dir` and `trust`.
    """
    trust = tuple(config.trust)
    return {
        str(name): Segmenter(Checkpoint.load(find_checkpoint(path, config.output_dir), trust), trust=trust)
        for name, path in (config.checkpoints or {}).items()
    }


def load_methods(config: DictConfig) -> dict[str, LabelMapMethod]:
    """Instantiate the baselines and open the folders of label images of a comparison.

    Args:
        config: A configuration with `baseline` (classes by name), `predictions` (folders by name), `checkpoints` and
            `first_object`.

    Raises:
        ConfigurationError: If two methods have the same name.
    """
    baselines = {str(name): instantiate(node) for name, node in (config.get("baseline") or {}).items()}
    folders = {str(name): LabelImages(path, config.first_object) for name, path in (config.predictions or {}).items()}
    twice = sorted(
        (baselines.keys() & folders.keys()) | ((config.checkpoints or {}).keys() & (baselines | folders).keys())
    )
    if twice:
        raise ConfigurationError(f"two methods are called {', '.join(twice)}; give every one a name of its own")
    return {**baselines, **folders}


def judge(config: DictConfig, source: FrameSource, workers: int) -> list[Judged]:
    """Score all methods of a configuration.

    Args:
        config: A configuration with the keys of conf/compare.yaml.
        source: The frames.
        workers: Number of worker processes.

    Returns:
        The models, then the baselines, then the label images.

    Raises:
        ConfigurationError: If there is nothing to compare.
    """
    methods, segmenters = load_methods(config), load_segmenters(config)
    if not methods and not segmenters:
        raise ConfigurationError(
            "there is nothing to compare. Give checkpoints='{name: file}', predictions='{name: folder}' or "
            "baseline=[felzenszwalb]"
        )
    judged = [judge_model(name, segmenter, source, config, workers) for name, segmenter in segmenters.items()]
    for name, method in methods.items():
        found = evaluate_label_maps(
            source,
            method,
            workers=workers,
            boundaries=config.boundaries,
            on_error=config.on_error,
            title=name,
            progress=True,
        )
        kind = LABEL_IMAGES if isinstance(method, LabelImages) else BASELINE
        predict = method if method.decides_objects else _chosen_by_truth(method)
        judged.append(Judged(name, kind, found.evaluation, found.failures, predict, not method.decides_objects))
    return judged


def judge_model(name: str, segmenter: Segmenter, source: FrameSource, config: DictConfig, workers: int) -> Judged:
    """Score a trained model on prepared graphs, as `python -m sgbd.evaluate` does.

    Args:
        name: Its name.
        segmenter: The model.
        source: The frames.
        config: A configuration with `cache_dir`, `on_error` and `boundaries`.
        workers: Number of processes that prepare graphs.
    """
    prepared = graphs_for(segmenter, source, config.cache_dir, workers, config.on_error)
    dataset = with_truth(prepared, config.on_error)
    evaluator = Evaluator(
        segmenter.partition, segmenter.rule, boundaries=config.boundaries, calibration=segmenter.calibration
    )
    has_head = segmenter.objectness is not None
    scored, failures = [], []
    with torch_threads(1):
        for data in ProgressBar(dataset, name, unit="frame"):
            classification = classify(segmenter.model, segmenter.objectness, data)
            segments = partition_graph(data, classification, segmenter.partition, segmenter.rule, segmenter.calibration)
            scored.append(evaluator.score(data, segments, dataset.category_names, unaided=has_head))
            overlaps = (data.overlap_index.numpy(), data.overlap_instance.numpy(), data.overlap_count.numpy())
            table = ContingencyTable.from_superpixels(*overlaps, segments.segment)
            objects = np.nonzero(segments.is_object)[0] if has_head else objects_by_majority(table)
            oracle = oracle_table(*overlaps, len(segments.segment))
            failures.append(classify_failures(table, objects, oracle, data.name))

    def predict(frame: Frame) -> npt.NDArray[np.int32]:
        return segmenter.segment_frame(frame).instances

    evaluation, shown = mean_scores(scored, dataset.seen), predict if has_head else _chosen_by_truth(predict)
    return Judged(name, MODEL, evaluation, failures, shown, not has_head, segmenter)


def _chosen_by_truth(method: Predict) -> Predict:
    """Return a function from a frame to those segments of a method that lie mostly on true objects."""

    def predict(frame: Frame) -> npt.NDArray[np.int32]:
        segments = method(frame)
        chosen = objects_by_majority(ContingencyTable.from_label_maps(segments, frame.instances))  # type: ignore[arg-type]
        return np.where(np.isin(segments, chosen), segments, 0).astype(np.int32)

    return predict
