"""Scores of an edge model on prepared graphs, both for validation during training and for trained models."""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from torch import nn

from sgbd.adjacency import LabelMap
from sgbd.calibration import ScoreCalibration, expected_calibration_error, right_segments
from sgbd.data import SuperpixelGraphDataset
from sgbd.label_map import unpack
from sgbd.machine.progress_bar import ProgressBar
from sgbd.machine.side_by_side import side_by_side, thread_count
from sgbd.machine.torch_threads import torch_threads
from sgbd.metrics import (
    FIRST_OBJECT,
    CategoryScores,
    ContingencyTable,
    ContourMap,
    FrameScores,
    category_scores,
    category_table,
    contours,
    edge_scores,
    frame_table,
    objects_by_contact,
    objects_by_label,
    objects_by_majority,
    oracle_segments,
    score_frame,
    seen_and_unseen,
    summarize,
)
from sgbd.partition import Partitioner
from sgbd.repaint import repaint
from sgbd.segmentation import ObjectRule, Segments, classify, partition_graph

if TYPE_CHECKING:
    from torch_geometric.data import Data

log = logging.getLogger(__name__)

OBJECT_SCORES = {
    "overlap_precision": "overlap_precision",
    "overlap_recall": "overlap_recall",
    "overlap_f_measure": "overlap_f",
    "overlap_detected_share": "f75",
    "boundary_precision": "boundary_precision",
    "boundary_recall": "boundary_recall",
    "boundary_f_measure": "boundary_f",
}
EDGE_SCORES = {
    "cut_precision": "cut_precision",
    "cut_recall": "cut_recall",
    "cut_f_measure": "cut_f",
    "merge_accuracy": "accuracy",
}
REGION_SCORES = {"rand_error": "rand_error", "variation_of_information": "variation_of_information"}
GROUPS = {"seen": "seen", "unseen": "unseen", "harmonic_mean": "hm"}
NAMED = 20
"""Number of frames without ground truth that a message lists."""
ROWS = ("seen", "unseen", "hm", "all", "unaided", "oracle_seen", "oracle_unseen", "oracle_hm", "oracle")


class EvaluationError(ValueError):
    """Raised if graphs cannot be scored; the message says why and what to do."""


@dataclass(frozen=True)
class Evaluation:
    """Scores of a model on a dataset, as fractions from 0 to 1.

    Attributes:
        scores: Means by protocol and score, such as `all/overlap_f`:

            - `all`: objects of all categories. A segment counts as an object if most of it lies on true objects, so
              only the merging is scored.
            - `unaided`: like `all`, but the model's objectness head decides which segments are objects. Absent without
              a head.
            - `oracle`: like `all`, for the best partition of the same superpixels.
            - `seen`, `unseen`, `hm`: the paper's protocol by category, and the harmonic mean of the two;
              `oracle_seen`, `oracle_unseen`, `oracle_hm` for the best partition. Absent if the dataset does not
              distinguish seen and unseen categories.
            - `calibration`: quality of the scores of the objects that the objectness head found: expected calibration
              error (10 bins) and Brier score; for comparison, the mean score and the fraction of right objects
              (intersection over union with a true object above 0.75). Absent without a head.
            - `edges`, `regions`: precision, recall and F of the cuts and accuracy of the merges; adapted Rand error and
              variation of information.
        frames: One row per frame, indexed by name. Columns without a prefix belong to `all`; the prefixes `unaided_`
            and `oracle_` name the protocol; `seen_` and `unseen_` are means over the frame's categories.
        categories: One row per category, indexed by name; empty without categories. The column `seen` exists if the
            dataset distinguishes seen and unseen categories.
        objects: One row per object found by the objectness head: frame, score and whether it is right; empty without a
            head.
    """

    scores: dict[str, float]
    frames: pd.DataFrame
    categories: pd.DataFrame
    objects: pd.DataFrame = field(default_factory=lambda: pd.DataFrame(columns=["frame", "score", "right"]))


