from __future__ import annotations

import json
import math

import pytest
from PIL import Image

from sgbd.benchmark import run_benchmark
from sgbd.benchmarking import fresh_process, sections
from sgbd.benchmarking.checkpoints import configured_checkpoint
from sgbd.benchmarking.curves import draw_curves
from sgbd.benchmarking.evaluation_speed import STAGES as EVALUATION_STAGES
from sgbd.benchmarking.extent import SHORT, Extent
from sgbd.benchmarking.frames import made_up_scene
from sgbd.benchmarking.reference import STAGES as REFERENCE_STAGES
from sgbd.benchmarking.sections import SECTIONS
from sgbd.jobs.configuration import ConfigurationError
from tests.benchmarking.configured import small_benchmark

SPREAD = {"median_ms", "p10_ms", "p90_ms", "cpu_ms", "repeats"}
COLUMNS = {
    "frame": SPREAD | {"n", "nodes", "edges", "stage"},
    "reference_stages": SPREAD | {"stage"},
    "reference": SPREAD | {"method", "ratio", "ratio_p10", "ratio_p90", "ratio_cpu"},
    "memory": {
        *("method", "frames", "imports_mib", "model_mib", "numba_start_mib", "first_frame_mib", "steady_mib"),
        *("peak_mib", "growth_kib_per_frame"),
    },
    "first_call": {
        *("cache", "imports_s", "imports_cpu_s", "model_s", "first_frame_s", "first_frame_cpu_s", "later_frame_s"),
        *("first_call_s", "process_s"),
    },
    "prepare": {
        *("superpixels", "workers", "frames", "seconds", "seconds_to_first_graph", "frames_per_second_then"),
        *("seconds_per_frame_and_core", "cpu_seconds_per_frame", "read_ms", "superpixels_ms", "graph_ms", "write_ms"),
        *("worker_resident_mib", "worker_own_mib", "main_process_mib"),
    },
    "curve_size": SPREAD | {"width", "height"},
    "curve_n": SPREAD | {"n"},
    "curve_frames": set(sections.CURVE_COLUMNS),
    "train": {
        *("graphs", "nodes", "edges", "epochs", "seconds", "cpu_seconds", "median_epoch_seconds", "graphs_per_second"),
        *("in_memory", "before_mib", "peak_mib"),
    },
    "evaluate": SPREAD | {"stage"},
}


def check_numbers(rows) -> None:
    for row in rows:
        for key, value in row.items():
            if isinstance(value, float) and key != "growth_kib_per_frame":
                assert math.isfinite(value), (key, row)
                assert value >= 0 or key.endswith("_mib"), (key, row)


@pytest.fixture
def fresh_starts(monkeypatch) -> list[dict[str, str]]:
    """Run the jobs of fresh processes in this process, where everything is imported, and record their environments."""
    environments = []

    def do_here(job, environment=None):
        environments.append(dict(environment or {}))
        found = fresh_process.do_job(**job)
        return json.loads(json.dumps({**found, "process_seconds": found["import_seconds"] + 60}))

    monkeypatch.setattr(sections, "in_fresh_process", do_here)
    return environments


def test_all_sections_in_their_order_with_their_columns(capsys, fresh_starts, monkeypatch, tmp_path):
    monkeypatch.setattr(sections, "WIDTHS", (32, 64))
    monkeypatch.setattr(sections, "NUMBERS", (8, 16, 24))
    with small_benchmark("n=[16,24]") as config:
        report = run_benchmark(config)
    assert [table.name for table in report.tables] == list(COLUMNS)
    content = json.loads(json.dumps(report.json(), allow_nan=False))
    for name, table in content["tables"].items():
        check_numbers(table["rows"])
        assert all(set(row) == COLUMNS[name] for row in table["rows"]), name
    tables = {name: table["rows"] for name, table in content["tables"].items()}

    assert [row["n"] for row in tables["frame"] if row["stage"] == "whole frame"] == [16, 24]
    assert [row["stage"] for row in tables["reference_stages"]] == [*REFERENCE_STAGES, "sum of stages"]
    assert {row["repeats"] for row in tables["reference_stages"]} == {2}
    assert [row["method"] for row in tables["reference"]] == ["ours", "scikit_image", "reference"]
    assert tables["reference"][0]["ratio"] == 1
    assert [(row["method"], row["frames"]) for row in tables["memory"]] == [("ours", 4), ("reference", 2)]
    assert all(row["imports_mib"] > 50 for row in tables["memory"])
    assert [row["cache"] for row in tables["first_call"]] == ["cold", "warm"]
    assert all(row["process_s"] > row["first_call_s"] for row in tables["first_call"])
    *memory, cold, warm = fresh_starts
    assert memory == [{}, {}, {}]  # ours runs once before the measurement, so that everything is compiled
    # Both use the same separate folder, so that the second process finds it filled.
    assert set(cold) == {"NUMBA_CACHE_DIR"}
    assert cold == warm
    assert [(row["superpixels"], row["frames"]) for row in tables["prepare"]] == [("FastSlic", 3), ("Slic", 1)]
    assert [(row["width"], row["height"]) for row in tables["curve_size"]] == [(32, 24), (64, 48)]
    assert [row["n"] for row in tables["curve_n"]] == [8, 16, 24]
    assert [row["frames"] for row in tables["curve_frames"]] == [1, 1, 1, 3]
    draw_curves(report, tmp_path / "curves.png")
    assert Image.open(tmp_path / "curves.png").size == (1440, 456)
    assert (tables["train"][0]["graphs"], tables["train"][0]["epochs"]) == (5, 2)
    assert [row["stage"] for row in tables["evaluate"]][:4] == list(EVALUATION_STAGES)
    assert tables["evaluate"][0]["repeats"] == 3  # one pass over three frames

    printed = capsys.readouterr().out
    assert "2 made-up scenes, seed 0" in printed
    assert "untrained weights" in printed
    assert all(table["title"] in printed for table in content["tables"].values())


