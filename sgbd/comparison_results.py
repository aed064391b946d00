"""Output files of a comparison: scores, failures by kind, and grids of pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd

from sgbd.comparison import Judged
from sgbd.failures import TABLE_AS_OBJECT, Failures, failure_counts, failure_table
from sgbd.frame import Frame
from sgbd.machine.atomic_file import write_whole
from sgbd.reporting.plot import frames_figure, methods_figure, worst_frame_figure
from sgbd.reporting.results import write_evaluation, write_figure
from sgbd.sources import FrameSource

SHOWN = {
    "seen/overlap_f": "seen F",
    "unseen/overlap_f": "unseen F",
    "hm/overlap_precision": "HM P",
    "hm/overlap_recall": "HM R",
    "hm/overlap_f": "HM F",
    "hm/boundary_f": "HM boundary F",
    "all/overlap_f": "all F",
    "all/f75": "all F@.75",
    "all/boundary_f": "all boundary F",
    "unaided/overlap_f": "unaided F",
    "unaided/f75": "unaided F@.75",
    "unaided/boundary_f": "unaided boundary F",
}
"""Scores in the Markdown table and their titles; the CSV file contains all scores."""


def score_rows(judged: Sequence[Judged]) -> pd.DataFrame:
    """Arrange the scores of methods in one row per method, with `kind`, `frames` and every score as `protocol/score`.

    Args:
        judged: The results of each method.

    Returns:
        The table, indexed by method; fractions from 0 to 1, NaN if a method does not have the score.
    """
    rows = [{"kind": one.kind, "frames": len(one.evaluation.frames), **one.evaluation.scores} for one in judged]
    return pd.DataFrame(rows, index=pd.Index([one.name for one in judged], name="method"))


def score_markdown(rows: pd.DataFrame) -> str:
    """Return the scores of `SHOWN`, in per cent, as a Markdown table.

    Args:
        rows: The table of `score_rows`.
    """
    shown = {score: title for score, title in SHOWN.items() if score in rows}
    cells = (100 * rows[list(shown)]).map(lambda value: "–" if np.isnan(value) else f"{value:.1f}")
    cells = cells.rename(columns=shown)
    cells.insert(0, "frames", rows["frames"].astype(str))
    cells.index.name = "method"
    return cells.to_markdown(disable_numparse=True, colalign=["left"] + ["right"] * len(cells.columns))


def write_scores(judged: Sequence[Judged], folder: Path) -> str:
    """Write `comparison.csv`, `comparison.md` and, for each method, the files of an evaluation.

    Args:
        judged: The results of each method.
        folder: Output folder.

    Returns:
        The Markdown table.
    """
    rows = score_rows(judged)
    for one in judged:
        write_evaluation(one.evaluation, folder / "methods" / one.name)
    write_whole(folder / "comparison.csv", rows.to_csv().encode())
    table = score_markdown(rows)
    write_whole(folder / "comparison.md", f"{table}\n".encode())
    return table


def write_failures(judged: Sequence[Judged], source: FrameSource, folder: Path, worst: int) -> str:
    """Write `failures.csv`, `failures.md` with pictures of the worst frames, and a `failures.csv` for each method.

    Args:
        judged: The results of each method.
        source: The frames.
        folder: Output folder.
        worst: Number of frames to draw for each method: those with the most failures.

    Returns:
        The Markdown table of the counts.
    """
    counts = pd.DataFrame(
        [failure_counts(one.failures) for one in judged], index=pd.Index([one.name for one in judged], name="method")
    )
    write_whole(folder / "failures.csv", counts.to_csv().encode())
    table = counts.to_markdown()
    lines = [
        "# Failures by kind",
        "Every true object that was not found (F of its match at most 0.75) is counted once, by what spoils it most; "
        f"*{TABLE_AS_OBJECT}* counts predicted objects. See `sgbd.failures.classify_failures`. A method that does not "
        "say what an object is (“aided”) had its objects chosen by the truth, and so no false ones.",
        table,
    ]
    frames = _frames_by_name(source)
    for one in judged:
        ranked = failure_table(one.failures)
        write_whole(folder / "methods" / one.name / "failures.csv", ranked.to_csv().encode())
        by_name = {failures.name: failures for failures in one.failures}
        lines.append(f"## {one.title}")
        for name in ranked.index[:worst]:
            frame, failures = frames(name), by_name[name]
            figure = worst_frame_figure(frame, one.predict(frame), failures)
            path = write_figure(figure, folder / "failures" / one.name / f"{name.replace('/', '_')}.png")
            kinds = ", ".join(f"{failures.count(kind)} {kind}" for kind in _kinds_of(failures))
            lines.append(f"`{name}`, {failures.objects} objects: {kinds or 'no failure'}")
            lines.append(f"![{name}]({quote(path.relative_to(folder).as_posix())})")
    write_whole(folder / "failures.md", ("\n\n".join(lines) + "\n").encode())
    return table


def _kinds_of(failures: Failures) -> list[str]:
    kinds = sorted(set(failures.kind_of_object.values()), key=lambda kind: -failures.count(kind))
    return [*kinds, *([TABLE_AS_OBJECT] if failures.false_objects else [])]


def write_grids(judged: Sequence[Judged], source: FrameSource, folder: Path, count: int) -> list[Path]:
    """Draw figure grids of the best, the median and the worst frames.

    Args:
        judged: The results of each method.
        source: The frames.
        folder: Output folder.
        count: Number of best, of median and of worst frames.

    Returns:
        The files: for each model, its own best, median and worst frames with superpixels, edge probabilities,
        prediction and ground truth; and `methods.png`, the predictions of all methods side by side on the best, median
        and worst frames of the first method.
    """
    frames = _frames_by_name(source)
    paths = []
    for one in judged:
        if one.segmenter is None:
            continue
        chosen = best_median_worst(one.ranking, count)
        rows = [(f"{place}: F {100 * one.overlap_f[name]:.1f}", frames(name)) for name, place in chosen.items()]
        segmented = [(title, frame, one.segmenter.segment_frame(frame)) for title, frame in rows]
        paths.append(write_figure(frames_figure(segmented), folder / "pictures" / f"{one.name}.png"))
    chosen = best_median_worst(judged[0].ranking, count)
    rows = [(place, frames(name)) for name, place in chosen.items()]
    predictions = {
        one.title: [one.predict(frame) for _, frame in rows]
        for one in judged
        # The first method may have frames for which another method has no label image.
        if all(name in one.evaluation.frames.index for name in chosen)
    }
    paths.append(write_figure(methods_figure(rows, predictions), folder / "pictures" / "methods.png"))
    return paths


def best_median_worst(ranking: Sequence[str], count: int) -> dict[str, str]:
    """Choose frames from both ends and the middle of a ranking.

    Args:
        ranking: Names of frames, worst first.
        count: Number of frames of each kind; fewer if there are not enough frames.

    Returns:
        "best", "median" or "worst" by name of the frame, best first.
    """
    last, middle = len(ranking) - 1, (len(ranking) - 1) / 2
    places = {"best": range(last, -1, -1), "median": sorted(range(last + 1), key=lambda k: abs(k - middle))}
    chosen: dict[str, str] = {}
    # Worst before median: if there are few frames, the extremes matter more.
    for place, order in (("best", places["best"]), ("worst", range(last + 1)), ("median", places["median"])):
        free = [ranking[k] for k in order if ranking[k] not in chosen]
        chosen |= dict.fromkeys(free[:count], place)
    rank = {name: k for k, name in enumerate(ranking)}
    return {name: chosen[name] for name in sorted(chosen, key=lambda name: -rank[name])}


def _frames_by_name(source: FrameSource) -> Callable[[str], Frame]:
    index = {name: place for place, name in enumerate(source.names)}
    return lambda name: source[index[name]]
