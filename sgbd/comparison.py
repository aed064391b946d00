"""Trained models, classical baselines and other systems side by side, on the same frames with the same metrics."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from hydra.utils import instantiate
from omegaconf import DictConfig
from tqdm import tqdm

from sgbd.atomic_file import write_whole
from sgbd.checkpoint import Checkpoint, find_checkpoint
from sgbd.configuration import ConfigurationError
from sgbd.evaluation import Evaluation, Evaluator, mean_scores, with_truth
from sgbd.failures import TABLE_AS_OBJECT, Failures, classify_failures, failure_counts, failure_table
from sgbd.frame import Frame
from sgbd.label_images import LabelImages
from sgbd.label_map_evaluation import LabelMapMethod, evaluate_label_maps
from sgbd.metrics import ContingencyTable, objects_by_majority, oracle_table
from sgbd.pipeline import graphs_for
from sgbd.plot import frames_figure, methods_figure, worst_frame_figure
from sgbd.results import write_evaluation, write_figure
from sgbd.segmentation import classify, partition_graph
from sgbd.segmenter import Segmenter
from sgbd.sources import FrameSource
from sgbd.torch_threads import torch_threads

log = logging.getLogger(__name__)

SHOWN = {
    "seen/overlap_f": "seen F",
    "unseen/overlap_f": "unseen F",
    "hm/overlap_precision": "HM P",
    "hm/overlap_recall": "HM R",
    "hm/overlap_f": "HM F",
    "hm/boundary_f": "HM boundary F",
    "all/overlap_f": "all F",
    "all/f75": "all F@.75",
    "all/boundary_f": "all boundary F",
    "unaided/overlap_f": "unaided F",
    "unaided/f75": "unaided F@.75",
    "unaided/boundary_f": "unaided boundary F",
}
"""Scores of the Markdown table; the CSV file holds all."""

MODEL, BASELINE, LABEL_IMAGES = "model", "baseline", "label images"


@dataclass(frozen=True)
class Judged:
    """One method's results on the frames.

    Attributes:
        name: What the method is called.
        kind: A trained model, a baseline, or a folder of label images.
        evaluation: Its scores.
        failures: What went wrong, frame by frame.
        predict: Frame to the objects that count, int32 [H, W], 0 = not an object. For a method that does not say what
            an object is, the truth has said it.
        aided: Whether it has.
        segmenter: Of a trained model.
    """

    name: str
    kind: str
    evaluation: Evaluation
    failures: list[Failures]
    predict: Callable[[Frame], npt.NDArray[np.int32]]
    aided: bool
    segmenter: Segmenter | None = None

    @property
    def ranking(self) -> list[str]:
        """Names of the frames, the one with the worst overlap F first."""
        frames = self.evaluation.frames
        column = "overlap_f_measure" if self.aided else "unaided_overlap_f_measure"
        return [str(name) for name in frames[column].sort_values(kind="stable").index]


def load_segmenters(config: DictConfig) -> dict[str, Segmenter]:
    """Load the models that are compared.

    Args:
        config: With `checkpoints` (files or folders of trainings by name), `output_dir` and `trust`.
    """
    trust = tuple(config.trust)
    return {
        str(name): Segmenter(Checkpoint.load(find_checkpoint(path, config.output_dir), trust), trust=trust)
        for name, path in (config.checkpoints or {}).items()
    }


def load_methods(config: DictConfig) -> dict[str, LabelMapMethod]:
    """Make the baselines, and open the folders of label images, that are compared.

    Args:
        config: With `baseline` (classes by name), `predictions` (folders by name) and `first_object`.

    Raises:
        ConfigurationError: If two methods have one name.
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
        config: With the keys of conf/compare.yaml.
        source: The frames.
        workers: Processes.

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
        predict = method if method.decides_objects else _ChosenByTruth(method)
        judged.append(Judged(name, kind, found.evaluation, found.failures, predict, not method.decides_objects))
    return judged