@dataclass(frozen=True, eq=False)
class JudgedObjects:
    """Scores float32 [K] of the objects that the method found in a frame, and whether each is right, bool [K]."""

    score: npt.NDArray[np.float32]
    right: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class GraphScores:
    """Scores of one partitioned graph, by protocol; see `Evaluation`.

    `unaided` is None if the method does not decide what an object is, `oracle_by_category` if there are no superpixels,
    `objects` if the method does not score its objects.
    """

    all: FrameScores
    unaided: FrameScores | None
    by_category: CategoryScores
    oracle_by_category: CategoryScores | None
    objects: JudgedObjects | None = None


class Evaluator:
    """Partitions graphs and scores the result.

    Args:
        partition: The partitioner.
        rule: Decides which segments are objects.
        boundaries: Whether to score contours too. This needs the packed maps, and takes most of the time.
        calibration: Calibrates the scores of objects; None leaves them uncalibrated.
    """

    def __init__(
        self,
        partition: Partitioner,
        rule: ObjectRule | None = None,
        *,
        boundaries: bool = True,
        calibration: ScoreCalibration | None = None,
    ) -> None:
        self.partition = partition
        self.rule = rule or ObjectRule()
        self.boundaries = boundaries
        self.calibration = calibration

    def __call__(
        self,
        dataset: SuperpixelGraphDataset,
        model: nn.Module,
        objectness: nn.Module | None = None,
        *,
        progress: bool = False,
    ) -> Evaluation:
        """Score a model on its current device.

        Args:
            dataset: Graphs with ground truth and the feature columns that the model was trained on.
            model: The edge model. It is put into evaluation mode; its previous mode is restored at the end.
            objectness: The objectness head on the same device, or None.
            progress: Whether to show a progress bar.

        Returns:
            The scores.

        Raises:
            EvaluationError: If the dataset is empty or a frame has no ground truth.
        """
        if len(dataset) == 0:
            raise EvaluationError("there are no graphs to evaluate: the split is empty")
        modules = [module for module in (model, objectness) if module is not None]
        modes = [module.training for module in modules]
        scored = []
        for module in modules:
            module.eval()
        try:
            with torch_threads(1):
                for data in ProgressBar(dataset, "evaluating", unit="frame", disable=not progress):
                    classification = classify(model, objectness, data)
                    segments = partition_graph(data, classification, self.partition, self.rule, self.calibration)
                    unaided = objectness is not None
                    scored.append(self.score(data, segments, dataset.category_names, unaided=unaided))
        finally:
            for module, mode in zip(modules, modes, strict=True):
                module.train(mode)
        return mean_scores(scored, dataset.seen)

    def score(
        self, data: Data, segments: Segments, category_names: Iterable[str] = (), *, unaided: bool = True
    ) -> GraphScores:
        """Score the partition of one graph.

        Args:
            data: A graph with ground truth.
            segments: Its partition.
            category_names: The dataset's categories.
            unaided: Whether an objectness head decided `segments.is_object`, so that its decisions are scored too.

        Returns:
            The scores.

        Raises:
            EvaluationError: If the graph has no ground truth.
        """
        if "overlap_count" not in data:
            raise EvaluationError(
                f"frame {data.name!r} has no ground truth, so it cannot be scored. Give label images "
                "(dataset=folder: NAME_labels.png), or use python -m sgbd.predict."
            )
        superpixel, instance = data.overlap_index.numpy(), data.overlap_instance.numpy()
        count = data.overlap_count.numpy()
        best = oracle_segments(superpixel, instance, count, len(segments.segment))
        table = ContingencyTable.from_superpixels(superpixel, instance, count, segments.segment)
        oracle = ContingencyTable.from_superpixels(superpixel, instance, count, best)
        own_objects = np.nonzero(segments.is_object)[0]
        prediction = truth = oracle_prediction = None
        if self.boundaries:
            judged = np.union1d(objects_by_contact(table), own_objects)
            oracle_judged = np.union1d(objects_by_contact(oracle), objects_by_label(oracle))
            true_objects = table.instances[table.instances >= FIRST_OBJECT]
            truth, prediction, oracle_prediction = _contours(
                data, true_objects, (segments.segment, judged), (best, oracle_judged)
            )
        pairs = data.edge_label_index.numpy()
        merged = segments.segment[pairs[0]] == segments.segment[pairs[1]]
        category = _categories(data, list(category_names))
        return GraphScores(
            all=score_frame(
                table,
                objects_by_majority(table),
                prediction=prediction,
                truth=truth,
                oracle=oracle,
                oracle_prediction=oracle_prediction,
                edges=edge_scores(merged, data.edge_label.numpy()),
                name=data.name,
            ),
            unaided=(
                score_frame(table, own_objects, prediction=prediction, truth=truth, name=data.name) if unaided else None
            ),
            by_category=category_scores(table, category, prediction, truth),
            oracle_by_category=category_scores(oracle, category, oracle_prediction, truth),
            objects=_judged_objects(table, segments) if unaided else None,
        )


