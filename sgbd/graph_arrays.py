"""The superpixel graph of a frame as NumPy arrays: `sgbd.graph.build_graph` without PyTorch and PyG.

Preparation workers and robots build thousands of graphs. This module saves them from loading large libraries, and
keeping these in memory, only for a container class.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import Adjacency, LabelMap, Pairs, border_pairs, checked_pairs
from sgbd.features import Geometry, edge_features, node_features, sums_of_pairs
from sgbd.frame import IGNORE, Frame
from sgbd.label_map import pack
from sgbd.majority import labeled_instance
from sgbd.regions import PAIRS, Borders, Regions, region_and_border_sums

MERGE, CUT, UNKNOWN = 1.0, 0.0, -1.0
"""Values of `edge_label`."""

GraphArrays = dict[str, npt.NDArray[Any] | str]
"""Fields of a graph by name, in the order and format described in `sgbd.graph.build_graph`."""


def graph_arrays(
    frame: Frame,
    label_map: LabelMap,
    adjacency: Adjacency = border_pairs,
    category_names: Sequence[str] = (),
    *,
    store_maps: bool = True,
    sums: tuple[Regions, Borders] | None = None,
) -> GraphArrays:
    """Build the superpixel graph of a frame.

    Arguments, fields and errors are those of `sgbd.graph.build_graph`. A caller that has already computed
    `region_and_border_sums` can pass the result as `sums`.
    """
    if label_map.shape != frame.depth.shape:
        raise ValueError(
            f"the label map has shape {label_map.shape}, the frame {frame.depth.shape}: over-segment this very frame"
        )
    if label_map.min() < 0:
        raise ValueError(
            f"the label map holds the id {label_map.min()}: every pixel belongs to a superpixel, also "
            "one without depth, and their ids are 0..N-1"
        )
    regions, borders = region_and_border_sums(frame, label_map) if sums is None else sums
    if not (regions.pixels > 0).all():
        raise ValueError("the label map skips ids: number its superpixels 0..N-1 (sgbd.superpixels.connect.renumber)")
    area = regions.pixels.astype(np.int64)
    geometry = Geometry(regions, borders, frame.camera)
    pairs = borders.pairs if adjacency is border_pairs else checked_pairs(adjacency(label_map), len(area))
    forward, backward = edge_features(pairs, borders, regions, geometry)
    graph: GraphArrays = {
        "x": node_features(frame, regions, geometry),
        "edge_index": np.concatenate([pairs, pairs[::-1]], axis=1),
        "edge_attr": np.concatenate([forward, backward]),
        "edge_label_index": np.ascontiguousarray(pairs),
        "border_length": sums_of_pairs(pairs, borders)[:, PAIRS].astype(np.float32),
        "area": area,
        "image_size": np.array([[frame.height, frame.width]]),
        "name": frame.name,
    }
    if store_maps:
        graph["label_map"] = pack(label_map)
    if frame.instances is not None:
        graph |= _truth(frame, frame.instances, label_map, pairs, area, category_names)
        if store_maps:
            graph["truth_map"] = pack(frame.instances)
    return graph


def _truth(
    frame: Frame,
    instances: npt.NDArray[np.int32],
    label_map: LabelMap,
    pairs: Pairs,
    area: npt.NDArray[np.int64],
    category_names: Sequence[str],
) -> GraphArrays:
    superpixel, instance, count = overlap_table(label_map, instances)
    majority = labeled_instance(superpixel, instance, count, area)
    known = (majority[pairs[0]] != IGNORE) & (majority[pairs[1]] != IGNORE)
    same = np.where(majority[pairs[0]] == majority[pairs[1]], MERGE, CUT)
    ids = np.unique(instance)
    position = {name: place for place, name in enumerate(category_names, start=1)}
    names = [frame.categories.get(int(key)) for key in ids]
    unknown = sorted({name for name in names if name is not None and category_names and name not in position})
    if unknown:
        raise ValueError(
            f"frame {frame.name!r}: unknown category {', '.join(unknown)}; the dataset has {', '.join(category_names)}"
        )
    return {
        "edge_label": np.where(known, same, UNKNOWN).astype(np.float32),
        "node_instance": majority,
        "overlap_index": superpixel,
        "overlap_instance": instance,
        "overlap_count": count,
        "instance_id": ids,
        "instance_category": np.array([position.get(name or "", 0) for name in names], np.int64),
    }


def overlap_table(
    label_map: LabelMap, instances: npt.NDArray[np.int32]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Count the pixels that every superpixel shares with every instance, without ignored pixels.

    Args:
        label_map: int32 [H, W], ids 0..N-1.
        instances: int32 [H, W], -1 ignore.

    Returns:
        Superpixel, instance and number of shared pixels, int64 [M] each, sorted by superpixel, then by instance.
    """
    # Runs of pixels are sorted, not entered in a table as wide as the largest id, which may be 1000 times a category
    # plus a number. Ids are counted from IGNORE, so that none is negative.
    width = int(instances.max(initial=IGNORE)) - IGNORE + 1
    keys = (label_map.astype(np.int64) * width + instances - IGNORE).ravel()
    starts = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
    present, run = np.unique(keys[starts], return_inverse=True)
    counts = np.bincount(run, np.diff(starts, append=keys.size)).astype(np.int64)
    superpixel, instance = np.divmod(present, width)
    instance += IGNORE
    known = instance != IGNORE
    return superpixel[known], instance[known], counts[known]
