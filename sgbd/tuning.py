"""Tuning of the parameters of partitioner and object rule on validation frames."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from torch import nn
from torch_geometric.data import Data

from sgbd.calibration import ScoreCalibration, right_segments, segment_features
from sgbd.checkpoint import instantiate
from sgbd.machine.torch_threads import torch_threads
from sgbd.partition import Partitioner
from sgbd.recipe import describe
from sgbd.reporting.score_titles import score_title
from sgbd.scored_partition import ScoredGraph
from sgbd.segmentation import ObjectRule, classify

log = logging.getLogger(__name__)

TUNING_FILE = "tuning.csv"
"""File name, in the folder of a training, of the table of all evaluated settings."""

OVERLAP_SCORES = ("overlap_f", "f75")
SCORES = (*OVERLAP_SCORES, "boundary_f")
PARTITION_PARAMETERS = ("threshold", "border_weight", "objectness_weight")
RULE_PARAMETERS = ("min_objectness", "min_area")

Setting = dict[str, Any]
MakePartitioner = Callable[[Mapping[str, Any]], Partitioner]
MakeRule = Callable[[Mapping[str, Any]], ObjectRule]


@dataclass(frozen=True, eq=False)
class TuningResult:
    """The result of a search.

    Attributes:
        partition: Configuration of the best partitioner.
        objects: Configuration of the best object rule.
        summary: Summary for the recipe of a checkpoint: protocol, averaged scores, number of frames, and the mean score
            before and after tuning.
        calibration: Configuration of the score calibration; None if it was not requested or could not be fitted.
        table: One row per evaluated setting, the best first. Only finalists have a `boundary_f`.
    """

    partition: dict[str, Any]
    objects: dict[str, Any]
    summary: dict[str, Any]
    calibration: dict[str, Any] | None
    table: pd.DataFrame

    @property
    def sections(self) -> dict[str, Any]:
        """The sections to replace in the recipe of a checkpoint.

        They include the calibration even if it is None, because an earlier one was fitted with other thresholds.
        """
        return {
            "partition": self.partition,
            "objects": self.objects,
            "tuning": self.summary,
            "calibration": self.calibration,
        }


@dataclass(frozen=True)
class Tuning:
    """A search over the parameters of the partitioner and of the object rule.

    It maximises the mean of overlap F, F@.75 and boundary F on the validation frames. With an objectness head, the
    protocol is `unaided`; without one it is `all`, which needs no object rule.

    The search first evaluates all combinations of the given values. Each of the following rounds evaluates values
    half-way between the best value and its neighbours among the values tried. These steps do not score contours, which
    would take most of the time. Finally the finalists are compared with contours. The initial setting is one of them,
    so on these frames the result is never worse. The networks process each graph once, and each partition is scored
    once, whatever the number of rules. The search is deterministic.

    Attributes:
        threshold: Merge probabilities to try as the partitioner's threshold.
        border_weight: Values to try for the partitioner.
        objectness_weight: Values to try for the partitioner; only with an objectness head.
        min_objectness: Values to try for the object rule; only with an objectness head.
        min_area: Values to try for the object rule, pixels; only with an objectness head.
        rounds: Rounds of refinement of all numeric parameters.
        finalists: Number of settings that are compared with contours, besides the initial one.
        calibrate: Whether to calibrate the scores with the best setting; only with an objectness head. See
            `sgbd.calibration`.
    """

    threshold: Sequence[float] = (0.1, 0.3, 0.5, 0.7, 0.9)
    border_weight: Sequence[str] = ("length", "log", "none")
    objectness_weight: Sequence[float] = (0.0, 1.0)
    min_objectness: Sequence[float] = (0.2, 0.5, 0.8)
    min_area: Sequence[int] = (50, 150, 400)
    rounds: int = 2
    finalists: int = 3
    calibrate: bool = True

    def __post_init__(self) -> None:
        """Validate the parameters.

        Raises:
            ValueError: If a parameter has no values to try, or a number is out of range.
        """
        for name in (*PARTITION_PARAMETERS, *RULE_PARAMETERS):
            values = getattr(self, name)
            if isinstance(values, str) or not len(values):
                raise ValueError(f"tuning.{name} must be a list of values to try; got {values!r}")
        if self.rounds < 0 or self.finalists < 1:
            raise ValueError(
                f"tuning.rounds must be at least 0 and tuning.finalists at least 1; got {self.rounds} and "
                f"{self.finalists}"
            )

    def __call__(
        self,
        graphs: Iterable[Data],
        model: nn.Module,
        objectness: nn.Module | None,
        partition: Mapping[str, Any],
        objects: Mapping[str, Any],
        trust: Sequence[str] = (),
    ) -> TuningResult:
        """Search for the best parameters.

        Args:
            graphs: Validation graphs with ground truth and packed maps.
            model: The edge model, in evaluation mode.
            objectness: The objectness head in evaluation mode, or None.
            partition: Configuration of the partitioner with the initial values. Those of the parameters above that its
                class has are tuned; all others stay.
            objects: Configuration of the object rule with the initial values; tuned in the same way.
            trust: Names of packages besides `sgbd` whose classes the configurations may name.

        Returns:
            The best configurations and the table of all evaluated settings.

        Raises:
            ValueError: If there are no graphs, or one has no ground truth.
        """
        classified = _classified(graphs, model, objectness)

        def partitioner(setting: Mapping[str, Any]) -> Partitioner:
            chosen = {**partition, **_only(PARTITION_PARAMETERS, setting)}
            made: Partitioner = instantiate(chosen, object, trust)  # type: ignore[assignment]
            return made

        def rule(setting: Mapping[str, Any]) -> ObjectRule:
            return instantiate({**objects, **_only(RULE_PARAMETERS, setting)}, ObjectRule, trust)

        start = {name: getattr(partitioner({}), name, None) for name in PARTITION_PARAMETERS}
        if objectness is None:
            start.pop("objectness_weight")
        else:
            start |= {name: getattr(rule({}), name, None) for name in RULE_PARAMETERS}
        start = {name: value for name, value in start.items() if value is not None}
        search = _Search(classified, partitioner, None if objectness is None else rule)
        best = self._search(search, start)
        before, after = search.tried[_key(start)], search.tried[_key(best)]
        log.info(
            "tuned on %d frames, %s mean of %s: %.4f before (%s), %.4f now (%s)",
            len(classified), search.protocol, ", ".join(map(score_title, SCORES)),
            _mean(before), _as_text(start), _mean(after), _as_text(best),
        )  # fmt: skip
        return TuningResult(
            {**partition, **_only(PARTITION_PARAMETERS, best)},
            {**objects, **_only(RULE_PARAMETERS, best)},
            {
                "protocol": search.protocol,
                "scores": list(SCORES),
                "frames": len(classified),
                "before": _mean(before),
                "after": _mean(after),
            },
            search.calibration(best) if self.calibrate and objectness is not None else None,
            search.table(list(start)),
        )

    def _search(self, search: _Search, start: Setting) -> Setting:
        values = {name: list(dict.fromkeys(getattr(self, name))) for name in start}
        tried = {name: {*values[name], start[name]} for name in start}
        search.score([start])
        search.score(_combinations(values))
        for _ in range(self.rounds):
            best = search.best(1)[0]
            values = {name: _around(best[name], tried[name], whole=name == "min_area") for name in start}
            for name in start:
                tried[name] |= {*values[name]}
            search.score(_combinations(values))
        finalists = search.best(self.finalists)
        # The initial setting comes first, so another one is chosen only if it is better.
        return search.final([start, *(setting for setting in finalists if setting != start)])


def _classified(graphs: Iterable[Data], model: nn.Module, objectness: nn.Module | None) -> list[ScoredGraph]:
    """Run the networks once on every graph; each must have ground truth."""
    classified = []
    with torch_threads(1):
        for data in graphs:
            if "overlap_count" not in data:
                raise ValueError(f"frame {data.name!r} has no ground truth: thresholds cannot be chosen on it")
            classified.append(ScoredGraph(data, classify(model, objectness, data)))
    if not classified:
        raise ValueError("there are no validation graphs to tune on; give the dataset some, or use tuning=none")
    return classified


class _Search:
    """The settings evaluated so far, with their scores.

    Args:
        graphs: Validation graphs.
        partitioner: Returns the partitioner of a setting.
        rule: Returns the object rule of a setting; None lets the ground truth decide what an object is.
    """

    def __init__(self, graphs: Sequence[ScoredGraph], partitioner: MakePartitioner, rule: MakeRule | None) -> None:
        self.graphs = graphs
        self.partitioner = partitioner
        self.rule = rule
        self.protocol = "all" if rule is None else "unaided"
        self.settings: list[Setting] = []
        self.tried: dict[tuple[Any, ...], dict[str, float]] = {}

    def score(self, settings: Iterable[Setting]) -> None:
        """Score settings without contours; settings with the same partition parameters share the partitions."""
        by_partition: dict[tuple[Any, ...], list[Setting]] = {}
        for setting in settings:
            if _key(setting) not in self.tried:
                self.tried[_key(setting)] = {}
                self.settings.append(setting)
                shared = tuple(setting.get(name) for name in PARTITION_PARAMETERS)
                by_partition.setdefault(shared, []).append(setting)
        for group in by_partition.values():
            partitioner = self.partitioner(group[0])
            partitions = [graph.partition(partitioner) for graph in self.graphs]
            for setting in group:
                rule = self._rule(setting)
                rows = [partition.overlap(partition.objects(rule)) for partition in partitions]
                means = np.mean(rows, axis=0)
                self.tried[_key(setting)] = dict(zip(OVERLAP_SCORES, means.tolist(), strict=True))

    def final(self, settings: Sequence[Setting]) -> Setting:
        """Score settings with contours too, and return the best; the first one if several are equal."""
        finalists = [(self.partitioner(setting), self._rule(setting)) for setting in settings]
        rows = []
        for graph in self.graphs:
            label_map, truth = graph.maps()
            partitions = [(graph.partition(partitioner), rule) for partitioner, rule in finalists]
            rows.append([found.boundary_f(found.objects(rule), label_map, truth) for found, rule in partitions])
        for setting, mean in zip(settings, np.mean(rows, axis=0).tolist(), strict=True):
            self.tried[_key(setting)]["boundary_f"] = mean
        return max(settings, key=lambda setting: _mean(self.tried[_key(setting)]))

    def best(self, count: int) -> list[Setting]:
        """Return the settings with the best scores without contours, best first; ties keep the order of evaluation."""
        order = sorted(self.settings, key=lambda setting: -_mean(self.tried[_key(setting)], OVERLAP_SCORES))
        return order[:count]

    def table(self, names: Sequence[str]) -> pd.DataFrame:
        """Return all settings with their scores: first the finalists, then the others, each best first."""
        rows = [{**setting, **self.tried[_key(setting)]} for setting in self.settings]
        frame = pd.DataFrame(rows, columns=[*names, *SCORES])
        frame["mean"] = frame[list(SCORES)].mean(axis=1, skipna=False)
        frame["mean_without_contours"] = frame[list(OVERLAP_SCORES)].mean(axis=1)
        return frame.sort_values(["mean", "mean_without_contours"], ascending=False, kind="stable", ignore_index=True)

    def calibration(self, setting: Setting) -> dict[str, Any] | None:
        """Fit the score calibration on the objects of a setting; return its configuration, or None if impossible."""
        features, right = [], []
        partitioner, rule = self.partitioner(setting), self._rule(setting)
        for graph in self.graphs:
            found, data, known = graph.partition(partitioner), graph.data, graph.classification
            columns = segment_features(
                found.segment,
                data.area.numpy(),
                data.edge_label_index.numpy(),
                known.edge_probability,
                data.border_length.numpy(),
                known.objectness,
            )
            # Objects with ignored pixels only are left out, because it is unknown whether they are right.
            judged = found.objects(rule)
            features.append(columns[judged])
            right.append(right_segments(found.table, len(found.area))[judged])
        try:
            fitted = ScoreCalibration.fit(np.concatenate(features), np.concatenate(right))
        except ValueError as error:
            log.warning("the scores stay uncalibrated: %s", error)
            return None
        described: dict[str, Any] = describe(fitted, "calibration")
        return described

    def _rule(self, setting: Setting) -> ObjectRule | None:
        return None if self.rule is None else self.rule(setting)


def _only(names: Sequence[str], setting: Mapping[str, Any]) -> Setting:
    return {name: value for name, value in setting.items() if name in names}


def _key(setting: Mapping[str, Any]) -> tuple[Any, ...]:
    return tuple(sorted(setting.items()))


def _mean(scores: Mapping[str, float], names: Sequence[str] = SCORES) -> float:
    return sum(scores[name] for name in names) / len(names)


def _as_text(setting: Mapping[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in setting.items())


def _combinations(values: Mapping[str, Sequence[Any]]) -> list[Setting]:
    return [dict(zip(values, combination, strict=True)) for combination in itertools.product(*values.values())]


def _around(best: Any, tried: Iterable[Any], whole: bool) -> list[Any]:
    """Return the best value of a parameter and, if numeric, the midpoints to its neighbours among those tried.

    Args:
        best: The best value.
        tried: All values tried.
        whole: Whether the parameter must be a whole number. Others may be given as one too, such as a weight of 1.
    """
    if isinstance(best, str):
        return [best]
    below = [value for value in tried if value < best]
    above = [value for value in tried if value > best]
    between = [
        (best + neighbor) / 2
        for neighbor in (max(below, default=None), min(above, default=None))
        if neighbor is not None
    ]
    return list(dict.fromkeys([best, *(round(value) if whole else round(value, 6) for value in between)]))