def judge_model(name: str, segmenter: Segmenter, source: FrameSource, config: DictConfig, workers: int) -> Judged:
    """Score a trained model on prepared graphs, as `python -m sgbd.evaluate` does.

    Args:
        name: What to call it.
        segmenter: The model.
        source: The frames.
        config: With `cache_dir`, `on_error` and `boundaries`.
        workers: Processes that prepare graphs.
    """
    prepared = graphs_for(segmenter, source, config.cache_dir, workers, config.on_error)
    dataset = with_truth(prepared, config.on_error)
    evaluator = Evaluator(
        segmenter.partition, segmenter.rule, boundaries=config.boundaries, calibration=segmenter.calibration
    )
    has_head = segmenter.objectness is not None
    scored, failures = [], []
    with torch_threads(1):
        for data in tqdm(dataset, name, unit="frame"):
            classification = classify(segmenter.model, segmenter.objectness, data)
            segments = partition_graph(data, classification, segmenter.partition, segmenter.rule, segmenter.calibration)
            scored.append(evaluator.score(data, segments, dataset.category_names, unaided=has_head))
            overlaps = (data.overlap_index.numpy(), data.overlap_instance.numpy(), data.overlap_count.numpy())
            table = ContingencyTable.from_superpixels(*overlaps, segments.segment)
            objects = np.nonzero(segments.is_object)[0] if has_head else objects_by_majority(table)
            oracle = oracle_table(*overlaps, len(segments.segment))
            failures.append(classify_failures(table, objects, oracle, data.name))
    predict: Callable[[Frame], npt.NDArray[np.int32]] = _Instances(segmenter)
    if not has_head:
        predict = _ChosenByTruth(predict)
    return Judged(name, MODEL, mean_scores(scored, dataset.seen), failures, predict, not has_head, segmenter)


class _Instances:
    """What a segmenter takes for objects."""

    def __init__(self, segmenter: Segmenter) -> None:
        self.segmenter = segmenter

    def __call__(self, frame: Frame) -> npt.NDArray[np.int32]:
        return self.segmenter.segment_frame(frame).instances


class _ChosenByTruth:
    """The segments of a method most of which lies on true objects."""

    def __init__(self, method: Callable[[Frame], npt.NDArray[np.int32]]) -> None:
        self.method = method

    def __call__(self, frame: Frame) -> npt.NDArray[np.int32]:
        segments = self.method(frame)
        chosen = objects_by_majority(ContingencyTable.from_label_maps(segments, frame.instances))  # type: ignore[arg-type]
        return np.where(np.isin(segments, chosen), segments, 0).astype(np.int32)


def score_rows(judged: Sequence[Judged]) -> pd.DataFrame:
    """Arrange the scores of methods: a row a method, with `kind`, `frames` and every score as `protocol/score`.

    Args:
        judged: The methods.

    Returns:
        The table, indexed by method; shares from 0 to 1, NaN where a method has no such score.
    """
    rows = [{"kind": one.kind, "frames": len(one.evaluation.frames), **one.evaluation.scores} for one in judged]
    return pd.DataFrame(rows, index=pd.Index([one.name for one in judged], name="method"))


def score_markdown(rows: pd.DataFrame) -> str:
    """Return the scores that people compare, in per cent, as a Markdown table.

    Args:
        rows: As of `score_rows`.
    """
    shown = {score: title for score, title in SHOWN.items() if score in rows}
    cells = (100 * rows[list(shown)]).map(lambda value: "–" if np.isnan(value) else f"{value:.1f}")
    cells = cells.rename(columns=shown)
    cells.insert(0, "frames", rows["frames"].astype(str))
    cells.index.name = "method"
    return cells.to_markdown(disable_numparse=True, colalign=["left"] + ["right"] * len(cells.columns))


def write_scores(judged: Sequence[Judged], folder: Path) -> str:
    """Write `comparison.csv`, `comparison.md` and, for each method, the files of an evaluation.

    Args:
        judged: The methods.
        folder: Where to.

    Returns:
        The Markdown table.
    """
    rows = score_rows(judged)
    for one in judged:
        write_evaluation(one.evaluation, folder / "methods" / one.name)
    write_whole(folder / "comparison.csv", rows.to_csv().encode())
    table = score_markdown(rows)
    write_whole(folder / "comparison.md", f"{table}\n".encode())
    return table