def _contours(
    data: Data,
    true_objects: npt.NDArray[np.int64],
    *partitions: tuple[npt.NDArray[np.integer], npt.NDArray[np.int64]],
) -> list[ContourMap]:
    """Find the contours of a graph's ground truth and of partitions of the graph.

    Args:
        data: The graph, with its packed maps.
        true_objects: The instances whose contours are found.
        *partitions: For each partition, the segment of each superpixel, and the segments whose contours are found.

    Returns:
        The contours of the ground truth, then those of each partition.
    """
    size = tuple(data.image_size[0].tolist())
    label_map, instances = unpack(data.label_map, size), unpack(data.truth_map, size)
    jobs = [partial(contours, instances, true_objects)]
    for segment, judged in partitions:
        jobs.append(partial(_contours_of_segments, label_map, segment, judged, instances))
    return side_by_side(jobs, thread_count())


def _contours_of_segments(
    label_map: LabelMap,
    segment: npt.NDArray[np.integer],
    judged: npt.NDArray[np.int64],
    instances: npt.NDArray[np.int32],
) -> ContourMap:
    return contours(repaint(label_map, segment), judged, instances)


def _categories(data: Data, names: Sequence[str]) -> dict[int, str]:
    """Return the category names of a graph's instances; instances without a category are left out."""
    places = zip(data.instance_id.tolist(), data.instance_category.tolist(), strict=True)
    return {instance: names[place - 1] for instance, place in places if place > 0}


def _judged_objects(table: ContingencyTable, segments: Segments) -> JudgedObjects:
    """Decide which objects of a frame are right; leave out objects without any pixel of known ground truth."""
    judged = table.segments[segments.is_object[table.segments]]
    right = right_segments(table, len(segments.area))
    return JudgedObjects(segments.score[judged], right[judged])


def mean_scores(scored: Sequence[GraphScores], seen: Collection[str]) -> Evaluation:
    """Average the scores of frames.

    Args:
        scored: The scores of each frame.
        seen: The categories seen in training; empty if the dataset does not distinguish seen and unseen categories.

    Returns:
        The means, without scores that no frame has.
    """
    means = summarize([frame.all for frame in scored])
    scores = _named("all", OBJECT_SCORES, means)
    scores |= _named("oracle", OBJECT_SCORES, means, prefix="oracle_")
    scores |= _named("edges", EDGE_SCORES, means)
    scores |= _named("regions", REGION_SCORES, means)
    frames = frame_table([frame.all for frame in scored])
    own = [frame.unaided for frame in scored if frame.unaided is not None]
    if own:
        scores |= _named("unaided", OBJECT_SCORES, summarize(own))
        table = frame_table(own)
        frames = frames.join(table[[name for name in OBJECT_SCORES if name in table]].add_prefix("unaided_"))
    if seen:
        frames = frames.join(_seen_and_unseen_of_frames(scored, seen).set_index(frames.index))
        oracle = [frame.oracle_by_category for frame in scored if frame.oracle_by_category is not None]
        for prefix, by_category in (("", [frame.by_category for frame in scored]), ("oracle_", oracle)):
            means_by_group = seen_and_unseen(by_category, seen)
            for group, short in GROUPS.items():
                scores |= _named(prefix + short, OBJECT_SCORES, means_by_group.loc[group].to_dict())
    categories = category_table([frame.by_category for frame in scored])
    if seen:
        categories["seen"] = [name in seen for name in categories.index]
    objects = _table_of_objects(scored)
    if objects is None:
        return Evaluation(scores, frames, categories)
    scores |= _calibration_scores(objects)
    return Evaluation(scores, frames, categories, objects)


