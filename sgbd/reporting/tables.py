"""Build the tables of a report: displayed text and sort keys."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from sgbd.evaluation import score_table
from sgbd.jobs.sweep import PER_CENT, common_overrides, matching_scores, summarize, varied_overrides
from sgbd.reporting.runs import Run, Sweep
from sgbd.reporting.score_titles import TITLES, score_title

FRAME_COLUMNS = {
    "overlap_f_measure": "overlap F",
    "unaided_overlap_f_measure": "unaided F",
    "seen_overlap_f_measure": "seen F",
    "unseen_overlap_f_measure": "unseen F",
    "oracle_overlap_f_measure": "oracle F",
    "overlap_detected_share": "F@.75",
    "boundary_f_measure": "boundary F",
    "cut_f_measure": "cut F",
}
OVERVIEW = ("hm/overlap_f", "all/overlap_f", "all/f75", "all/boundary_f", "unaided/overlap_f", "oracle/overlap_f")
GAP = "–"


@dataclass(frozen=True)
class Cell:
    """A cell of a table.

    Attributes:
        text: Displayed text.
        value: Value to sort by: a number (NaN comes last) or a text.
        link: HTML id on the page that the cell links to.
        bar: Length of a bar behind the number, 0 to 100; None for no bar.
        best: Whether it is the best value of its column.
    """

    text: str
    value: float | str
    link: str | None = None
    bar: float | None = None
    best: bool = False

    @property
    def key(self) -> str:
        """Sort key for the page; empty for NaN."""
        if isinstance(self.value, str):
            return self.value
        return "" if math.isnan(self.value) else repr(float(self.value))


@dataclass(frozen=True)
class Table:
    """A table of a report.

    Attributes:
        caption: Caption.
        columns: Title of each column, and whether it is numeric.
        rows: Cells of each row.
        note: A sentence shown below the table.
    """

    caption: str
    columns: Sequence[tuple[str, bool]]
    rows: Sequence[Sequence[Cell]]
    note: str = ""


def text(value: object, link: str | None = None) -> Cell:
    """Return a text cell."""
    return Cell(str(value), str(value), link)


def number(value: float) -> Cell:
    """Return a cell with a number without decimals; a dash for NaN."""
    return Cell(GAP if math.isnan(value) else f"{value:.0f}", float(value))


def score(share: float, deviation: float = math.nan, best: bool = False) -> Cell:
    """Return a cell with a score in per cent and, optionally, its standard deviation.

    Args:
        share: Score, 0 to 1; NaN for no score.
        deviation: Standard deviation over seeds, in the same unit; NaN for none.
        best: Whether it is the best value of its column.
    """
    value = PER_CENT * share
    if math.isnan(value):
        return Cell(GAP, math.nan)
    shown = f"{value:.1f}"
    if not math.isnan(deviation):
        shown += f" ± {PER_CENT * deviation:.1f}"
    return Cell(shown, value, bar=min(max(value, 0), 100), best=best)


def protocol_table(run: Run) -> Table:
    """Return the scores of a run, one row per protocol."""
    scores = score_table(dict(run.scores))
    rows = [
        [text(score_title(str(name))), *(score(value / PER_CENT) for value in row)]
        for name, row in zip(scores.index, scores.to_numpy().tolist(), strict=True)
    ]
    titles = [("protocol", False), *((score_title(name), True) for name in scores.columns)]
    return Table("Scores by protocol, per cent", titles, rows)


def overview_table(runs: Sequence[Run], links: Mapping[str, str]) -> Table:
    """Return the main scores of several runs, one row per run.

    Args:
        runs: The runs.
        links: HTML id of each run on the page, by label.
    """
    names = [name for name in OVERVIEW if any(name in run.scores for run in runs)]
    best = {name: _best([run.scores.get(name, math.nan) for run in runs]) for name in names}
    rows = [
        [
            text(run.label, links.get(run.label)),
            text(run.dataset),
            text(run.split),
            number(len(run.frames)),
            *(_compared(run.scores.get(name, math.nan), best[name]) for name in names),
        ]
        for run in runs
    ]
    titles = [("run", False), ("dataset", False), ("split", False), ("frames", True)]
    return Table("All runs, per cent", [*titles, *((score_title(name), True) for name in names)], rows)


def sweep_table(sweep: Sweep) -> Table:
    """Return the scores of a sweep averaged over seeds, one row per combination of varied options."""
    summary = summarize(sweep.jobs)
    overrides, scores = summary.attrs["overrides"], _chosen(sweep)
    best = {name: _best(summary[name].tolist()) for name in scores}
    rows = []
    for row in summary.to_dict("records"):
        finished = int(row["finished"])
        jobs = finished + int(row["failed"]) + int(row["unfinished"])
        cells = [_setting(row[key]) for key in overrides]
        shown = f"{finished} of {jobs}" if finished < jobs else str(jobs) if jobs else "not run"
        cells.append(Cell(shown, float(finished)))
        cells += [_compared(row[name], best[name], row[f"{name} std"]) for name in scores]
        rows.append([*cells, number(row["seconds"])])
    seeds = sorted(set(sweep.jobs["seed"]))
    repeated = f"Mean ± sample standard deviation over seeds {', '.join(seeds)}. " if len(seeds) > 1 else ""
    shared = common_overrides(sweep.jobs)
    common = "All with " + ", ".join(f"{key}={value}" for key, value in shared.items()) + ". " if shared else ""
    titles = [*((key, False) for key in overrides), ("jobs", True), *((score_title(name), True) for name in scores)]
    return Table("Scores of the sweep, per cent", [*titles, ("seconds", True)], rows, f"{repeated}{common}".strip())


def jobs_table(sweep: Sweep, links: Mapping[str, str]) -> Table:
    """Return all jobs of a sweep, finished or not.

    Args:
        sweep: The sweep.
        links: HTML id of each run on the page, by label.
    """
    overrides, scores = varied_overrides(sweep.jobs), _chosen(sweep)
    rows = []
    for row in sweep.jobs.to_dict("records"):
        run = sweep.runs.get(int(row["job"]))
        state = row["state"] + (f": {row['error'].strip().splitlines()[0]}" if row["error"].strip() else "")
        job = Cell(str(row["job"]), float(row["job"]), None if run is None else links.get(run.label))
        cells = [job, *(_setting(row[key]) for key in overrides), _setting(row["seed"]), text(state)]
        rows.append([*cells, *(score(row[name]) for name in scores), number(row["seconds"])])
    titles = [("job", True), *((key, False) for key in (*overrides, "seed", "state"))]
    columns = [*titles, *((score_title(name), True) for name in scores), ("seconds", True)]
    return Table("Every job, per cent", columns, rows)


def category_table(run: Run) -> Table:
    """Return the scores of a run by category."""
    columns = [name for name in run.categories.columns if name in TITLES]
    has_groups = "seen" in run.categories
    rows = []
    for row in run.categories.reset_index().to_dict("records"):
        cells = [text(row["category"])] + ([text("seen" if row["seen"] else "unseen")] if has_groups else [])
        rows.append([*cells, number(row["frames"]), *(score(row[name]) for name in columns)])
    titles = [("category", False), *([("group", False)] if has_groups else []), ("frames", True)]
    return Table("Scores by category, per cent", [*titles, *((TITLES[name], True) for name in columns)], rows)


def category_comparison(runs: Mapping[str, Sequence[Run]]) -> Table | None:
    """Return overlap F by category, one column per setting, averaged over its runs.

    Args:
        runs: Runs by name of the setting.

    Returns:
        The table; None unless at least two settings have scores by category.
    """
    columns = {}
    for name, group in runs.items():
        tables = [run.categories["overlap_f_measure"] for run in group if "overlap_f_measure" in run.categories]
        if tables:
            columns[name] = pd.concat(tables, axis=1).mean(axis=1)
    if len(columns) < 2:
        return None
    means = pd.DataFrame(columns)
    groups = [run.categories["seen"] for group in runs.values() for run in group if "seen" in run.categories]
    seen = pd.concat(groups).groupby(level=0).first() if groups else None
    rows = []
    for category, row in zip(means.index, means.to_numpy().tolist(), strict=True):
        best = _best(row)
        cells = [text(category)]
        if seen is not None:
            cells.append(text({True: "seen", False: "unseen"}.get(seen.get(category), GAP)))
        rows.append([*cells, *(_compared(value, best) for value in row)])
    titles = [("category", False), *([] if seen is None else [("group", False)])]
    return Table("Overlap F by category, per cent", [*titles, *((name, True) for name in columns)], rows)


def frame_table(run: Run, limit: int, link: Callable[[str], str | None]) -> Table:
    """Return the scores of a run by frame, worst first.

    Args:
        run: The run.
        limit: Maximum number of rows; the worst frames are kept.
        link: Returns the HTML id of a frame's pictures, or None if there are none.
    """
    columns = [name for name in FRAME_COLUMNS if name in run.frames and run.frames[name].notna().any()]
    ranked = run.frames.sort_values(columns[0], kind="stable") if columns else run.frames
    rows = [
        [text(name, link(str(name))), *(score(value) for value in row)]
        for name, row in zip(ranked.index[:limit], ranked[columns].iloc[:limit].to_numpy().tolist(), strict=True)
    ]
    note = f"The worst {limit} of {len(ranked)} frames; frames.csv holds all." if len(ranked) > limit else ""
    return Table(
        "Scores by frame, per cent", [("frame", False), *((FRAME_COLUMNS[c], True) for c in columns)], rows, note
    )


def _chosen(sweep: Sweep) -> list[str]:
    return matching_scores(sweep.jobs, sweep.columns) or sweep.jobs.attrs["scores"]


def _setting(value: object) -> Cell:
    """Return a cell with the value of a varied option, sorted as a number if possible."""
    shown = GAP if value is None or value != value else str(value)
    try:
        return Cell(shown, float(shown))
    except ValueError:
        return text(shown)


def _best(values: Sequence[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return max(known) if len(known) > 1 else math.inf


def _compared(value: float, best: float, deviation: float = math.nan) -> Cell:
    return score(value, deviation, best=value == best)