def write_failures(judged: Sequence[Judged], source: FrameSource, folder: Path, worst: int) -> str:
    """Write what went wrong: `failures.csv`, `failures.md` with pictures of the worst frames, and a table each.

    Args:
        judged: The methods.
        source: The frames.
        folder: Where to.
        worst: How many frames of each method to draw, those with most failures.

    Returns:
        The Markdown table of the counts.
    """
    counts = pd.DataFrame(
        [failure_counts(one.failures) for one in judged], index=pd.Index([one.name for one in judged], name="method")
    )
    write_whole(folder / "failures.csv", counts.to_csv().encode())
    table = counts.to_markdown()
    lines = [
        "# Failures by kind",
        "Every true object that was not found (F of its match at most 0.75) is counted once, by what spoils it most; "
        f"*{TABLE_AS_OBJECT}* counts predicted objects. See `sgbd.failures.classify_failures`. A method that does not "
        "say what an object is (“aided”) had its objects chosen by the truth, and so no false ones.",
        table,
    ]
    frames = _frames_by_name(source)
    for one in judged:
        ranked = failure_table(one.failures)
        write_whole(folder / "methods" / one.name / "failures.csv", ranked.to_csv().encode())
        by_name = {failures.name: failures for failures in one.failures}
        lines.append(f"## {one.name}" + (" (aided)" if one.aided else ""))
        for name in ranked.index[:worst]:
            frame, failures = frames(name), by_name[name]
            figure = worst_frame_figure(frame, one.predict(frame), failures)
            path = write_figure(figure, folder / "failures" / one.name / f"{name.replace('/', '_')}.png")
            kinds = ", ".join(f"{failures.count(kind)} {kind}" for kind in _kinds_of(failures))
            lines.append(f"`{name}`, {failures.objects} objects: {kinds or 'no failure'}")
            lines.append(f"![{name}]({path.relative_to(folder).as_posix()})")
    write_whole(folder / "failures.md", ("\n\n".join(lines) + "\n").encode())
    return table


def _kinds_of(failures: Failures) -> list[str]:
    kinds = sorted(set(failures.kind_of_object.values()), key=lambda kind: -failures.count(kind))
    return [*kinds, *([TABLE_AS_OBJECT] if failures.false_objects else [])]


def write_grids(judged: Sequence[Judged], source: FrameSource, folder: Path, count: int) -> list[Path]:
    """Draw figure grids of the best, the middling and the worst frames.

    Args:
        judged: The methods. Those frames are chosen that are the first model's (or the first method's) best, median and
            worst.
        source: The frames.
        folder: Where to.
        count: Frames of each of the three.

    Returns:
        The files: for each model its frames with superpixels, edge probabilities, prediction and truth; and
        `methods.png`, the predictions of all methods side by side.
    """
    frames = _frames_by_name(source)
    paths = []
    for one in judged:
        if one.segmenter is None:
            continue
        chosen = best_median_worst(one.ranking, count)
        rows = [(f"{place}: {_score(one, name)}", frames(name)) for name, place in chosen.items()]
        segmented = [(title, frame, one.segmenter.segment_frame(frame)) for title, frame in rows]
        paths.append(write_figure(frames_figure(segmented), folder / "pictures" / f"{one.name}.png"))
    chosen = best_median_worst(judged[0].ranking, count)
    rows = [(place, frames(name)) for name, place in chosen.items()]
    predictions = {
        one.name + (" (aided)" if one.aided else ""): [one.predict(frame) for _, frame in rows]
        for one in judged
        # Label images may lack for a frame that the first method has.
        if all(name in one.evaluation.frames.index for name in chosen)
    }
    paths.append(write_figure(methods_figure(rows, predictions), folder / "pictures" / "methods.png"))
    return paths


def best_median_worst(ranking: Sequence[str], count: int) -> dict[str, str]:
    """Choose frames from both ends and the middle of a ranking.

    Args:
        ranking: Names, the worst first.
        count: How many of each; fewer if there are not three times as many.

    Returns:
        "best", "median" or "worst" by name, the best first.
    """
    last, middle = len(ranking) - 1, (len(ranking) - 1) / 2
    places = {"best": range(last, -1, -1), "median": sorted(range(last + 1), key=lambda k: abs(k - middle))}
    chosen: dict[str, str] = {}
    # Worst before median: of few frames the ends matter more.
    for place, order in (("best", places["best"]), ("worst", range(last + 1)), ("median", places["median"])):
        free = [ranking[k] for k in order if ranking[k] not in chosen]
        chosen |= dict.fromkeys(free[:count], place)
    rank = {name: k for k, name in enumerate(ranking)}
    return {name: chosen[name] for name in sorted(chosen, key=lambda name: -rank[name])}


def _score(one: Judged, name: str) -> str:
    column = "overlap_f_measure" if one.aided else "unaided_overlap_f_measure"
    return f"F {100 * one.evaluation.frames[column][name]:.1f}"


def _frames_by_name(source: FrameSource) -> Callable[[str], Frame]:
    index = {name: place for place, name in enumerate(source.names)}
    return lambda name: source[index[name]]
