"""Read the results of trainings, evaluations and sweeps from their folders."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from sgbd.jobs.configuration import ConfigurationError
from sgbd.jobs.job import ASIDE, RESULT_FILE, read_json
from sgbd.jobs.sweep import RECORDS_FOLDER, read_jobs, varied_overrides

SCORES_FILE = "scores.json"
HISTORY_FILE = "history.csv"
SWEEP_COLUMNS = ("seen/overlap_f", "unseen/overlap_f", "hm/overlap_f", "all/overlap_f", "unaided/overlap_f")
"""Scores shown for a sweep that does not configure its own."""


@dataclass(frozen=True)
class Run:
    """One training or evaluation.

    Attributes:
        label: Unique name in the report.
        folder: Folder of the run.
        scores: As in `sgbd.evaluation.Evaluation`; empty if nothing was scored.
        frames: One row per frame, indexed by name; may be empty.
        categories: One row per category, indexed by name; may be empty.
        history: One row per epoch; empty for an evaluation.
        config: Configuration of the run, unresolved; empty if it was not saved.
        outcome: Content of `result.json` except the scores: parameters, best epoch, seconds.
    """

    label: str
    folder: Path
    scores: Mapping[str, float]
    frames: pd.DataFrame
    categories: pd.DataFrame
    history: pd.DataFrame
    config: Mapping[str, Any] = field(default_factory=dict)
    outcome: Mapping[str, Any] = field(default_factory=dict)

    @property
    def dataset(self) -> str:
        """Display name of the scored dataset; `unknown` if the configuration was not saved."""
        return dataset_name(self.config.get("dataset"))

    @property
    def split(self) -> str:
        """Name of the scored split."""
        return str(self.config.get("split", "test"))


@dataclass(frozen=True)
class Sweep:
    """A sweep of trainings.

    Attributes:
        label: Name in the report.
        folder: Folder of the sweep.
        jobs: One row per job, as returned by `sgbd.jobs.sweep.read_jobs`.
        columns: Patterns of the scores shown in tables.
        plot: Patterns of the scores that are plotted.
        runs: Runs of the jobs with results, by job number.
    """

    label: str
    folder: Path
    jobs: pd.DataFrame
    columns: Sequence[str]
    plot: Sequence[str]
    runs: Mapping[int, Run]


@dataclass(frozen=True)
class Results:
    """All results of a report.

    Attributes:
        title: Name of the folder.
        runs: All runs, including those of sweeps.
        sweeps: The sweeps.
    """

    title: str
    runs: Sequence[Run]
    sweeps: Sequence[Sweep]


def dataset_name(dataset: Any) -> str:
    """Return the display name of a dataset.

    Args:
        dataset: Its configuration.

    Returns:
        Its `name` if configured (as for synthetic datasets), otherwise the name of its folder, otherwise that of its
        reader class; "unknown" without a configuration.
    """
    if not isinstance(dataset, Mapping | DictConfig):
        return "unknown"
    folder = Path(str(dataset.get("root") or "")).name
    return str(dataset.get("name") or folder or str(dataset.get("_target_", "")).rpartition(".")[2] or "unknown")


def read_results(folder: Path) -> Results:
    """Find the runs and sweeps in a folder, recursively, and read them.

    Args:
        folder: Folder of a run or a sweep, or a folder that contains such folders. Results that were moved aside
            (`earlier-<n>`) are skipped.

    Returns:
        The results.

    Raises:
        ConfigurationError: If the folder does not exist or contains no results, or a result file is damaged.
    """
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise ConfigurationError(
            f"{folder} {what}; expected the folder of a training, an evaluation or a sweep, such as "
            "outputs/train/<date> or outputs/sweeps/<name>."
        )
    title = folder.resolve().name
    runs: list[Run] = []
    sweeps: list[Sweep] = []
    for found in _folders(folder):
        name = title if found == folder else found.relative_to(folder).as_posix()
        if (found / RECORDS_FOLDER).is_dir():
            sweep = _read_sweep(found, name, prefix="" if found == folder else f"{name}: ")
            sweeps.append(sweep)
            runs += sweep.runs.values()
        else:
            runs.append(read_run(found, name))
    if not runs and not any(len(sweep.jobs) for sweep in sweeps):
        raise ConfigurationError(
            f"there are no results in {folder}: neither {SCORES_FILE} nor {HISTORY_FILE} of a training or evaluation, "
            f"nor the records ({RECORDS_FOLDER}) of a sweep, in it or below. Make some with python -m sgbd.train or "
            "python -m sgbd.evaluate."
        )
    return Results(title, runs, sweeps)


def _folders(folder: Path) -> Iterator[Path]:
    """Yield folders of runs and sweeps; nothing is looked for inside of them."""
    if _is_run(folder) or (folder / RECORDS_FOLDER).is_dir():
        yield folder
        return
    for below in sorted(path for path in folder.iterdir() if path.is_dir()):
        if not below.name.startswith((".", ASIDE)):
            yield from _folders(below)


def _is_run(folder: Path) -> bool:
    return any((folder / name).is_file() for name in (SCORES_FILE, HISTORY_FILE))


def read_run(folder: Path, label: str) -> Run:
    """Read a run.

    Args:
        folder: Folder of the run.
        label: Name in the report.

    Returns:
        The run; missing results are empty.

    Raises:
        ConfigurationError: If a file is damaged.
    """
    scores = read_json(folder / SCORES_FILE) or {}
    outcome = read_json(folder / RESULT_FILE) or {}
    return Run(
        label=label,
        folder=folder,
        scores={name: float(value) for name, value in scores.items() if value is not None},
        frames=_read_table(folder / "frames.csv", index="name"),
        categories=_read_table(folder / "categories.csv", index="category"),
        history=_read_table(folder / HISTORY_FILE),
        config=_read_config(folder / "config.yaml"),
        outcome={key: value for key, value in outcome.items() if key != "scores"},
    )


def _read_sweep(folder: Path, label: str, prefix: str) -> Sweep:
    jobs = read_jobs(folder)
    varied = varied_overrides(jobs)
    runs = {}
    for row in jobs.to_dict("records"):
        if row["state"] == "finished" and _is_run(folder / row["folder"]):
            parts = [f"{key}={row[key]}" for key in varied] + [f"seed={row['seed']}"]
            runs[int(row["job"])] = read_run(folder / row["folder"], prefix + ", ".join(parts))
    table = OmegaConf.select(_load(folder / "multirun.yaml"), "hydra.callbacks.sweep_table") or {}
    return Sweep(
        label,
        folder,
        jobs,
        columns=tuple(table.get("columns") or SWEEP_COLUMNS),
        plot=tuple(table.get("plot") or SWEEP_COLUMNS),
        runs=runs,
    )


def _read_table(path: Path, index: str | None = None) -> pd.DataFrame:
    try:
        # Keep names as text, even if a frame is called "7" or "nan".
        table = pd.read_csv(path, dtype={index: str} if index else None, keep_default_na=False, na_values=[""])
        return table if index is None else table.set_index(index)
    except FileNotFoundError:
        return pd.DataFrame()
    except (ValueError, LookupError) as error:
        raise ConfigurationError(f"{path} is damaged ({error}); remove it, or repeat what made it") from None


def _read_config(path: Path) -> Mapping[str, Any]:
    values = OmegaConf.to_container(_load(path), resolve=False)
    assert isinstance(values, dict)
    return {str(key): value for key, value in values.items()}


def _load(path: Path) -> Any:
    try:
        return OmegaConf.load(path)
    except FileNotFoundError:
        return OmegaConf.create()
    except (YAMLError, OmegaConfBaseException, OSError) as error:
        raise ConfigurationError(f"{path} is damaged ({error}); remove it, or repeat what made it") from None
