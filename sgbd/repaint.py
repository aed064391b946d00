"""Relabelling of label maps, for example from superpixels to segments or instances."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.machine.compiled import HAS_NUMBA, compiled
from sgbd.machine.side_by_side import bands, side_by_side, thread_count

if TYPE_CHECKING:
    from torch_geometric.data import Data

    from sgbd.graph_tensors import GraphTensors


def repaint(label_map: LabelMap, names: npt.NDArray[np.integer], threads: int | None = None) -> LabelMap:
    """Replace every id of a label map by a new id.

    Args:
        label_map: int32 [H, W], ids 0..N-1.
        names: int [N], the new id of each old id.
        threads: Number of threads. None: one per usable processor, at most 2.

    Returns:
        int32 [H, W].

    Raises:
        IndexError: If the label map contains an id of N or more.
    """
    new: npt.NDArray[np.int32] = np.ascontiguousarray(names, np.int32)
    if label_map.size and int(label_map.max()) >= len(new):
        raise IndexError(f"there are {len(new)} new ids, but the label map has the id {int(label_map.max())}")
    painted: LabelMap = np.empty(label_map.shape, np.int32)
    if HAS_NUMBA:
        old, threads = np.ascontiguousarray(label_map).reshape(-1), thread_count(threads)
        jobs = [partial(_repaint, old, new, painted.reshape(-1), *band) for band in bands(old.size, threads)]
        side_by_side(jobs, threads)
    else:
        painted[...] = new[label_map]
    return painted


def node_map(label_map: LabelMap, data: Data | GraphTensors) -> LabelMap:
    """Return the label map of a graph's nodes.

    Args:
        label_map: int32 [H, W], the superpixels that the graph was built from.
        data: The graph.

    Returns:
        int32 [H, W]: the superpixels themselves, or the segments of a first stage (`sgbd.agglomeration`).
    """
    node_of_superpixel = getattr(data, "node_of_superpixel", None)
    if node_of_superpixel is None:
        return label_map
    return repaint(label_map, node_of_superpixel.cpu().numpy())


@compiled
def _repaint(labels, names, painted, first, last):  # type: ignore[no-untyped-def]
    for k in range(first, last):
        painted[k] = names[labels[k]]
