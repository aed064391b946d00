from __future__ import annotations

import pytest

from sgbd.benchmarking.timing import Ratio, Stopwatch, Timing, take_turns


def test_median_and_percentiles_in_milliseconds():
    timing = Timing.of([(k / 1000, 2 * k / 1000) for k in range(11)])
    assert timing == Timing(median=5.0, p10=1.0, p90=9.0, cpu=10.0, repeats=11)
    assert timing.row() == {"median_ms": 5.0, "p10_ms": 1.0, "p90_ms": 9.0, "cpu_ms": 10.0, "repeats": 11}


def test_nothing_measured():
    with pytest.raises(ValueError, match="repeats must be at least 1"):
        Timing.of([])


def test_a_stopwatch_keeps_the_order_of_its_steps_and_sums_repetition_by_repetition():
    stopwatch = Stopwatch()
    stopwatch.seconds = {"b": [(1.0, 0.5), (2.0, 1.0)], "a": [(3.0, 3.0), (1.0, 1.0)]}
    assert list(stopwatch.timings()) == ["b", "a"]
    # 1 + 3 and 2 + 1: the median of the sums, not the sum of the medians.
    assert stopwatch.sums(["a", "b"]).median == pytest.approx(3500)
    assert stopwatch.sums(["a", "b"]).cpu == pytest.approx(2750)


def test_sums_need_steps_of_the_same_repetitions():
    stopwatch = Stopwatch()
    stopwatch.seconds = {"b": [(1.0, 0.5)], "a": []}
    with pytest.raises(ValueError):
        stopwatch.sums(["a", "b"])


def test_a_step_that_fails_does_not_count():
    stopwatch = Stopwatch()
    with pytest.raises(KeyError), stopwatch.step("a"):
        raise KeyError
    assert stopwatch.seconds == {}


def test_ratios_are_taken_in_pairs():
    ratio = Ratio.of([(2.0, 1.0), (30.0, 9.0), (4.0, 2.0)], [(1.0, 1.0), (10.0, 3.0), (1.0, 1.0)])
    assert (ratio.median, ratio.cpu) == (3.0, 2.0)
    assert ratio.p10 < ratio.median < ratio.p90


def test_methods_take_turns():
    calls: list[tuple[str, int]] = []
    methods = {name: lambda number, name=name: calls.append((name, number)) for name in ("a", "b")}
    stopwatch = take_turns(methods, range(3), warm_up=2)
    warm_up, measured = calls[:4], calls[4:]
    assert sorted(warm_up) == [("a", 0), ("a", 1), ("b", 0), ("b", 1)]
    assert measured == [("a", 0), ("b", 0), ("b", 1), ("a", 1), ("a", 2), ("b", 2)]
    assert {name: len(seconds) for name, seconds in stopwatch.seconds.items()} == {"a": 3, "b": 3}
