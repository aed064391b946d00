"""Figures of a report, as SVG that adopts the page's colours."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from sgbd.jobs.sweep import PER_CENT
from sgbd.reporting.runs import Run
from sgbd.reporting.score_titles import score_title

LEGEND_ENTRIES = 12
"""Maximum number of legend entries; with more lines the legend is omitted because it would hide too much."""


def inline_svg(figure: Figure, number: int) -> str:
    """Convert a figure to an inline `<svg>` element.

    Black becomes the page's text colour and white its background, so that the figure is readable in light and dark
    mode. Text remains text.

    Args:
        figure: The figure.
        number: Number of the figure on the page, used to make its SVG ids unique.

    Returns:
        The element; identical for identical figures.
    """
    figure.patch.set_visible(False)
    for axes in figure.axes:
        axes.patch.set_visible(False)
    drawn = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": str(number)}):
        figure.savefig(drawn, format="svg", metadata={"Date": None})
    svg = drawn.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'\bid="', f'id="f{number}-', svg)
    svg = re.sub(r'href="#', f'href="#f{number}-', svg)
    svg = svg.replace("url(#", f"url(#f{number}-")
    return svg.replace("#000000", "currentColor").replace("#ffffff", "var(--surface)").strip()


def curve_comparison(runs: Mapping[str, Sequence[Run]]) -> Figure | None:
    """Plot the validation overlap F over epochs, one line per setting, averaged over its runs.

    Args:
        runs: Runs by name of the setting.

    Returns:
        The figure; None if no history contains the score.
    """
    score = "val/overlap_f"
    lines = {}
    for name, group in runs.items():
        histories = [run.history.set_index("epoch")[score] for run in group if score in run.history]
        if histories:
            lines[name] = pd.concat(histories, axis=1).mean(axis=1)
    if not lines:
        return None
    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.subplots()
    for name, line in lines.items():
        axes.plot(line.index, PER_CENT * line, marker="o", markersize=3, label=name)
    axes.set_xlabel("epoch")
    axes.set_ylabel(f"{score_title(score)}, %")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.grid(alpha=0.3)
    if len(lines) <= LEGEND_ENTRIES:
        figure.legend(loc="outside upper center", ncols=3, frameon=False, fontsize="small")
    return figure


def frame_distribution(run: Run) -> Figure | None:
    """Plot the distribution of overlap F over frames, sorted from worst to best separately for each curve.

    Args:
        run: A run.

    Returns:
        The figure; None if fewer than two frames have a score.
    """
    curves = {
        label: np.sort(run.frames[name].dropna().to_numpy())
        for name, label in {
            "overlap_f_measure": "all",
            "unaided_overlap_f_measure": "unaided",
            "oracle_overlap_f_measure": "oracle",
        }.items()
        if name in run.frames
    }
    curves = {label: values for label, values in curves.items() if len(values) > 1}
    if not curves:
        return None
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    axes = figure.subplots()
    for label, values in curves.items():
        axes.plot(np.linspace(0, 100, len(values)), PER_CENT * values, label=label)
    axes.set_xlabel("share of frames, %, the worst first")
    axes.set_ylabel("overlap F, %")
    axes.set_ylim(-2, 102)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, loc="lower right")
    return figure
