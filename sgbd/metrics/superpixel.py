"""Scores of an over-segmentation.

They are defined as in D. Stutz, A. Hermans, B. Leibe, "Superpixels: an evaluation of the state-of-the-art", CVIU 2018,
doi:10.1016/j.cviu.2017.03.007. Scores that compare with the ground truth leave out ignored pixels; most are computed
from the contingency table of superpixels and instances.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.frame import IGNORE
from sgbd.metrics.contingency import ContingencyTable
from sgbd.metrics.label_index import as_label_map


def achievable_segmentation_accuracy(table: ContingencyTable) -> float:
    """Return the share of pixels that are right if every superpixel takes its majority instance; 1 without pixels.

    M.-Y. Liu, O. Tuzel, S. Ramalingam, R. Chellappa, "Entropy rate superpixel segmentation", CVPR 2011.

    Args:
        table: The contingency table of superpixels (as segments) and instances.
    """
    return float(table.counts.max(axis=1).sum() / table.total) if table.total else 1.0


def undersegmentation_error(table: ContingencyTable) -> float:
    """Return how much superpixels leak over the borders of instances, as a share of all pixels; 0 without pixels.

    For every instance and every superpixel that touches it, the error is the smaller of the superpixel's parts inside
    and outside the instance. P. Neubert, P. Protzel, "Superpixel benchmark and comparison", Forum Bildverarbeitung
    2012.

    Args:
        table: The contingency table of superpixels (as segments) and instances.
    """
    if not table.total:
        return 0.0
    outside = table.segment_area[:, None] - table.counts
    return float(np.minimum(table.counts, outside).sum() / table.total)


def boundary_recall(label_map: ArrayLike, truth: ArrayLike, tolerance: int | None = None) -> float:
    """Return the share of ground-truth border pixels near a superpixel border; 1 if there are no ground-truth borders.

    A border pixel is one whose right or lower neighbour has another label. Two neighbours of which one is ignored form
    no ground-truth border. D. R. Martin, C. C. Fowlkes, J. Malik, "Learning to detect natural image boundaries using
    local brightness, color, and texture cues", TPAMI 2004, doi:10.1109/TPAMI.2004.1273918.

    Args:
        label_map: Integers [H, W], superpixels.
        truth: Integers [H, W], ground-truth instances, -1 = ignore.
        tolerance: A border is near if it lies within a square of 2 · tolerance + 1 pixels; by default 0.0025 of the
            image diagonal, rounded (2 for 640 x 480).
    """
    from scipy.ndimage import maximum_filter  # imported on use: segmenting imports the metrics but not SciPy

    label_map = as_label_map(label_map, "the label map")
    truth = as_label_map(truth, "the truth", lowest=IGNORE)
    if label_map.shape != truth.shape:
        raise ValueError(
            f"label map and truth must have one shape, got {list(label_map.shape)} and {list(truth.shape)}"
        )
    if tolerance is None:
        tolerance = round(0.0025 * float(np.hypot(*truth.shape)))
    true_border = _border(truth, truth != IGNORE)
    if not true_border.any():
        return 1.0
    border = _border(label_map, np.ones(label_map.shape, dtype=bool))
    near = maximum_filter(border, size=2 * tolerance + 1, mode="constant", cval=False)
    return float(near[true_border].mean())


def explained_variation(label_map: ArrayLike, image: ArrayLike, valid: ArrayLike | None = None) -> float:
    """Return the share of an image's variance that the superpixels' means explain; 1 if the image is constant.

    A. P. Moore, S. J. D. Prince, J. Warrell, U. Mohammed, G. Jones, "Superpixel lattices", CVPR 2008.

    Args:
        label_map: Integers [H, W], superpixels.
        image: [H, W] or [H, W, C], in any unit. Variances are summed over channels, so these should have one scale.
        valid: bool [H, W], the pixels to use, for instance ``depth > 0``; by default all.
    """
    label_map = as_label_map(label_map, "the label map")
    channels = np.asarray(image, dtype=np.float64).reshape(*label_map.shape, -1)
    keep = np.ones(label_map.shape, dtype=bool) if valid is None else np.asarray(valid, dtype=bool)
    label, value = label_map[keep], channels[keep]
    if not len(value):
        return 1.0
    value = value - value.mean(axis=0)
    total = float((value**2).sum())
    if total == 0:
        return 1.0
    area = np.bincount(label)
    sums = np.stack([np.bincount(label, weights=channel) for channel in value.T], axis=1)
    occurs = area > 0
    return float((sums[occurs] ** 2 / area[occurs, None]).sum() / total)


def _border(label_map: NDArray[np.integer], known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which pixels, bool [H, W], have a right or lower neighbour with another label, both being known."""
    border = np.zeros(label_map.shape, dtype=bool)
    border[:, :-1] |= (label_map[:, :-1] != label_map[:, 1:]) & known[:, :-1] & known[:, 1:]
    border[:-1] |= (label_map[:-1] != label_map[1:]) & known[:-1] & known[1:]
    return border
