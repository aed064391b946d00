"""Write the results of an evaluation: tables of scores, and pictures of good, average and bad frames."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from sgbd.evaluation import Evaluation, score_table
from sgbd.machine.atomic_file import write_whole
from sgbd.machine.progress_bar import ProgressBar
from sgbd.reporting.panels import GALLERY_FOLDER, write_index, write_panels
from sgbd.reporting.plot import segmentation_figure
from sgbd.reporting.reliability import reliability_figure
from sgbd.reporting.score_titles import score_title
from sgbd.segmenter import Segmenter
from sgbd.sources import FrameSource

PICTURE_DPI = 90


def write_evaluation(evaluation: Evaluation, folder: Path) -> None:
    """Write `scores.json`, `scores.md` and `frames.csv`, and, if available, `categories.csv` and `reliability.png`.

    Args:
        evaluation: The scores.
        folder: Output folder; created if needed.
    """
    write_whole(folder / "scores.json", json.dumps(evaluation.scores, indent=2).encode())
    write_whole(folder / "scores.md", f"{markdown(evaluation)}\n".encode())
    write_whole(folder / "frames.csv", evaluation.frames.to_csv().encode())
    if len(evaluation.categories):
        write_whole(folder / "categories.csv", evaluation.categories.to_csv().encode())
    if len(evaluation.objects):
        score, right = (evaluation.objects[name].to_numpy() for name in ("score", "right"))
        write_figure(reliability_figure(score, right.astype(bool)), folder / "reliability.png")


def markdown(evaluation: Evaluation) -> str:
    """Return the scores in per cent as a Markdown table with one row per protocol."""
    table = score_table(evaluation.scores)
    cells = table.map(lambda value: "–" if np.isnan(value) else f"{value:.1f}")
    cells.columns = [score_title(str(name)) for name in table]
    return cells.to_markdown(disable_numparse=True, colalign=["left"] + ["right"] * len(table.columns))


def example_frames(evaluation: Evaluation, count: int) -> list[str]:
    """Choose example frames, evenly spread from the worst to the best.

    Args:
        evaluation: The scores.
        count: Maximum number of frames.

    Returns:
        Names of at most `count` frames, worst first.
    """
    ranked = evaluation.frames["overlap_f_measure"].sort_values(kind="stable").index
    places = np.unique(np.linspace(0, len(ranked) - 1, min(count, len(ranked))).round().astype(int))
    return [str(ranked[place]) for place in places]


def draw_examples(
    names: Sequence[str], evaluation: Evaluation, source: FrameSource, segmenter: Segmenter, folder: Path
) -> list[Path]:
    """Draw frames with superpixels, edges, prediction and ground truth.

    Overviews with all panels go to `pictures/`, single panels to `gallery/`.

    Args:
        names: Names of the frames.
        evaluation: The scores, shown above each picture.
        source: The frames.
        segmenter: The segmenter.
        folder: Folder of the evaluation.

    Returns:
        The overview files.
    """
    index = {name: place for place, name in enumerate(source.names)}
    pictures, shown = [], []
    for rank, name in enumerate(ProgressBar(names, "drawing", unit="frame")):
        frame = source[index[name]]
        row = evaluation.frames.loc[name]
        segmentation = segmenter.segment_frame(frame)
        title = f"{name}: overlap F {100 * row['overlap_f_measure']:.1f} of the merging alone"
        if "unaided_overlap_f_measure" in row:
            title += f", {100 * row['unaided_overlap_f_measure']:.1f} unaided, as drawn"
        if "oracle_overlap_f_measure" in row:
            best = 100 * row["oracle_overlap_f_measure"]
            title += f" (best partition of these {segmentation.kind_of_nodes} {best:.1f})"
        figure = segmentation_figure(frame, segmentation, title)
        stem = f"{rank + 1}_{name.replace('/', '_')}"
        pictures.append(write_figure(figure, folder / "pictures" / f"{stem}.png"))
        shown.append(write_panels(frame, segmentation, source.seen, folder / GALLERY_FOLDER, stem))
    if shown:
        write_index(shown, folder / GALLERY_FOLDER)
    return pictures


def write_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG, atomically; its folder is created if needed."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=PICTURE_DPI)
    write_whole(path, picture.getvalue())
    return path