def test_comparing_takes_turns_and_measures_nothing_else(capsys):
    with small_benchmark("compare=[slic_fast,superpixels/slic_reference]", "n=[16,24]") as config:
        report = run_benchmark(config)
    assert [table.name for table in report.tables] == ["compare_n16", "compare_n24"]
    first, second = report.tables[0].rows
    assert (first["method"], second["method"]) == ("slic_fast", "superpixels/slic_reference")
    assert first["ratio"] == 1
    assert first["repeats"] == second["repeats"] == 3
    assert "ratios of times to those of slic_fast" in capsys.readouterr().out


def test_a_trained_model_is_measured_as_such(tmp_path, capsys):
    path = tmp_path / "checkpoint.safetensors"
    with small_benchmark() as config:
        configured_checkpoint(config).save(path)
    with small_benchmark(f"checkpoint={path}", "sections=[frame]", "n=null") as config:
        report = run_benchmark(config)
    assert f"weights of {path}" in capsys.readouterr().out
    assert {row["n"] for row in report.tables[0].rows} == {128}
    assert report.settings["checkpoint"] == str(path)


def test_the_short_extent_gives_way_to_what_is_configured():
    unset = [f"{name}=null" for name in vars(SHORT)]
    with small_benchmark("sections=[frame]", "short=true", *unset, "repeats=2") as config:
        report = run_benchmark(config)
    assert {row["repeats"] for row in report.tables[0].rows} == {2}
    assert {name: report.settings[name] for name in vars(SHORT)} == {**vars(SHORT), "repeats": 2}
    assert all(value <= vars(Extent())[name] for name, value in vars(SHORT).items())


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("sections=[frame,speed]", f"sections must be a list of {', '.join(SECTIONS)}; got speed"),
        ("sections=[]", "sections must be a list of .*; got none"),
        ("compare=[ours]", r"compare must name two methods, for example \[ours,reference\]; got \['ours'\]"),
        ("compare=[ours,ours]", "compare needs two different methods; got 'ours' twice"),
        ("compare=[ours,theirs]", "there is no method 'theirs' to compare; choose ours, reference, scikit_image"),
        ("size=[64]", r"size must be \[width, height\]"),
        ("n=[16,0]", r"n must be a number from 1, or a list such as \[128,256,512\]; got \[16, 0\]"),
        ("repeats=0", "repeats must be a number from 1; got 0"),
        ("threads=0", "threads must be from 1 to"),
        ("frame_count=0", "frame_count must be at least 1"),
    ],
)
def test_bad_options(override, message):
    with small_benchmark(override) as config, pytest.raises(ConfigurationError, match=message):
        run_benchmark(config)


def test_a_process_of_its_own(tmp_path):
    fresh_process.save_frames([made_up_scene(64, 48, seed) for seed in range(2)], tmp_path / "frames.npz")
    job = {"method": "reference", "frames": str(tmp_path / "frames.npz"), "n": 16, "count": 3}
    found = fresh_process.in_fresh_process({**job, "checkpoint": "", "trust": [], "torch_threads": 1})
    assert len(found["frame_seconds"]) == len(found["frame_cpu_seconds"]) == len(found["frame_mib"]) == 3
    assert found["import_seconds"] + found["load_seconds"] + sum(found["frame_seconds"]) < found["process_seconds"]
    assert 50 < found["imports_mib"] < found["frame_mib"][0] + 1
    assert found["numba_mib"] - found["model_mib"] < 1
    found = fresh_process.in_fresh_process(
        {**job, "checkpoint": "", "trust": [], "torch_threads": 1, "count": 1, "numba_apart": True}
    )
    assert found["numba_mib"] - found["model_mib"] > 4


def test_a_fresh_process_that_fails_says_why(tmp_path):
    job = {"method": "ours", "frames": str(tmp_path / "none.npz"), "n": 16, "count": 1, "torch_threads": 1}
    with pytest.raises(RuntimeError, match=r"(?s)fresh start failed.*missing 2 required positional arguments"):
        fresh_process.in_fresh_process(job)
