"""The table and the plot of a sweep, with all of its jobs, however they ended."""

from __future__ import annotations

import fnmatch
import io
import logging
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from hydra.core.utils import JobReturn, JobStatus
from hydra.experimental.callback import Callback
from hydra.types import TaskFunction
from omegaconf import DictConfig, OmegaConf

from sgbd import __version__
from sgbd.jobs.configuration import ExpectedError
from sgbd.jobs.job import IMMATERIAL, LOCK_FILE, PLACES, RESULT_FILE, digest, move_aside, read_json, write_json
from sgbd.machine.atomic_file import write_whole
from sgbd.machine.one_process_at_a_time import one_process_at_a_time
from sgbd.reporting.score_titles import score_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

log = logging.getLogger(__name__)

RECORDS_FOLDER = ".jobs"

PER_CENT = 100
"""Factor from scores, which are fractions, to the per cent shown in tables and figures."""


STATES = ("finished", "failed", "unfinished", "not run")
"""Possible states of a job."""


@dataclass(frozen=True)
class NotRun:
    """Returned by a job of a sweep if this machine lacks something that the job needs; this is not a failure.

    Attributes:
        reason: What is missing and what to do.
    """

    reason: str


class SweepTable(Callback):
    """Hydra callback that writes the table of a sweep to the sweep's folder: `table.csv`, `table.md` and `table.png`.

    The table is written after every job, so it exists however the sweep ends. It has rows also for jobs that failed,
    were interrupted or could not run on this machine. Tables of another sweep in the same folder are moved to a
    subfolder `earlier-<n>`.

    Args:
        columns: File name patterns of the scores that the Markdown table shows, in this order. The CSV file contains
            all scores.
        plot: Names of the scores to plot.
        seed: The override over whose values scores are averaged.
        immaterial: Overrides that do not identify a row, such as the number of workers. The experiment does not either
            if it is the name of the outputs.
    """

    def __init__(
        self,
        columns: Sequence[str] = ("*",),
        plot: Sequence[str] = ("seen/overlap_f", "unseen/overlap_f", "hm/overlap_f"),
        seed: str = "seed",
        immaterial: Sequence[str] = (*PLACES, *IMMATERIAL),
    ) -> None:
        self.columns = tuple(columns)
        self.plot = tuple(plot)
        self.seed = seed
        self.immaterial = tuple(immaterial)
        self.sweep: str | None = None
        self.folder: Path | None = None

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Identify the sweep, and move the table of another sweep aside."""
        settings = config.hydra
        values = OmegaConf.to_container(config, resolve=False, enum_to_str=True)
        assert isinstance(values, dict)
        for key in ("hydra", *PLACES, *IMMATERIAL):
            values.pop(key, None)
        params = OmegaConf.select(settings, "sweeper.params")
        swept = [f"{key}={value}" for key, value in (params or {}).items()]
        material = [
            override for override in settings.overrides.task if self._is_material(*_split_override(override), config)
        ]
        self.sweep = digest([__version__, values, swept, material])[:12]
        self.folder = Path(settings.sweep.dir)
        self._claim(self.folder)

    def on_job_start(self, config: DictConfig, *, task_function: TaskFunction, **kwargs: Any) -> None:
        """Record that a job of the sweep has started."""
        if self.sweep is None:
            return
        folder = Path(config.hydra.sweep.dir)
        if folder != self.folder:
            # In a sweep over experiments, each has the folder of its own name.
            self._claim(folder)
        self._record(config, "unfinished")

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:
        """Record how a job of the sweep ended, and write the table."""
        if self.sweep is None:
            return
        if job_return.status == JobStatus.COMPLETED:
            missing = job_return.return_value
            if isinstance(missing, NotRun):
                self._record(config, "not run", missing.reason)
            else:
                self._record(config, "finished")
        else:
            error = job_return._return_value  # the property would raise it
            expected = isinstance(error, ExpectedError)
            log.error("This job failed: %s", error, exc_info=None if expected else error)
            self._record(config, "failed", str(error) if expected else f"{type(error).__name__}: {error}")
        folder = Path(config.hydra.sweep.dir)
        with one_process_at_a_time(folder / LOCK_FILE, log, f"writes the table of {folder}"):
            jobs = read_jobs(folder)
            write_table(jobs, folder, columns=self.columns, plot=self.plot, seed=self.seed)

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Log the path of the table."""
        folder = Path(config.hydra.sweep.dir)
        if (folder / "table.md").is_file():
            log.info("Table of the sweep: %s", folder / "table.md")
        else:
            log.info("Tables of the sweep: %s", folder.with_name("<name of the experiment>") / "table.md")

    def _claim(self, folder: Path) -> None:
        """Move the table of another sweep in a folder aside."""
        folder.mkdir(parents=True, exist_ok=True)
        with one_process_at_a_time(folder / LOCK_FILE, log, f"writes the table of {folder}"):
            known = read_json(folder / RECORDS_FOLDER / "sweep.json")
            if known is not None and known["sweep"] != self.sweep:
                move_aside(folder, only=("table.csv", "table.md", "table.png", RECORDS_FOLDER))
            write_json(folder / RECORDS_FOLDER / "sweep.json", {"sweep": self.sweep})

    def _is_material(self, key: str, value: str, config: DictConfig) -> bool:
        return key not in self.immaterial and (key, value) != ("experiment", config.get("name"))

    def _record(self, config: DictConfig, state: str, error: str | None = None) -> None:
        settings = config.hydra
        overrides = dict(_split_override(override) for override in settings.overrides.task)
        seed = overrides.pop(self.seed, None)
        record = {
            "number": settings.job.num,
            "overrides": {key: value for key, value in overrides.items() if self._is_material(key, value, config)},
            "seed": OmegaConf.select(config, self.seed) if seed is None else seed,
            "folder": os.path.relpath(settings.runtime.output_dir, settings.sweep.dir),
            "state": state,
            "error": error,
        }
        write_json(Path(settings.sweep.dir) / RECORDS_FOLDER / f"{settings.job.num:05d}.json", record)


