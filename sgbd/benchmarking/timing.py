"""Repeated timing: wall and processor time, median and spread, of steps in a row and of methods side by side."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Timing:
    """How long something took, over several repetitions, milliseconds.

    Attributes:
        median: Wall time.
        p10: 10th percentile of the wall time.
        p90: 90th percentile of the wall time.
        cpu: Median of the processor time, summed over all threads of the process. On a busy machine it says more than
            the wall time.
        repeats: Number of repetitions.
    """

    median: float
    p10: float
    p90: float
    cpu: float
    repeats: int

    @classmethod
    def of(cls, seconds: Sequence[tuple[float, float]]) -> Timing:
        """Summarise repetitions.

        Args:
            seconds: Wall and processor time of each, seconds.

        Returns:
            The summary.

        Raises:
            ValueError: If there is none.
        """
        if not seconds:
            raise ValueError("nothing was measured: repeats must be at least 1")
        wall, cpu = 1000 * np.asarray(seconds).T
        p10, median, p90 = np.percentile(wall, (10, 50, 90))
        return cls(float(median), float(p10), float(p90), float(np.median(cpu)), len(seconds))

    def row(self) -> dict[str, float]:
        """Return the columns of a report: median_ms, p10_ms, p90_ms, cpu_ms, repeats."""
        return {
            "median_ms": self.median,
            "p10_ms": self.p10,
            "p90_ms": self.p90,
            "cpu_ms": self.cpu,
            "repeats": self.repeats,
        }


class Stopwatch:
    """Collects the times of named steps over many repetitions, in the order in which the steps first come."""

    def __init__(self) -> None:
        self.seconds: dict[str, list[tuple[float, float]]] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time what happens inside; a step that fails is not counted."""
        cpu, wall = time.process_time(), time.perf_counter()
        yield
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        self.seconds.setdefault(name, []).append((wall, cpu))

    def timings(self) -> dict[str, Timing]:
        """Return the summary of each step."""
        return {name: Timing.of(seconds) for name, seconds in self.seconds.items()}

    def sums(self, names: Sequence[str]) -> Timing:
        """Return the summary of the sum of steps that were each taken once a repetition."""
        steps = [self.seconds[name] for name in names]
        return Timing.of([tuple(np.sum(times, axis=0)) for times in zip(*steps, strict=True)])


@dataclass(frozen=True)
class Ratio:
    """How many times as long as another method one took, judged repetition by repetition.

    Methods that take turns meet the same disturbances, so that their ratio is steadier than either of the times.

    Attributes:
        median: Median over the repetitions of the ratio of wall times.
        p10: 10th percentile.
        p90: 90th percentile.
        cpu: Median of the ratio of processor times.
    """

    median: float
    p10: float
    p90: float
    cpu: float

    @classmethod
    def of(cls, seconds: Sequence[tuple[float, float]], base: Sequence[tuple[float, float]]) -> Ratio:
        """Compare the repetitions of a method with those of a base, in pairs.

        Args:
            seconds: Wall and processor time of each repetition, seconds.
            base: The same of the base, as many.

        Returns:
            The ratio.
        """
        wall, cpu = (np.asarray(seconds) / np.maximum(np.asarray(base), 1e-9)).T
        p10, median, p90 = np.percentile(wall, (10, 50, 90))
        return cls(float(median), float(p10), float(p90), float(np.median(cpu)))


def take_turns(methods: Mapping[str, Callable[[int], Any]], repeats: Iterable[int], warm_up: int = 1) -> Stopwatch:
    """Time methods in turns: one repetition of each, then the next, every other time in reverse order.

    Args:
        methods: What to call with the number of the repetition.
        repeats: Numbers of the repetitions, for instance `range(20)`, or a progress bar around it.
        warm_up: Calls of each beforehand that do not count: compilation, caches.

    Returns:
        The times by method.
    """
    stopwatch = Stopwatch()
    for method in methods.values():
        for number in range(warm_up):
            method(number)
    for turn, number in enumerate(repeats):
        for name, method in list(methods.items())[:: 1 if turn % 2 == 0 else -1]:
            with stopwatch.step(name):
                method(number)
    stopwatch.seconds = {name: stopwatch.seconds[name] for name in methods}
    return stopwatch