def _named(protocol: str, names: Mapping[str, str], means: Mapping[Any, float], prefix: str = "") -> dict[str, float]:
    """Return those of the means that exist, as protocol/score; `names` maps their keys, without prefix, to scores."""
    values = {short: means.get(prefix + name, math.nan) for name, short in names.items()}
    return {f"{protocol}/{short}": value for short, value in values.items() if not math.isnan(value)}


def _table_of_objects(scored: Sequence[GraphScores]) -> pd.DataFrame | None:
    """Return all objects with a score, one row each, or None if there are none."""
    judged = [(frame.all.name, frame.objects) for frame in scored if frame.objects is not None]
    if not any(len(found.score) for _, found in judged):
        return None
    return pd.DataFrame(
        {
            "frame": np.repeat([name for name, _ in judged], [len(found.score) for _, found in judged]),
            "score": np.concatenate([found.score for _, found in judged]),
            "right": np.concatenate([found.right for _, found in judged]),
        }
    )


def _calibration_scores(objects: pd.DataFrame) -> dict[str, float]:
    """Measure how well the scores of objects are calibrated."""
    score, right = objects["score"].to_numpy(np.float64), objects["right"].to_numpy()
    return {
        "calibration/expected_error": expected_calibration_error(score, right),
        "calibration/brier": float(np.mean((score - right) ** 2)),
        "calibration/mean_score": float(score.mean()),
        "calibration/right_share": float(right.mean()),
    }


def _seen_and_unseen_of_frames(scored: Sequence[GraphScores], seen: Collection[str]) -> pd.DataFrame:
    """Return each frame's mean F over its seen and over its unseen categories; NaN if it has no such category."""
    rows = []
    for frame in scored:
        groups: dict[bool, list[float]] = {True: [], False: []}
        for category, score in frame.by_category.scores.items():
            groups[category in seen].append(score.overlap_f_measure)
        rows.append([np.mean(groups[key]) if groups[key] else math.nan for key in (True, False)])
    return pd.DataFrame(rows, columns=["seen_overlap_f_measure", "unseen_overlap_f_measure"])


def with_truth(dataset: SuperpixelGraphDataset, on_error: str = "skip") -> SuperpixelGraphDataset:
    """Return the graphs whose frames have ground truth, which training and scoring need.

    Args:
        dataset: Prepared graphs.
        on_error: What to do if some have no ground truth: `skip` leaves them out and lists them in a warning, `fail`
            raises an error.

    Returns:
        The dataset, or a sub-dataset of it.

    Raises:
        EvaluationError: If no graph has ground truth, or if one lacks it and `on_error` is `fail`.
    """
    labeled = dataset.labeled()
    missing = sorted(set(dataset.names) - set(labeled.names))
    if not missing:
        return dataset
    named = ", ".join(missing[:NAMED]) + (f" and {len(missing) - NAMED} more" if len(missing) > NAMED else "")
    told = f"{len(missing)} of {len(dataset)} frames of {dataset.split} have no ground truth: {named}"
    if on_error == "fail" or len(labeled) == 0:
        raise EvaluationError(
            f"{told}. Give label images (dataset=folder: NAME_labels.png), or use python -m sgbd.predict, which needs "
            "none."
        )
    log.warning("left out: %s", told)
    return labeled


def score_table(scores: dict[str, float]) -> pd.DataFrame:
    """Arrange scores as a table in per cent, with a row for each protocol and a column for each score.

    Args:
        scores: See `Evaluation.scores`.

    Returns:
        The table, with NaN for missing scores.
    """
    cells = {tuple(name.split("/", 1)): 100 * value for name, value in scores.items()}
    rows = [row for row in ROWS if any(key[0] == row for key in cells)]
    columns = [column for column in OBJECT_SCORES.values() if any(key[1] == column for key in cells)]
    return pd.DataFrame([[cells.get((row, column), np.nan) for column in columns] for row in rows], rows, columns)
