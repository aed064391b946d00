"""Time the stages from a frame to its objects."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from typing import Any

import numpy as np

from sgbd.benchmarking.frames import RawFrame
from sgbd.benchmarking.timing import Stopwatch
from sgbd.features import Geometry, edge_features, node_features
from sgbd.frame import Frame
from sgbd.regions import region_and_border_sums
from sgbd.repaint import node_map
from sgbd.segmentation import Segmentation, classify, paint, partition_graph
from sgbd.segmenter import Segmenter

STAGES = ("validation", "superpixels", "graph", "model", "partition", "painting")
"""Processing stages of a frame, in order."""

WHOLE = "whole frame"
SUM = "sum of stages"

AFTER_SUPERPIXELS = "after superpixels"
"""Sum of the stages after the superpixels."""

SUPERPIXEL_PARTS = ("colours alone", "depth alone")
GRAPH_PARTS = ("sums over pixels", "geometry", "node features", "edge features")


def segment_in_stages(segmenter: Segmenter, raw: RawFrame, stopwatch: Stopwatch) -> Segmentation:
    """Segment a frame as `Segmenter.segment` does, timing each stage.

    Args:
        segmenter: The segmenter.
        raw: The frame.
        stopwatch: Records the time of each of `STAGES`.

    Returns:
        The segmentation.
    """
    with stopwatch.step("validation"):
        whole = Frame(raw.rgb, raw.depth, raw.intrinsics)  # type: ignore[arg-type]
        frame = segmenter.reduced(whole)
    with stopwatch.step("superpixels"):
        label_map = segmenter.superpixels(frame)
    with stopwatch.step("graph"):
        data = segmenter.graph_tensors(frame, label_map)
    with stopwatch.step("model"):
        classification = classify(segmenter.model, segmenter.objectness, data)
    with stopwatch.step("partition"):
        segments = partition_graph(data, classification, segmenter.partition, segmenter.rule, segmenter.calibration)
    with stopwatch.step("painting"):
        return paint(segmenter.enlarged(node_map(label_map, data), whole), data, classification, segments)


def measure_stages(segmenter: Segmenter, frames: list[RawFrame], repeats: Iterable[int]) -> Stopwatch:
    """Time whole frames, their stages, and parts of the two longest stages, in turns.

    Args:
        segmenter: The segmenter.
        frames: The frames to cycle through.
        repeats: Repetition numbers, or a progress bar around them.

    Returns:
        Times of `STAGES`, of the whole frame in one call (`WHOLE`), and, named "- part", of parts that can be measured
        separately: superpixels of one modality, and the steps of graph construction.
    """
    singles = one_modality(segmenter.superpixels)
    stopwatch, warm_up = Stopwatch(), Stopwatch()

    def once(raw: RawFrame, stopwatch: Stopwatch) -> None:
        with stopwatch.step(WHOLE):
            segmenter.segment(raw.rgb, raw.depth, raw.intrinsics)
        found = segment_in_stages(segmenter, raw, stopwatch)
        frame = segmenter.reduced(Frame(raw.rgb, raw.depth, raw.intrinsics))  # type: ignore[arg-type]
        superpixels = np.ascontiguousarray(found.superpixels[:: segmenter.reduce, :: segmenter.reduce])
        for name, single in singles.items():
            with stopwatch.step(f"- {name}"):
                single(frame)
        with stopwatch.step(f"- {GRAPH_PARTS[0]}"):
            regions, borders = region_and_border_sums(frame, superpixels)
        with stopwatch.step(f"- {GRAPH_PARTS[1]}"):
            geometry = Geometry(regions, borders, frame.camera)
        with stopwatch.step(f"- {GRAPH_PARTS[2]}"):
            node_features(frame, regions, geometry)
        with stopwatch.step(f"- {GRAPH_PARTS[3]}"):
            edge_features(borders.pairs, borders, regions, geometry)

    # Two warm-ups: the first compiles, the second fills the memory pools of the allocators.
    for _ in range(2):
        once(frames[0], warm_up)
    for number in repeats:
        once(frames[number % len(frames)], stopwatch)
    return stopwatch


def one_modality(superpixels: Any) -> dict[str, Any]:
    """Return the same superpixels on colours only and on depth only; empty if they do not use both."""
    if not (getattr(superpixels, "rgb", False) is True and getattr(superpixels, "depth", False) is True):
        return {}
    colors, depth = copy.copy(superpixels), copy.copy(superpixels)
    colors.depth, depth.rgb = False, False
    return dict(zip(SUPERPIXEL_PARTS, (colors, depth), strict=True))


def stage_rows(stopwatch: Stopwatch) -> list[dict[str, Any]]:
    """Convert the times of `measure_stages` to table rows: stages followed by their parts, sums, whole frame.

    Args:
        stopwatch: The times.

    Returns:
        Rows with `stage` and the columns of `Timing.row`.
    """
    timings = stopwatch.timings()
    parts = {"superpixels": SUPERPIXEL_PARTS, "graph": GRAPH_PARTS}
    rows = []
    for stage in STAGES:
        names = [stage, *(f"- {part}" for part in parts.get(stage, ()))]
        rows += [{"stage": name, **timings[name].row()} for name in names if name in timings]
    rows.append({"stage": AFTER_SUPERPIXELS, **stopwatch.sums(STAGES[2:]).row()})
    rows.append({"stage": SUM, **stopwatch.sums(STAGES).row()})
    rows.append({"stage": WHOLE, **timings[WHOLE].row()})
    return rows
