from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from sgbd.jobs.sweep import draw, markdown, read_jobs, summarize, write_table


def record(folder: Path, number: int, state: str, scores=None, error=None, **overrides) -> None:
    seed = overrides.pop("seed", 0)
    job = folder / f"job{number}"
    job.mkdir()
    if scores is not None:
        (job / "result.json").write_text(json.dumps({"scores": scores, "seconds": 10.0 * number}))
    (folder / ".jobs").mkdir(exist_ok=True)
    fields = {"number": number, "overrides": overrides, "seed": seed, "folder": f"job{number}"}
    (folder / ".jobs" / f"{number:05d}.json").write_text(json.dumps({**fields, "state": state, "error": error}))


@pytest.fixture
def sweep(tmp_path):
    record(tmp_path, 0, "finished", {"hm/overlap_f": 0.6, "hm/f75": 0.1}, features="rgb", seed=0, sampler="balanced")
    record(tmp_path, 1, "finished", {"hm/overlap_f": 0.64, "hm/f75": 0.3}, features="rgb", seed=1, sampler="balanced")
    record(tmp_path, 2, "finished", {"hm/overlap_f": 0.7, "hm/f75": None}, features="all", seed=0, sampler="balanced")
    record(tmp_path, 3, "failed", error="out of\nmemory", features="all", seed=1, sampler="balanced")
    record(tmp_path, 4, "unfinished", features="depth", seed=0, sampler="balanced")
    return tmp_path


def test_every_job_is_a_row_in_the_order_of_the_sweep(sweep):
    jobs = read_jobs(sweep)
    assert list(jobs["state"]) == ["finished", "finished", "finished", "failed", "unfinished"]
    assert list(jobs["features"]) == ["rgb", "rgb", "all", "all", "depth"]
    assert list(jobs["seed"]) == ["0", "1", "0", "1", "0"]
    assert list(jobs["hm/overlap_f"].dropna()) == [0.6, 0.64, 0.7]
    assert list(jobs.columns) == [
        *("job", "features", "sampler", "seed", "state", "hm/overlap_f", "hm/f75", "seconds", "error", "folder")
    ]


def test_seeds_are_averaged_and_failures_counted(sweep):
    summary = summarize(read_jobs(sweep))
    assert list(summary["features"]) == ["rgb", "all", "depth"]
    assert "sampler" not in summary
    assert summary["hm/overlap_f"].tolist()[:2] == pytest.approx([0.62, 0.7])
    assert math.isnan(summary["hm/overlap_f"][2])
    assert summary["hm/overlap_f std"][0] == pytest.approx(math.sqrt(8) / 100)
    assert math.isnan(summary["hm/overlap_f std"][1])
    assert summary[["finished", "failed", "unfinished"]].to_numpy().tolist() == [[2, 0, 0], [1, 1, 0], [0, 0, 1]]


def test_markdown_shows_means_deviations_and_reasons(sweep):
    jobs = read_jobs(sweep)
    text = markdown(jobs, summarize(jobs), ["hm/overlap_*", "none/*"])
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()[:5]]
    assert cells[0] == ["features", "jobs", "HM overlap F", "seconds"]
    assert cells[2] == ["rgb", "2", "62.00 ± 2.83", "5 ± 7"]
    assert cells[3] == ["all", "1 finished, 1 failed", "70.00", "20"]
    assert cells[4] == ["depth", "unfinished", "–", "–"]
    assert "All with `sampler=balanced`." in text
    assert "Mean ± sample standard deviation over `seed` 0, 1." in text
    assert "Job 3 (`job3`) failed: out of\n" in text
    assert "Job 4 (`job4`) unfinished\n" in text


def test_tables_and_figure_are_written(sweep):
    write_table(read_jobs(sweep), sweep, columns=["*"], plot=["hm/overlap_f", "absent"])
    assert len(pd.read_csv(sweep / "table.csv")) == 5
    assert (sweep / "table.md").read_text().count("\n|") == 4
    assert (sweep / "table.png").read_bytes().startswith(b"\x89PNG")


