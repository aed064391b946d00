"""Repeated timing of steps and of methods in turns: median and spread of wall and processor time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Timing:
    """Summary of the times of several repetitions, milliseconds.

    Attributes:
        median: Median wall time.
        p10: 10th percentile of the wall time.
        p90: 90th percentile of the wall time.
        cpu: Median processor time, summed over all threads of the process; more reliable than wall time on a busy
            machine.
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
            seconds: Wall and processor time of each repetition, seconds.

        Returns:
            The summary.

        Raises:
            ValueError: If there are no repetitions.
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
    """Collects the times of named steps over many repetitions, in order of first occurrence."""

    def __init__(self) -> None:
        self.seconds: dict[str, list[tuple[float, float]]] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time the code in the context; a failing step is not counted."""
        cpu, wall = time.process_time(), time.perf_counter()
        yield
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        self.seconds.setdefault(name, []).append((wall, cpu))

    def timings(self) -> dict[str, Timing]:
        """Return the summary of each step."""
        return {name: Timing.of(seconds) for name, seconds in self.seconds.items()}

    def sums(self, names: Sequence[str]) -> Timing:
        """Return the summary of the total time of several steps, each measured once per repetition."""
        steps = [self.seconds[name] for name in names]
        return Timing.of([tuple(np.sum(times, axis=0)) for times in zip(*steps, strict=True)])


@dataclass(frozen=True)
class Ratio:
    """Ratio of a method's time to that of a base method, computed per repetition.

    Methods that take turns suffer the same disturbances, so that their ratio varies less than their times.

    Attributes:
        median: Median ratio of wall times over the repetitions.
        p10: 10th percentile of the ratio of wall times.
        p90: 90th percentile of the ratio of wall times.
        cpu: Median ratio of processor times.
    """

    median: float
    p10: float
    p90: float
    cpu: float

    @classmethod
    def of(cls, seconds: Sequence[tuple[float, float]], base: Sequence[tuple[float, float]]) -> Ratio:
        """Compare the repetitions of a method with those of a base, pair by pair.

        Args:
            seconds: Wall and processor time of each repetition, seconds.
            base: The same for the base method, with the same number of repetitions.

        Returns:
            The ratio.
        """
        wall, cpu = (np.asarray(seconds) / np.maximum(np.asarray(base), 1e-9)).T
        p10, median, p90 = np.percentile(wall, (10, 50, 90))
        return cls(float(median), float(p10), float(p90), float(np.median(cpu)))


def take_turns(methods: Mapping[str, Callable[[int], Any]], repeats: Iterable[int], warm_up: int = 1) -> Stopwatch:
    """Time methods in turns: one repetition of each, then the next, reversing the order every time.

    Args:
        methods: Functions to time, called with the repetition number.
        repeats: Repetition numbers, such as `range(20)`, or a progress bar around them.
        warm_up: Number of uncounted calls of each method beforehand, for compilation and caches.

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
