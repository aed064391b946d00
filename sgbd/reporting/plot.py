"""Draw frames, superpixels, classified edges, segmentations and training curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from skimage.segmentation import find_boundaries

from sgbd.failures import Failures
from sgbd.frame import SUPPORT, Frame
from sgbd.reporting.overlay import overlay
from sgbd.reporting.score_titles import score_title
from sgbd.segmentation import Segmentation


def segmentation_figure(frame: Frame, segmentation: Segmentation, title: str = "") -> Figure:
    """Draw a frame with its superpixels, edges, predicted instances and ground truth.

    Args:
        frame: The frame; its ground truth is drawn if present.
        segmentation: Its segmentation.
        title: Title of the figure.

    Returns:
        A figure of six panels: colours, depth, superpixels, merge probability of the edges, prediction, ground truth.
    """
    figure = Figure(figsize=(13.5, 8.2 * frame.height / frame.width + 1), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, 3).ravel()
    panels[0].imshow(frame.rgb)
    panels[0].set_title("colour")
    depth = np.where(frame.depth > 0, frame.depth, np.nan)
    picture = panels[1].imshow(depth, cmap="viridis", vmax=np.nanpercentile(depth, 98))
    panels[1].set_title("depth (blank: missing)")
    figure.colorbar(picture, ax=panels[1], label="metres", fraction=0.04, pad=0.01)
    panels[2].imshow(with_boundaries(frame.rgb, segmentation.superpixels))
    panels[2].set_title(segmentation.described_nodes)
    draw_edges(panels[3], frame, segmentation)
    figure.colorbar(
        ScalarMappable(Normalize(0, 1), "RdYlGn"), ax=panels[3], label="merge probability", fraction=0.04, pad=0.01
    )
    panels[4].imshow(overlay(frame.rgb, segmentation.instances))
    panels[4].set_title(f"predicted objects: {len(segmentation.scores)}")
    if frame.instances is not None:
        panels[5].imshow(overlay(frame.rgb, frame.instances, first=SUPPORT + 1))
        panels[5].set_title(f"true objects: {len(np.unique(frame.instances[frame.instances > SUPPORT]))}")
    for panel in panels:
        panel.set_axis_off()
    figure.suptitle(title or frame.name)
    return figure


def with_boundaries(rgb: npt.NDArray[np.uint8], label_map: npt.NDArray[np.int32]) -> npt.NDArray[np.uint8]:
    """Draw superpixel boundaries over an image.

    Args:
        rgb: uint8 [H, W, 3].
        label_map: int32 [H, W].

    Returns:
        uint8 [H, W, 3].
    """
    picture = rgb.copy()
    picture[find_boundaries(label_map, mode="inner", connectivity=1)] = (255, 220, 0)
    return picture


def draw_edges(panel: Axes, frame: Frame, segmentation: Segmentation, width: float = 1.3) -> None:
    """Draw the edges between superpixel centres, from red (cut) through yellow to green (merge).

    Args:
        panel: Axes to draw on.
        frame: The frame, drawn darkened behind the edges.
        segmentation: Its segmentation.
        width: Line width, points.
    """
    flat = segmentation.superpixels.ravel()
    rows, columns = np.divmod(np.arange(flat.size), frame.width)
    count = np.bincount(flat)
    center = np.stack([np.bincount(flat, columns), np.bincount(flat, rows)], axis=1) / count[:, None]
    panel.imshow((frame.rgb * 0.45).astype(np.uint8))
    lines = LineCollection(list(center[segmentation.edge_index.T]), cmap="RdYlGn", norm=Normalize(0, 1))
    lines.set_linewidth(width)
    lines.set_array(segmentation.edge_probability)
    panel.add_collection(lines)
    panel.set_title(f"{segmentation.edge_index.shape[1]} edges")


def frames_figure(rows: Sequence[tuple[str, Frame, Segmentation]]) -> Figure:
    """Draw one row per frame: colours, superpixels, edges coloured by merge probability, prediction, ground truth.

    Args:
        rows: Title, frame and segmentation of each row.

    Returns:
        The figure.
    """
    figure, grid = _grid(rows[0][1], len(rows), 5)
    for panels, (title, frame, segmentation) in zip(grid, rows, strict=True):
        panels[0].imshow(frame.rgb)
        panels[0].set_title(f"{title} ({frame.name})", fontsize=8)
        panels[1].imshow(with_boundaries(frame.rgb, segmentation.superpixels))
        panels[1].set_title(segmentation.described_nodes, fontsize=8)
        draw_edges(panels[2], frame, segmentation, width=0.7)
        panels[2].set_title("merge probability: red 0, green 1", fontsize=8)
        panels[3].imshow(overlay(frame.rgb, segmentation.instances))
        panels[3].set_title(f"predicted objects: {len(segmentation.scores)}", fontsize=8)
        _draw_truth(panels[4], frame)
    return figure


def methods_figure(rows: Sequence[tuple[str, Frame]], predictions: Mapping[str, Sequence[npt.NDArray]]) -> Figure:
    """Draw the predictions of several methods side by side, between the frame and its ground truth.

    Args:
        rows: Title and frame of each row.
        predictions: Label maps of all rows by method, int32 [H, W], 0 = no object.

    Returns:
        The figure.
    """
    figure, grid = _grid(rows[0][1], len(rows), 2 + len(predictions))
    for place, (panels, (title, frame)) in enumerate(zip(grid, rows, strict=True)):
        panels[0].imshow(frame.rgb)
        panels[0].set_title(f"{title} ({frame.name})", fontsize=8)
        for panel, (method, maps) in zip(panels[1:-1], predictions.items(), strict=True):
            panel.imshow(overlay(frame.rgb, _renumbered(maps[place])))
            panel.set_title(method, fontsize=8)
        _draw_truth(panels[-1], frame)
    return figure


def worst_frame_figure(frame: Frame, prediction: npt.NDArray[np.int32], failures: Failures) -> Figure:
    """Draw a frame, its prediction, and the ground truth annotated with the kind of each failure.

    Args:
        frame: The frame, with ground truth.
        prediction: int32 [H, W], 0 = no object.
        failures: The failures in the frame.

    Returns:
        The figure.
    """
    figure, grid = _grid(frame, 1, 3, width=4.6)
    colors, predicted, truth = grid[0]
    colors.imshow(frame.rgb)
    colors.set_title(frame.name, fontsize=8)
    predicted.imshow(overlay(frame.rgb, _renumbered(prediction)))
    false = f", {len(failures.false_objects)} of them table" if failures.false_objects else ""
    predicted.set_title(f"prediction: {failures.predicted} objects{false}", fontsize=8)
    _draw_truth(truth, frame)
    assert frame.instances is not None
    for instance, kind in failures.kind_of_object.items():
        row, column = np.argwhere(frame.instances == instance).mean(axis=0)
        box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
        truth.text(column, row, kind, fontsize=6, ha="center", va="center", bbox=box)
    return figure


def _grid(frame: Frame, rows: int, columns: int, width: float = 3.0) -> tuple[Figure, npt.NDArray]:
    """Create a grid of panels without axes, with the aspect ratio of a frame and `width` inches wide each."""
    height = width * frame.height / frame.width + 0.25
    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False)
    for panel in grid.ravel():
        panel.set_axis_off()
    return figure, grid


def _draw_truth(panel: Axes, frame: Frame) -> None:
    if frame.instances is not None:
        panel.imshow(overlay(frame.rgb, frame.instances, first=SUPPORT + 1))
        panel.set_title(f"true objects: {len(np.unique(frame.instances[frame.instances > SUPPORT]))}", fontsize=8)


def _renumbered(label_map: npt.NDArray) -> npt.NDArray[np.int32]:
    """Renumber objects from 1 without gaps, so that their colours differ; 0 stays 0."""
    _, index = np.unique(np.append(label_map.ravel(), 0), return_inverse=True)
    return index[:-1].reshape(label_map.shape).astype(np.int32)


def curves_figure(curves: Mapping[str, Sequence[tuple[float, float]]], title: str = "") -> Figure:
    """Plot training curves, losses in the left panel and scores in the right one.

    Args:
        curves: Points (epoch, value) by curve name; curves with "loss" in their name go to the left panel.
        title: Title of the figure.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(10, 4), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    for name, points in curves.items():
        panel = left if "loss" in name else right
        epochs, values = zip(*points, strict=True) if points else ((), ())
        panel.plot(epochs, values, marker="o", markersize=3, label=name)
    for panel, label in ((left, "loss"), (right, "score")):
        panel.set_xlabel("epoch")
        panel.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        panel.set_ylabel(label)
        panel.grid(alpha=0.3)
        if panel.get_lines():
            panel.legend(fontsize="small")
    figure.suptitle(title)
    return figure


def history_figure(history: pd.DataFrame, title: str = "") -> Figure:
    """Plot the main training curves.

    Args:
        history: One row per epoch, as written by `sgbd.training.Trainer` to `history.csv`.
        title: Title of the figure.

    Returns:
        The figure.
    """
    shown = ("loss", "edge_loss", "objectness_loss", "val/overlap_f", "val/unaided/overlap_f", "val/oracle/overlap_f")
    curves = {
        score_title(name): list(zip(history["epoch"], history[name], strict=True)) for name in shown if name in history
    }
    return curves_figure(curves, title)
