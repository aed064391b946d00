"""Render results to an HTML page with the report template."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup
from omegaconf import OmegaConf

from sgbd import __version__
from sgbd.jobs.sweep import draw, matching_scores, summarize, varied_overrides
from sgbd.reporting.figures import curve_comparison, frame_distribution, inline_svg
from sgbd.reporting.gallery import MEASURES, Gallery, collect
from sgbd.reporting.panels import PANELS
from sgbd.reporting.plot import history_figure
from sgbd.reporting.runs import Results, Run, Sweep
from sgbd.reporting.score_titles import score_title
from sgbd.reporting.tables import (
    Table,
    category_comparison,
    category_table,
    frame_table,
    jobs_table,
    overview_table,
    protocol_table,
    sweep_table,
)

HEADLINES = ("hm/overlap_f", "all/overlap_f", "all/boundary_f", "unaided/overlap_f", "oracle/overlap_f")
"""Scores shown at the top of a report on a single run."""


@dataclass(frozen=True)
class _Figure:
    svg: Markup
    caption: str


class _Figures:
    """Converts figures to SVG for the page, each with unique ids."""

    def __init__(self) -> None:
        self._numbers = count()

    def __call__(self, drawn: Any, caption: str) -> list[_Figure]:
        """Return a list with the converted figure; an empty list for None."""
        return [] if drawn is None else [_Figure(Markup(inline_svg(drawn, next(self._numbers))), caption)]


def render(results: Results, *, frame_rows: int, megabytes: float) -> str:
    """Render the report page.

    Args:
        results: The results to report.
        frame_rows: Maximum total number of rows in the frame tables.
        megabytes: Maximum total size of the gallery pictures.

    Returns:
        Self-contained HTML that needs no network and no other file.

    Raises:
        ConfigurationError: If a picture is damaged.
    """
    runs, figures = results.runs, _Figures()
    places = {run.label: f"run-{place}" for place, run in enumerate(runs)}
    gallery = collect(runs, megabytes)
    share = max(1, frame_rows // max(1, len(runs)))
    swept = {run.label for sweep in results.sweeps for run in sweep.runs.values()}
    single = [run for run in runs if run.label not in swept]
    cards = gallery.cards
    return (
        _environment()
        .get_template("report.html.j2")
        .render(
            title=results.title,
            version=__version__,
            headlines=_headlines(runs[0]) if len(runs) == 1 else [],
            overview=overview_table(single, places) if len(single) > 1 else None,
            comparison=category_comparison({run.label: [run] for run in single}),
            sweeps=[_sweep_section(sweep, places, figures) for sweep in results.sweeps],
            sections=[_run_section(run, places[run.label], gallery, share, figures) for run in runs],
            gallery=gallery,
            measures={name: title for name, title in MEASURES.items() if any(name in card.scores for card in cards)},
            panels=[panel for panel in PANELS if any(p.panel == panel for card in cards for p in card.pictures)],
            gallery_runs=list(dict.fromkeys(card.run for card in cards)),
            gallery_datasets=sorted({card.dataset for card in cards}),
            grouped=any(card.seen is not None for card in cards),
        )
    )


def _run_section(run: Run, place: str, gallery: Gallery, frame_rows: int, figures: _Figures) -> dict[str, Any]:
    """Return the template values of a run."""
    tables = []
    if run.scores:
        tables.append(protocol_table(run))
    if len(run.categories):
        tables.append(category_table(run))
    if len(run.frames):
        tables.append(frame_table(run, frame_rows, lambda name: gallery.places.get((run.label, name))))
    curves = history_figure(run.history) if len(run.history) else None
    return {
        "place": place,
        "label": run.label,
        "facts": _facts(run),
        "figures": [
            *figures(curves, "Training curves"),
            *figures(frame_distribution(run), "Overlap F of the frames, the worst first"),
        ],
        "tables": tables,
        "config": OmegaConf.to_yaml(OmegaConf.create(dict(run.config))) if run.config else "",
    }


def _sweep_section(sweep: Sweep, places: Mapping[str, str], figures: _Figures) -> dict[str, Any]:
    """Return the template values of a sweep."""
    return {
        "label": sweep.label,
        "tables": _sweep_tables(sweep, places),
        "figures": [
            *figures(_sweep_figure(sweep), "Scores of the sweep, with the standard deviation over seeds"),
            *figures(curve_comparison(settings(sweep)), "Validation overlap F over the epochs, mean over seeds"),
        ],
    }


def settings(sweep: Sweep) -> dict[str, list[Run]]:
    """Group the runs of a sweep by their varied options, ignoring the seed."""
    varied = varied_overrides(sweep.jobs)
    groups: dict[str, list[Run]] = {}
    for row in sweep.jobs.to_dict("records"):
        if int(row["job"]) in sweep.runs:
            name = ", ".join(f"{key.rpartition('.')[2]}={row[key]}" for key in varied) or sweep.label
            groups.setdefault(name, []).append(sweep.runs[int(row["job"])])
    return groups


def _sweep_tables(sweep: Sweep, places: Mapping[str, str]) -> list[Table]:
    comparison = category_comparison(settings(sweep))
    return [sweep_table(sweep), *([] if comparison is None else [comparison]), jobs_table(sweep, places)]


def _sweep_figure(sweep: Sweep) -> Any:
    summary = summarize(sweep.jobs)
    drawn = matching_scores(sweep.jobs, sweep.plot)
    return draw(summary, drawn) if drawn and summary["finished"].any() else None


def _headlines(run: Run) -> Sequence[tuple[str, str]]:
    return [(score_title(name), f"{100 * run.scores[name]:.1f}") for name in HEADLINES if name in run.scores]


def _facts(run: Run) -> list[tuple[str, str]]:
    facts = [("Dataset", f"{run.dataset}, {run.split}"), ("Frames", str(len(run.frames)))]
    model = run.config.get("model")
    if isinstance(model, Mapping):
        facts.append(("Model", str(model.get("_target_", "")).rpartition(".")[2]))
    for key, title in (("parameters", "Parameters"), ("best_epoch", "Best epoch"), ("seconds", "Seconds")):
        value = run.outcome.get(key)
        if value is not None:
            facts.append((title, f"{value:,.0f}"))
    if run.config.get("checkpoint"):
        facts.append(("Checkpoint", str(run.config["checkpoint"])))
    return facts


def _environment() -> Environment:
    # Names come from arbitrary files and folders, so everything is escaped except our own markup.
    return Environment(
        loader=PackageLoader("sgbd.reporting"),
        autoescape=select_autoescape(enabled_extensions=("j2",)),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