def read_jobs(folder: Path) -> pd.DataFrame:
    """Read the jobs of the sweep in a folder.

    Args:
        folder: The sweep's folder.

    Returns:
        One row per job in the order of the sweep, with the columns `job` (its number), one for each override, `seed`,
        `state` (one of `STATES`), one for each score (NaN if missing), `seconds`, `error`, `folder`.
    """
    records = [read_json(path) for path in sorted((folder / RECORDS_FOLDER).glob("[0-9]*.json"))]
    rows: list[dict[str, Any]] = []
    scores: dict[str, None] = {}
    overrides: dict[str, None] = {}
    for record in records:
        if record is None:
            continue
        row = {"job": record["number"], **record["overrides"], "seed": str(record["seed"]), "state": record["state"]}
        overrides.update(dict.fromkeys(record["overrides"]))
        if record["state"] == "finished":
            result = read_json(folder / record["folder"] / RESULT_FILE) or {}
            values = {
                key: math.nan if value is None else float(value) for key, value in result.get("scores", {}).items()
            }
            scores.update(dict.fromkeys(values))
            row |= {**values, "seconds": result.get("seconds", math.nan)}
        rows.append(row | {"error": record["error"] or "", "folder": record["folder"]})
    columns = ["job", *overrides, "seed", "state", *scores, "seconds", "error", "folder"]
    table = pd.DataFrame(rows, columns=columns)
    table.attrs.update(overrides=list(overrides), scores=list(scores))
    return table


def varied_overrides(jobs: pd.DataFrame) -> list[str]:
    """Return the overrides whose values differ between the jobs in a table of `read_jobs`."""
    return [key for key in jobs.attrs["overrides"] if jobs[key].nunique(dropna=False) > 1]