def test_a_sweep_without_finished_jobs_has_a_table(tmp_path):
    record(tmp_path, 0, "failed", error="no")
    write_table(read_jobs(tmp_path), tmp_path, columns=["*"], plot=["hm/overlap_f"])
    assert "failed: no" in (tmp_path / "table.md").read_text()
    assert not (tmp_path / "table.png").exists()


@pytest.mark.parametrize(("values", "scale"), [((32, 64, 128, 256), "log"), ((2, 3, 4), "linear")])
def test_a_swept_number_is_the_axis(tmp_path, values, scale):
    for number, value in enumerate(reversed(values)):
        record(tmp_path, number, "finished", {"f": value / 100}, n=str(value))
    figure = draw(summarize(read_jobs(tmp_path)), ["f"])
    (axes,) = figure.axes
    assert axes.get_xscale() == scale
    assert [tick.get_text() for tick in axes.get_xticklabels()] == [str(value) for value in values]
    assert axes.lines[0].get_xdata().tolist() == list(values)
    assert axes.lines[0].get_ydata().tolist() == pytest.approx(values)


def test_named_rows_stand_in_the_order_of_the_sweep(sweep):
    figure = draw(summarize(read_jobs(sweep)), ["hm/overlap_f"])
    (axes,) = figure.axes
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["rgb", "all", "depth"]
    assert axes.yaxis_inverted()


# --- real sweeps: the shipped configuration around a job that only computes a number

PROGRAM = """
import os
from pathlib import Path
from sgbd.jobs.configuration import ConfigurationError, entry_point, output_folder
from sgbd.jobs.job import run_once
from torch.utils.data import DataLoader

def job(config, folder):
    with Path("ran.txt").open("a") as file:
        file.write(f"{folder.parent.name} {config.seed}\\n")
    if config.sampler.positive_share == 0.5 and os.environ.get("FAIL"):
        raise ConfigurationError("half is bad\\nreally")
    # Read in a process, as training does, with whatever launcher.
    score, = DataLoader([(config.sampler.positive_share or 0.8) + config.seed / 100], num_workers=1)
    return {"scores": {"hm/overlap_f": score.item()}}

@entry_point("train")
def main(config):
    return run_once(output_folder(), config, job)

if __name__ == "__main__":
    main()
"""


def launch(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess:
    (folder / "program.py").write_text(PROGRAM)
    variables = {**os.environ, **environment, "HYDRA_FULL_ERROR": "0"}
    command = [sys.executable, "program.py", *arguments]
    return subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True, timeout=300, check=False)


def test_a_sweep_with_a_failing_job_is_repeated_and_extended(tmp_path):
    first = launch(tmp_path, "+experiment=ablate_sampling", FAIL="1")
    sweep = tmp_path / "outputs" / "sweeps" / "ablate_sampling"
    assert first.returncode == 1
    assert "half is bad" in first.stderr
    assert "Traceback" not in first.stderr
    table = pd.read_csv(sweep / "table.csv")
    assert table["state"].tolist() == ["finished", "failed", "finished", "finished"]
    assert table["sampler.positive_share"].astype(object).fillna("null").tolist() == ["null", 0.5, 0.25, 0.1]
    assert "failed: half is bad" in (sweep / "table.md").read_text()

    # Repeated in two processes, only the failed job runs.
    parallel = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
    again = launch(tmp_path, "+experiment=ablate_sampling", "workers=1", *parallel)
    assert again.returncode == 0, again.stderr
    assert not (sweep / "earlier-1").exists()
    ran = (tmp_path / "ran.txt").read_text().splitlines()
    assert len(ran) == 5
    assert ran[-1] == ran[1] == "sampler.positive_share=0.5 0"
    assert pd.read_csv(sweep / "table.csv")["hm/overlap_f"].tolist() == [0.8, 0.5, 0.25, 0.1]

    # With two seeds, the finished seed is reused, and the table of the smaller sweep is kept.
    more = launch(tmp_path, "+experiment=ablate_sampling", "seed=0,1", "sampler.positive_share=0.25,0.1")
    assert more.returncode == 0, more.stderr
    assert len((tmp_path / "ran.txt").read_text().splitlines()) == 7
    lines = (sweep / "table.md").read_text().splitlines()
    assert "25.50 ± 0.71" in lines[2]
    assert "10.50 ± 0.71" in lines[3]
    assert pd.read_csv(sweep / "earlier-1" / "table.csv")["hm/overlap_f"].tolist() == [0.8, 0.5, 0.25, 0.1]


