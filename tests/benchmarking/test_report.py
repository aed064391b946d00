from __future__ import annotations

import json

import pytest

from sgbd.benchmarking.environment import environment, limited_to
from sgbd.benchmarking.report import Report
from sgbd.jobs.configuration import ConfigurationError
from sgbd.machine.processors import usable_processors


def test_tables_are_aligned_and_leave_empty_columns_out():
    report = Report(environment(), {})
    table = report.add(
        "t", "Title", [{"stage": "a", "x_ms": 1.234, "y": None}, {"stage": "bb", "x_ms": 1234.5, "y": None}]
    )
    title, _, header, rule, first, second = table.markdown().splitlines()
    assert title == "Title"
    assert [cell.strip() for cell in header.strip("|").split("|")] == ["stage", "x ms"]
    assert rule.startswith("|:--")
    assert rule.endswith("--:|")
    assert first.split("|")[2].strip() == "1.23"
    assert second.split("|")[2].strip() == "1234"
    assert len({len(line) for line in (header, rule, first, second)}) == 1


def test_missing_values_are_empty():
    rows = [{"a": None, "b": 1}, {"a": 2.0, "b": 2}]
    first = Report(environment(), {}).add("t", "T", rows).markdown().splitlines()[4]
    assert [cell.strip() for cell in first.strip("|").split("|")] == ["", "1"]


def test_the_environment_names_machine_and_versions():
    found = environment()
    assert found["cpu"]
    assert 1 <= found["cores_used"] <= found["cores"]
    assert {"numpy", "numba", "torch", "scikit-image"} <= set(found["versions"])
    assert all(found["versions"][package] for package in ("numpy", "torch", "scikit-image"))
    heading = Report(found, {}, ["a note"]).heading()
    assert found["cpu"] in heading
    assert f"torch {found['versions']['torch']}" in heading
    assert heading.endswith("a note")


def test_both_files_hold_every_table(tmp_path):
    report = Report(environment(), {"seed": 0}, ["a note"])
    report.add("one", "First", [{"stage": "a", "median_ms": 1.5}])
    report.add("two", "Second", [{"method": "b", "ratio": None}])
    report.write(tmp_path / "new" / "r.json", tmp_path / "r.md")
    content = json.loads((tmp_path / "new" / "r.json").read_text())
    assert content["format"] == "sgbd benchmark"
    assert content["format_version"] == 1
    assert content["tables"]["one"] == {"title": "First", "rows": [{"stage": "a", "median_ms": 1.5}]}
    assert content["tables"]["two"]["rows"] == [{"method": "b", "ratio": None}]
    text = (tmp_path / "r.md").read_text()
    assert text.index("First") < text.index("Second")


def test_running_on_fewer_cores():
    cores = usable_processors()
    with limited_to(1, 1):
        assert usable_processors() == cores[:1]
    assert usable_processors() == cores


@pytest.mark.parametrize("threads", [0, 100_000])
def test_cores_that_are_not_there(threads):
    with (
        pytest.raises(ConfigurationError, match=f"threads must be from 1 to .*; got {threads}"),
        limited_to(threads, 1),
    ):
        pass
    with pytest.raises(ConfigurationError, match="torch_threads must be at least 1"), limited_to(None, 0):
        pass