def common_overrides(jobs: pd.DataFrame) -> dict[str, Any]:
    """Return the overrides that all jobs in a table of `read_jobs` share, with their values."""
    varied = varied_overrides(jobs)
    return {key: jobs[key].iloc[0] for key in jobs.attrs["overrides"] if key not in varied}


def matching_scores(jobs: pd.DataFrame, patterns: Sequence[str]) -> list[str]:
    """Return the scores in a table of `read_jobs` that match file name patterns, in the order of the patterns."""
    return list(dict.fromkeys(score for pattern in patterns for score in fnmatch.filter(jobs.attrs["scores"], pattern)))


def summarize(jobs: pd.DataFrame) -> pd.DataFrame:
    """Average the scores of a sweep's jobs over seeds.

    Args:
        jobs: The table of `read_jobs`.

    Returns:
        One row per combination of overrides, in the order of the sweep. Columns: the overrides that vary; the number of
        jobs in each of `STATES`; and for each score and `seconds`, the mean over the finished jobs and, as
        `<score> std`, the sample standard deviation (NaN for a single job).
    """
    overrides = varied_overrides(jobs)
    rows = []
    keys = jobs[overrides].astype(object).where(jobs[overrides].notna(), "")
    groups = jobs.groupby([keys[key] for key in overrides], sort=False) if overrides else [((), jobs)]
    for values, group in groups:
        row: dict[str, Any] = dict(zip(overrides, values, strict=True))
        for state in STATES:
            row[state] = int((group["state"] == state).sum())
        for score in [*jobs.attrs["scores"], "seconds"]:
            row[score] = group[score].mean()
            row[f"{score} std"] = group[score].std(ddof=1)
        rows.append(row)
    summary = pd.DataFrame(rows)
    summary.attrs["overrides"] = overrides
    return summary


def write_table(
    jobs: pd.DataFrame, folder: Path, *, columns: Sequence[str], plot: Sequence[str], seed: str = "seed"
) -> None:
    """Write `table.csv` (each job), `table.md` (mean ± std over seeds) and `table.png` of a sweep.

    Args:
        jobs: The table of `read_jobs`.
        folder: Output folder.
        columns: Patterns of the scores in the Markdown table.
        plot: Scores in the figure.
        seed: The override over whose values scores are averaged.
    """
    write_whole(folder / "table.csv", jobs.to_csv(index=False).encode())
    summary = summarize(jobs)
    write_whole(folder / "table.md", markdown(jobs, summary, columns, seed).encode())
    drawn = [score for score in plot if score in summary]
    if drawn and summary["finished"].any():
        figure = draw(summary, drawn)
        picture = io.BytesIO()
        figure.savefig(picture, format="png", dpi=150)
        write_whole(folder / "table.png", picture.getvalue())


def markdown(jobs: pd.DataFrame, summary: pd.DataFrame, columns: Sequence[str], seed: str = "seed") -> str:
    """Return the Markdown table of a sweep, followed by the reasons of failures."""
    chosen = matching_scores(jobs, columns) or jobs.attrs["scores"]
    shown = pd.DataFrame(index=summary.index)
    for key in summary.attrs["overrides"]:
        shown[key] = summary[key].astype(str)
    shown["jobs"] = [_count(dict(zip(STATES, row, strict=True))) for row in summary[list(STATES)].to_numpy().tolist()]
    for score in [*chosen, "seconds"]:
        scale, digits = (1, 0) if score == "seconds" else (PER_CENT, 2)
        pairs = zip(scale * summary[score], scale * summary[f"{score} std"], strict=True)
        shown[score_title(score)] = [_mean_and_deviation(mean, deviation, digits) for mean, deviation in pairs]
    lines = [shown.to_markdown(index=False, disable_numparse=True, stralign="right")]
    if chosen:
        lines.append("Scores in per cent.")
    repeated = sorted(set(jobs["seed"]))
    common = common_overrides(jobs)
    if common:
        lines.append("All with " + ", ".join(f"`{key}={value}`" for key, value in common.items()) + ".")
    if len(repeated) > 1:
        lines.append(f"Mean ± sample standard deviation over `{seed}` {', '.join(repeated)}.")
    for row in jobs[jobs["state"] != "finished"].to_dict("records"):
        reason = row["error"].strip().splitlines()
        why = f": {reason[0]}" if reason else ""
        lines.append(f"Job {row['job']} (`{row['folder']}`) {row['state']}{why}")
    return "\n\n".join(lines) + "\n"


