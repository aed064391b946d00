import math
from pathlib import Path

from sgbd.reporting.runs import read_results, read_run
from sgbd.reporting.tables import (
    category_comparison,
    category_table,
    frame_table,
    jobs_table,
    number,
    overview_table,
    protocol_table,
    score,
    sweep_table,
)
from tests.reporting.result_folders import write_run, write_sweep


def shown(table) -> list[list[str]]:
    return [[title for title, _ in table.columns], *([cell.text for cell in row] for row in table.rows)]


def test_cells_show_per_cent_and_sort_by_the_number() -> None:
    assert (score(0.625).text, score(0.625).key, score(0.625).bar) == ("62.5", "62.5", 62.5)
    assert score(0.5, 0.0125).text == "50.0 ± 1.2"
    assert (score(math.nan).text, score(math.nan).key) == ("–", "")
    assert (number(1234.4).text, number(math.nan).text) == ("1234", "–")


def test_tables_of_a_run(tmp_path: Path) -> None:
    run = read_run(write_run(tmp_path / "one", {"a": 0.5, "b": 0.25, "c": 0.75}), "one")
    assert shown(protocol_table(run)) == [
        ["protocol", "overlap F", "boundary F"],
        ["HM", "50.0", "–"],
        ["all", "62.5", "25.0"],
        ["oracle", "90.0", "–"],
    ]
    assert shown(category_table(run)) == [
        ["category", "group", "frames", "overlap F"],
        ["can", "seen", "3", "50.0"],
        ["mug", "seen", "2", "75.0"],
        ["bowl", "unseen", "1", "25.0"],
    ]
    table = frame_table(run, 2, lambda name: f"place-{name}" if name == "a" else None)
    assert shown(table) == [["frame", "overlap F", "unaided F"], ["b", "25.0", "12.5"], ["a", "50.0", "25.0"]]
    assert [row[0].link for row in table.rows] == [None, "place-a"]
    assert table.note.startswith("The worst 2 of 3 frames")


def test_tables_of_a_sweep(tmp_path: Path) -> None:
    results = read_results(write_sweep(tmp_path / "s", {"rgb": None, "all": None, "depth": "out of memory\nat 3"}))
    (sweep,) = results.sweeps
    table = sweep_table(sweep)
    assert shown(table) == [
        ["features", "jobs", "HM overlap F", "all overlap F", "seconds"],
        ["rgb", "2", "50.5 ± 0.7", "63.0 ± 0.7", "3"],
        ["all", "2", "52.5 ± 0.7", "65.0 ± 0.7", "3"],
        ["depth", "0 of 2", "–", "–", "–"],
    ]
    assert [[cell.best for cell in row] for row in table.rows] == [
        [False] * 5,
        [False, False, True, True, False],
        [False] * 5,
    ]
    assert table.note == "Mean ± sample standard deviation over seeds 0, 1."
    jobs = jobs_table(sweep, {run.label: run.label for run in results.runs})
    assert shown(jobs)[1] == ["0", "rgb", "0", "finished", "50.0", "62.5", "3"]
    assert shown(jobs)[5] == ["4", "depth", "0", "failed: out of memory", "–", "–", "–"]
    assert [row[0].link for row in jobs.rows[3:5]] == ["features=all, seed=1", None]


def test_a_row_that_cannot_run_here_is_not_zero_jobs(tmp_path: Path) -> None:
    folder = write_sweep(tmp_path / "s", {"rgb": None, "dino": "no weights"})
    for path in (folder / ".jobs").iterdir():
        path.write_text(path.read_text().replace('"failed"', '"not run"'))
    (sweep,) = read_results(folder).sweeps
    assert [row[:2] for row in shown(sweep_table(sweep))[1:]] == [["rgb", "2"], ["dino", "not run"]]


def test_tables_that_compare(tmp_path: Path) -> None:
    runs = [read_run(write_run(tmp_path / name, {"a": 0.5}), name) for name in ("x", "y")]
    assert shown(overview_table(runs, {"x": "run-0"}))[1] == [
        *("x", "scenes", "test", "1", "50.0", "62.5", "25.0", "90.0")
    ]
    comparison = category_comparison({"x": [runs[0]], "y": runs})
    assert comparison is not None
    assert shown(comparison)[:2] == [["category", "group", "x", "y"], ["can", "seen", "50.0", "50.0"]]
    assert category_comparison({"x": runs}) is None
