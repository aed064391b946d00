"""Label maps with other ids: how superpixels become regions, segments or instances in the image."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.compiled import HAS_NUMBA, compiled


def repaint(label_map: LabelMap, names: npt.NDArray[np.integer]) -> LabelMap:
    """Give every pixel the new id of its label.

    Args:
        label_map: int32 [H, W], ids 0..N-1.
        names: int [N], the new id of each.

    Returns:
        int32 [H, W].
    """
    new: npt.NDArray[np.int32] = np.ascontiguousarray(names, np.int32)
    if label_map.size and int(label_map.max()) >= len(new):
        raise IndexError(f"there are {len(new)} new ids, but the label map has the id {int(label_map.max())}")
    painted: LabelMap = np.empty(label_map.shape, np.int32)
    if HAS_NUMBA:
        _repaint(np.ascontiguousarray(label_map).reshape(-1), new, painted.reshape(-1))
    else:
        painted[...] = new[label_map]
    return painted


@compiled
def _repaint(labels, names, painted):  # type: ignore[no-untyped-def]
    for k in range(len(labels)):
        painted[k] = names[labels[k]]
