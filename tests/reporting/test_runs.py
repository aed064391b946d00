from pathlib import Path

import pytest

from sgbd.jobs.configuration import ConfigurationError
from sgbd.reporting.runs import read_results, read_run
from tests.reporting.result_folders import SCORES, write_run, write_sweep


def test_a_run_with_all_its_files(tmp_path: Path) -> None:
    results = read_results(write_run(tmp_path / "one", {"7": 0.5, "nan": 0.25}, history=True))
    (run,) = results.runs
    assert results.title == run.label == "one"
    assert run.scores == SCORES
    assert run.frames.index.tolist() == ["7", "nan"], "names are text"
    assert run.categories["seen"].tolist() == [True, True, False]
    assert run.history["loss"].tolist() == [0.7, 0.4]
    assert run.outcome == {"parameters": 102785, "best_epoch": 2, "seconds": 9.5}
    assert (run.dataset, run.split) == ("scenes", "test")


def test_the_name_of_a_dataset(tmp_path: Path) -> None:
    run = write_run(tmp_path / "one", {"a": 0.5})
    (run / "config.yaml").write_text("dataset: {_target_: sgbd.sources.Folder, root: /data/mine}\nsplit: val\n")
    assert (read_run(run, "x").dataset, read_run(run, "x").split) == ("mine", "val")
    (run / "config.yaml").unlink()
    assert read_run(run, "x").dataset == "unknown"


def test_runs_are_found_below_and_those_moved_aside_are_not(tmp_path: Path) -> None:
    for name in ("b", "a/c", "earlier-1", ".hidden"):
        write_run(tmp_path / name, {"a": 0.5})
    (tmp_path / "a" / "empty").mkdir()
    assert [run.label for run in read_results(tmp_path).runs] == ["a/c", "b"]


def test_a_sweep_with_failed_jobs(tmp_path: Path) -> None:
    sweep_folder = write_sweep(tmp_path / "ablation", {"rgb": None, "all": "out of memory"})
    results = read_results(sweep_folder)
    (sweep,) = results.sweeps
    assert sweep.jobs["state"].tolist() == ["finished", "finished", "failed", "failed"]
    assert [run.label for run in results.runs] == ["features=rgb, seed=0", "features=rgb, seed=1"]
    # The same sweep as part of a larger folder, next to a separate run.
    write_run(tmp_path / "single", {"a": 0.5})
    labels = [run.label for run in read_results(tmp_path).runs]
    assert labels == ["ablation: features=rgb, seed=0", "ablation: features=rgb, seed=1", "single"]


def test_the_columns_that_a_sweep_chose(tmp_path: Path) -> None:
    folder = write_sweep(tmp_path / "ablation", {"rgb": None})
    (folder / "multirun.yaml").write_text("hydra: {callbacks: {sweep_table: {columns: [all/*], plot: [all/f75]}}}")
    (sweep,) = read_results(folder).sweeps
    assert (sweep.columns, sweep.plot) == (("all/*",), ("all/f75",))


def test_folders_without_results(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="does not exist; expected the folder of a training"):
        read_results(tmp_path / "nowhere")
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match="is a file"):
        read_results(tmp_path / "file")
    with pytest.raises(ConfigurationError, match="there are no results in"):
        read_results(tmp_path)


@pytest.mark.parametrize(
    ("file", "content"),
    [("scores.json", "{"), ("frames.csv", 'name,a\n"x'), ("frames.csv", ""), ("config.yaml", "a: [")],
)
def test_damaged_files_are_named(tmp_path: Path, file: str, content: str) -> None:
    run = write_run(tmp_path / "one", {"a": 0.5})
    (run / file).write_text(content)
    with pytest.raises(ConfigurationError, match=rf"{file} is damaged"):
        read_results(run)
