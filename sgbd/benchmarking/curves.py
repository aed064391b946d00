"""Plot how costs grow with image size, number of superpixels and number of frames."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill

from sgbd.benchmarking.report import Report

TITLE_WIDTH = 48
"""Maximum number of characters per line of a panel title."""


def draw_curves(report: Report, path: Path) -> None:
    """Plot frame time against image size and against n, and preparation time against the number of frames.

    Args:
        report: Report with the tables of the section `curve`.
        path: PNG file to write.
    """
    from matplotlib.figure import Figure

    tables = {table.name: table for table in report.tables}
    sizes, numbers, counts = (tables[name] for name in ("curve_size", "curve_n", "curve_frames"))
    figure = Figure(figsize=(12, 3.8), layout="constrained")
    panels = figure.subplots(1, 3)
    for axes, table, places, label in (
        (panels[0], sizes, [row["width"] * row["height"] / 1e6 for row in sizes.rows], "megapixels"),
        (panels[1], numbers, [row["n"] for row in numbers.rows], "superpixels asked for (n)"),
    ):
        low, middle, high = ([row[name] for row in table.rows] for name in ("p10_ms", "median_ms", "p90_ms"))
        axes.plot(places, middle, marker="o")
        axes.fill_between(places, low, high, alpha=0.2)
        axes.set(xlabel=label, ylabel="ms, median and p10 to p90")
    panels[2].plot([row["frames"] for row in counts.rows], [row["seconds"] for row in counts.rows], marker="o")
    panels[2].set(xlabel="frames", ylabel="seconds")
    for axes, table in zip(panels, (sizes, numbers, counts), strict=True):
        axes.set_title(fill(table.title, TITLE_WIDTH), fontsize=9)
        axes.set_xlim(left=0)
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.3)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
