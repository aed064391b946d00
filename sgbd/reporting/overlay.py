"""Paint instances over an image."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from skimage.color import hsv2rgb
from skimage.segmentation import find_boundaries

from sgbd.frame import SUPPORT
from sgbd.metrics.label_index import distinct_labels, label_index

GOLDEN_RATIO = 0.618033988749895
SUPPORT_COLOR = (0.55, 0.55, 0.55)
IGNORE_COLOR = (0.15, 0.15, 0.15)


def instance_colors(number: npt.NDArray[np.integer]) -> npt.NDArray[np.float64]:
    """Return colours of a fixed sequence, in which they are easy to tell apart.

    Args:
        number: int [K], places in the sequence, from 0.

    Returns:
        float64 [K, 3], RGB from 0 to 1.
    """
    # Golden-ratio steps around the colour circle spread the hues evenly for any count.
    hue = (0.07 + number * GOLDEN_RATIO) % 1
    saturation = np.array([0.85, 0.6, 0.95])[number % 3]
    value = np.array([0.95, 0.8, 0.65, 0.9])[number % 4]
    return hsv2rgb(np.stack([hue, saturation, value], axis=1)) if len(number) else np.zeros((0, 3))


def overlay(
    rgb: npt.NDArray[np.uint8], instances: npt.NDArray[np.int32], first: int = 1, opacity: float = 0.55
) -> npt.NDArray[np.uint8]:
    """Paint instances over an image, with white outlines.

    Args:
        rgb: uint8 [H, W, 3].
        instances: int32 [H, W]. Ids from `first` on are painted. With ground truth (`first` = 2), the supporting
            surface is painted grey and ignored pixels dark.
        first: Smallest object id.
        opacity: From 0 (only the image) to 1 (only the colours).

    Returns:
        uint8 [H, W, 3].
    """
    # Only the ids that occur: they may be large.
    ids = distinct_labels(instances)
    objects = ids >= first
    table = np.zeros((len(ids), 4))
    table[objects, :3] = instance_colors(ids[objects] - first)
    table[objects, 3] = opacity
    table[~objects & (ids == SUPPORT)] = (*SUPPORT_COLOR, opacity / 2)
    table[~objects & (ids < 0)] = (*IGNORE_COLOR, opacity)
    kept, paint = 1 - table[:, 3:], table[:, :3] * table[:, 3:]
    mixed = rgb.copy()
    pixels = mixed.reshape(-1, 3)
    index = label_index(instances, ids).ravel()
    painted = np.flatnonzero(table[:, 3].astype(bool)[index])
    index = index[painted]
    blend = pixels[painted] / 255 * kept[index] + paint[index]
    pixels[painted] = (blend * 255).round().astype(np.uint8)
    mixed[find_boundaries(np.maximum(instances, first - 1), mode="inner", connectivity=1)] = 255
    return mixed
