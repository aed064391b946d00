"""Turn any label map into superpixels: connected regions that are not too small."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap, border_lengths


def intersect(first: npt.NDArray[np.integer], second: npt.NDArray[np.integer]) -> npt.NDArray[np.int64]:
    """Intersect two over-segmentations: two pixels share an id if they share one in both.

    Args:
        first: int [H, W], ids from 0.
        second: int [H, W], ids from 0.

    Returns:
        int64 [H, W], ids from 0, not contiguous and not necessarily connected.
    """
    return first.astype(np.int64) * (int(second.max(initial=0)) + 1) + second


def connected_regions(labels: npt.NDArray[np.integer]) -> LabelMap:
    """Give every 4-connected region of equal labels its own id.

    Args:
        labels: int [H, W], any ids >= 0.

    Returns:
        int32 [H, W], ids 0..N-1 in raster order of each region's first pixel.
    """
    from skimage.measure import label  # imported on use: it loads slowly

    return (label(labels, background=-1, connectivity=1) - 1).astype(np.int32)


def merge_fragments(label_map: LabelMap, min_size: int) -> LabelMap:
    """Merge every region under `min_size` pixels into the neighbour with which it shares the longest border.

    Ties go to the larger neighbour, then to the smaller id. If fragments that merged with each other are still too
    small, another round follows, until no fragment is left or one region covers the image.

    Args:
        label_map: int32 [H, W], ids 0..N-1, each one 4-connected region.
        min_size: Smallest region to keep, pixels.

    Returns:
        int32 [H, W], a label map of the same form.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    while True:
        sizes = np.bincount(label_map.ravel())
        small = sizes < min_size
        if not small.any() or len(sizes) == 1:
            return label_map
        pairs, lengths = border_lengths(label_map)
        source = np.concatenate([pairs[0], pairs[1]])
        target = np.concatenate([pairs[1], pairs[0]])
        length = np.concatenate([lengths, lengths])
        candidate = small[source]
        source, target, length = source[candidate], target[candidate], length[candidate]
        order = np.lexsort((target, -sizes[target], -length, source))
        source, target = source[order], target[order]
        chosen = np.ones(len(source), bool)
        chosen[1:] = source[1:] != source[:-1]
        merges = coo_array((np.ones(int(chosen.sum())), (source[chosen], target[chosen])), shape=(len(sizes),) * 2)
        _, group = connected_components(merges, directed=False)
        label_map = renumber(group[label_map])


def renumber(labels: npt.NDArray[np.integer]) -> LabelMap:
    """Renumber ids as 0..N-1 in raster order of their first pixel.

    Args:
        labels: int [H, W], any ids >= 0.

    Returns:
        int32 [H, W].
    """
    flat = labels.ravel()
    first = np.full(int(flat.max(initial=-1)) + 1, flat.size)
    # Written from the last pixel to the first, so that the first pixel of each id overwrites the others.
    first[flat[::-1]] = np.arange(flat.size - 1, -1, -1)
    new = np.empty(len(first), np.int32)
    new[np.argsort(first, kind="stable")] = np.arange(len(first), dtype=np.int32)
    return new[labels]
