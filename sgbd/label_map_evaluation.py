"""Scores of methods that only provide a label map: classical baselines and label images of other systems."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from sgbd.evaluation import Evaluation, EvaluationError, GraphScores, mean_scores
from sgbd.failures import Failures, classify_failures
from sgbd.frame import Frame, FrameError
from sgbd.label_images import LabelImages
from sgbd.machine.progress_bar import ProgressBar
from sgbd.machine.workers import map_in_order
from sgbd.metrics import ContingencyTable, category_scores, objects_by_label, objects_by_majority, score_frame
from sgbd.sources import FrameSource

log = logging.getLogger(__name__)

NOT_AN_OBJECT = 0
"""Label of pixels that belong to no object according to a method."""


class LabelMapMethod(Protocol):
    """Maps a frame to a label map int32 [H, W], 0 = not an object.

    Attributes:
        decides_objects: Whether the method decides which segments are objects; if not, the ground truth decides.
    """

    decides_objects: bool

    def __call__(self, frame: Frame) -> npt.NDArray[np.int32]:
        """Segment a frame."""
        ...


@dataclass(frozen=True)
class ScoredFrame:
    """The evaluation of a method's label map of one frame.

    Attributes:
        scores: Its scores.
        failures: Its failures by kind.
    """

    scores: GraphScores
    failures: Failures


@dataclass(frozen=True)
class LabelMapEvaluation:
    """Scores of a method over the frames of a dataset.

    Attributes:
        evaluation: The mean scores. `unaided` exists only for methods that decide what an object is.
        failures: The failures on each scored frame, in the order of the dataset.
        left_out: Frames that were not scored, each with the reason.
    """

    evaluation: Evaluation
    failures: list[Failures]
    left_out: dict[str, str]


class ScoreFrame:
    """Runs a method on a frame of a dataset and scores the result. A class instead of a closure, so it can be pickled.

    Args:
        source: The frames.
        method: The segmentation method.
        boundaries: Whether to score contours too.
    """

    def __init__(self, source: FrameSource, method: LabelMapMethod, boundaries: bool = True) -> None:
        self.source = source
        self.method = method
        self.boundaries = boundaries

    def __call__(self, index: int) -> ScoredFrame | FrameError:
        """Score frame `index`; return an error if the frame or its label image cannot be used."""
        try:
            frame = self.source[index]
            if frame.instances is None:
                return FrameError("it has no ground truth")
            if frame.name != self.source.names[index]:
                # As in prepared graphs, the source names its frames: one of a user need not write the name into them.
                frame = replace(frame, name=self.source.names[index])
            prediction = self.method(frame)
        except FrameError as error:
            return FrameError(str(error))
        return score_label_map(
            prediction, frame, decides_objects=self.method.decides_objects, boundaries=self.boundaries
        )


def score_label_map(
    prediction: npt.NDArray[np.int32], frame: Frame, *, decides_objects: bool, boundaries: bool = True
) -> ScoredFrame:
    """Score the label map of one frame.

    Args:
        prediction: int32 [H, W], 0 = not an object.
        frame: The frame with ground truth; ignored pixels are not scored.
        decides_objects: Whether the method itself decided that its ids from 1 on are objects.
        boundaries: Whether to score contours too.

    Returns:
        Scores and failures. The protocol `all` scores the segments that lie mostly on true objects, except label 0. The
        failures are those of the method's own objects if it decides what an object is, else of the segments in `all`.
    """
    if frame.instances is None:
        raise EvaluationError(f"frame {frame.name!r} has no ground truth, so it cannot be scored")
    table = ContingencyTable.from_label_maps(prediction, frame.instances)
    aided = objects_by_majority(table)
    aided = aided[aided != NOT_AN_OBJECT]
    own = objects_by_label(table, first=NOT_AN_OBJECT + 1)
    predicted, truth = (prediction, frame.instances) if boundaries else (None, None)
    return ScoredFrame(
        GraphScores(
            all=score_frame(table, aided, prediction=predicted, truth=truth, name=frame.name),
            unaided=(
                score_frame(table, own, prediction=predicted, truth=truth, name=frame.name) if decides_objects else None
            ),
            by_category=category_scores(table, frame.categories, predicted, truth),
            oracle_by_category=None,
        ),
        classify_failures(table, own if decides_objects else aided, name=frame.name),
    )


def evaluate_label_maps(
    source: FrameSource,
    method: LabelMapMethod,
    *,
    workers: int = 0,
    boundaries: bool = True,
    on_error: str = "skip",
    title: str = "evaluating",
    progress: bool = False,
) -> LabelMapEvaluation:
    """Run a method on every frame of a dataset and score it with the metrics of `sgbd.evaluation`.

    Args:
        source: The frames.
        method: The segmentation method.
        workers: Number of worker processes; 0 does all work in this process. The scores do not depend on it.
        boundaries: Whether to score contours too.
        on_error: What to do with a frame that cannot be scored, because it cannot be read, has no ground truth, or its
            label image is missing or of another size: `skip` leaves it out and names it, `fail` raises an error.
        title: Title of the progress bar.
        progress: Whether to show a progress bar.

    Returns:
        The scores.

    Raises:
        EvaluationError: If no frame can be scored, if one cannot and `on_error` is `fail`, or if `on_error` is invalid.
        LabelImagesError: If the method is a folder without a label image of any frame.
    """
    if on_error not in ("skip", "fail"):
        raise EvaluationError(f"on_error must be 'skip' or 'fail'; got {on_error!r}")
    if len(source) == 0:
        raise EvaluationError("there are no frames to evaluate: the split is empty")
    if isinstance(method, LabelImages):
        method.missing(source.names)
    scored: list[ScoredFrame] = []
    left_out: dict[str, str] = {}
    results = map_in_order(ScoreFrame(source, method, boundaries), range(len(source)), workers)
    bar = ProgressBar(results, title, len(source), unit="frame", disable=not progress)
    for name, result in zip(source.names, bar, strict=True):
        if isinstance(result, ScoredFrame):
            scored.append(result)
            continue
        if on_error == "fail":
            results.close()
            raise EvaluationError(f"frame {name}: {result}")
        left_out[name] = str(result)
    if not scored:
        raise EvaluationError(f"none of the {len(source)} frames can be scored. {_named(left_out)}")
    if left_out:
        log.warning("left out: %d of %d frames. %s", len(left_out), len(source), _named(left_out))
    return LabelMapEvaluation(
        mean_scores([frame.scores for frame in scored], source.seen), [frame.failures for frame in scored], left_out
    )


def _named(left_out: dict[str, str], most: int = 20) -> str:
    shown: Iterable[tuple[str, str]] = list(left_out.items())[:most]
    more = f"; and {len(left_out) - most} more" if len(left_out) > most else ""
    return "; ".join(f"{name}: {reason}" for name, reason in shown) + more