def test_a_sweep_over_experiments_has_a_row_and_folders_for_each(tmp_path):
    (tmp_path / "mine" / "experiment").mkdir(parents=True)
    for name, share in (("few", 0.1), ("many", 0.9)):
        text = f"# @package _global_\nsampler:\n  positive_share: {share}\n"
        (tmp_path / "mine" / "experiment" / f"{name}.yaml").write_text(text)
    run = launch(tmp_path, "-m", "--config-dir", "mine", "+experiment=few,many", "seed=0,1")
    assert run.returncode == 0, run.stderr
    lines = (tmp_path / "outputs" / "sweeps" / "train" / "table.md").read_text().splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")][:3] for line in lines[2:4]]
    assert rows == [["few", "2", "10.50 ± 0.71"], ["many", "2", "90.50 ± 0.71"]]

    # Experiments with names of their own have tables of their own, without jobs of earlier sweeps.
    earlier = tmp_path / "outputs" / "sweeps" / "graph" / ".jobs"
    earlier.mkdir(parents=True)
    (earlier / "sweep.json").write_text(json.dumps({"sweep": "another"}))
    (earlier / "00009.json").write_text("{}")
    run = launch(tmp_path, "-m", "+experiment=graph,ablate_models")
    assert run.returncode == 0, run.stderr
    assert len(pd.read_csv(tmp_path / "outputs" / "sweeps" / "graph" / "table.csv")) == 1
    assert len(pd.read_csv(tmp_path / "outputs" / "sweeps" / "ablate_models" / "table.csv")) == 1
    assert "sweeps/<name of the experiment>/table.md" in run.stdout


def test_what_this_machine_cannot_run_is_reported_and_is_no_failure(sweep):
    record(sweep, 5, "not run", error="no weights here", features="dino", seed=0, sampler="balanced")
    jobs = read_jobs(sweep)
    summary = summarize(jobs)
    assert summary["not run"].tolist() == [0, 0, 0, 1]
    assert math.isnan(summary["hm/overlap_f"][3])
    text = markdown(jobs, summary, ["hm/overlap_*"])
    assert [cell.strip() for cell in text.splitlines()[5].strip("|").split("|")] == ["dino", "not run", "–", "–"]
    assert "Job 5 (`job5`) not run: no weights here\n" in text


def test_rows_without_their_weights_do_not_stop_a_sweep(tmp_path):
    command = [sys.executable, "-m", "sgbd.train", "-m", "features=dino,paper_dino", "dataset=folder", "logger=csv"]
    # The error is raised before frames are searched for.
    (tmp_path / "frames" / "train").mkdir(parents=True)
    for name in ("a_rgb.png", "a_depth.png"):
        (tmp_path / "frames" / "train" / name).touch()
    run = subprocess.run(
        [*command, "dataset.root=frames", "node_block.weights=./nowhere", "name=lacking"],
        cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    table = pd.read_csv(tmp_path / "outputs" / "sweeps" / "lacking" / "table.csv")
    assert table["state"].tolist() == ["not run", "not run"]
    assert "'./nowhere' cannot be read" in table["error"][0] or "needs the package transformers" in table["error"][0]
    assert not list(tmp_path.rglob("result.json"))
