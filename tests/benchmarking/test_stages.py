from __future__ import annotations

import numpy as np
import pytest

from sgbd.benchmarking.checkpoints import configured_segmenter
from sgbd.benchmarking.frames import made_up_scene
from sgbd.benchmarking.stages import (
    AFTER_SUPERPIXELS,
    GRAPH_PARTS,
    STAGES,
    SUM,
    SUPERPIXEL_PARTS,
    WHOLE,
    measure_stages,
    one_modality,
    segment_in_stages,
    stage_rows,
)
from sgbd.benchmarking.timing import Stopwatch
from sgbd.superpixels import Slic
from tests.benchmarking.configured import small_benchmark


@pytest.mark.parametrize("overrides", [[], ["features=all", "model=gated_gcn", "partition=multicut"], ["reduce=2"]])
def test_the_stages_are_what_the_segmenter_does(overrides):
    raw, stopwatch = made_up_scene(64, 48, 0), Stopwatch()
    with small_benchmark(*overrides) as config:
        chosen = configured_segmenter(config, 16)
    result = segment_in_stages(chosen, raw, stopwatch)
    expected = chosen.segment(raw.rgb, raw.depth, raw.intrinsics)
    for name in ("instances", "scores", "objectness", "superpixels", "edge_index", "edge_probability"):
        assert np.array_equal(getattr(result, name), getattr(expected, name)), name
    assert tuple(stopwatch.seconds) == STAGES


def test_rows_hold_every_stage_its_parts_below_it_and_consistent_sums():
    with small_benchmark() as config:
        chosen = configured_segmenter(config, 16)
    stopwatch = measure_stages(chosen, [made_up_scene(64, 48, seed) for seed in range(2)], range(5))
    rows = {row["stage"]: row for row in stage_rows(stopwatch)}
    parts = [f"- {part}" for part in (*SUPERPIXEL_PARTS, *GRAPH_PARTS)]
    assert list(rows) == [
        *STAGES[:2],
        *parts[:2],
        STAGES[2],
        *parts[2:],
        *STAGES[3:],
        AFTER_SUPERPIXELS,
        SUM,
        WHOLE,
    ]
    assert {row["repeats"] for row in rows.values()} == {5}
    for row in rows.values():
        assert 0 <= row["p10_ms"] <= row["median_ms"] <= row["p90_ms"]
    totals = [sum(stopwatch.seconds[stage][k][0] for stage in STAGES) for k in range(5)]
    assert rows[SUM]["median_ms"] == pytest.approx(1000 * np.median(totals))
    behind = [sum(stopwatch.seconds[stage][k][0] for stage in STAGES[2:]) for k in range(5)]
    assert rows[AFTER_SUPERPIXELS]["median_ms"] == pytest.approx(1000 * np.median(behind))


def test_one_modality_leaves_the_original_as_it_is():
    both = Slic(16)
    singles = one_modality(both)
    assert {name: (single.rgb, single.depth) for name, single in singles.items()} == {
        "colours alone": (True, False),
        "depth alone": (False, True),
    }
    assert (both.rgb, both.depth) == (True, True)
    assert one_modality(Slic(16, depth=False)) == {}
    assert one_modality(lambda frame: None) == {}