def draw(summary: pd.DataFrame, scores: Sequence[str]) -> Figure:
    """Draw scores over the rows of a sweep, with the standard deviation over seeds as error bars.

    If a single numeric override varies, it is the horizontal axis, logarithmic if it spans a factor of 4 or more.
    Otherwise the rows are drawn below each other. Rows without a finished job are labelled but empty.

    Args:
        summary: The table of `summarize`.
        scores: Names of the scores to draw.

    Returns:
        A figure, made without pyplot.
    """
    overrides = summary.attrs["overrides"]
    numbers = pd.to_numeric(summary[overrides[0]], errors="coerce") if len(overrides) == 1 else None
    if numbers is not None and numbers.notna().all() and len(numbers) > 1:
        figure = _draw_over_numbers(summary.assign(**{overrides[0]: numbers}), overrides[0], scores)
    else:
        figure = _draw_row_by_row(summary, scores)
    figure.axes[0].grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=3, frameon=False)
    return figure


def _draw_over_numbers(summary: pd.DataFrame, override: str, scores: Sequence[str]) -> Figure:
    from matplotlib.figure import Figure

    ordered = summary.sort_values(override)
    positions = ordered[override].to_numpy()
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    for score in scores:
        mean, deviation = PER_CENT * ordered[score], PER_CENT * ordered[f"{score} std"].fillna(0)
        axes.errorbar(positions, mean, yerr=deviation, marker="o", capsize=3, label=score_title(score))
    if positions[0] > 0 and positions[-1] / positions[0] >= 4:
        axes.set_xscale("log", base=2)
    axes.set_xticks(positions, labels=[f"{position:g}" for position in positions])
    axes.minorticks_off()
    axes.set_xlabel(override)
    axes.set_ylabel("%")
    return figure


def _draw_row_by_row(summary: pd.DataFrame, scores: Sequence[str]) -> Figure:
    from matplotlib.figure import Figure

    overrides = summary.attrs["overrides"]
    names = [", ".join(str(row[key]) for key in overrides) or "all" for row in summary.to_dict("records")]
    figure = Figure(figsize=(7, 1.4 + 0.45 * len(names)), layout="constrained")
    axes = figure.subplots()
    for place, score in enumerate(scores):
        # Offset the scores, so that equal ones do not hide each other.
        rows = [row + 0.14 * (place - (len(scores) - 1) / 2) for row in range(len(names))]
        mean, deviation = PER_CENT * summary[score], PER_CENT * summary[f"{score} std"].fillna(0)
        label = score_title(score)
        axes.errorbar(mean, rows, xerr=deviation, marker="o", linestyle="none", capsize=3, label=label)
    axes.set_yticks(range(len(names)), labels=names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_ylabel(", ".join(overrides))
    axes.set_xlabel("%")
    return figure


def _count(numbers: Mapping[str, int]) -> str:
    present = [state for state, number in numbers.items() if number]
    if present == ["finished"]:
        return str(numbers["finished"])
    if sum(numbers.values()) == 1 or present == ["not run"]:
        return present[0]
    return ", ".join(f"{number} {state}" for state, number in numbers.items() if number)


def _mean_and_deviation(mean: float, deviation: float, digits: int) -> str:
    if math.isnan(mean):
        return "–"
    return f"{mean:.{digits}f}" if math.isnan(deviation) else f"{mean:.{digits}f} ± {deviation:.{digits}f}"


def _split_override(override: str) -> tuple[str, str]:
    key, _, value = override.lstrip("+~").partition("=")
    return key, value
