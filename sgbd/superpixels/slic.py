"""SLIC on colour and on depth with scikit-image, the over-segmentation of SupeRGB-D."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.frame import Frame
from sgbd.machine.side_by_side import side_by_side
from sgbd.superpixels.fragments import connected_superpixels

Superpixels = Callable[[Frame], LabelMap]
"""Map a frame to a label map: int32 [H, W], ids 0..N-1, each id one 4-connected region."""

DEPTH_PERCENTILE = 98
"""Depth is clipped at this percentile; otherwise one far wall would set the scale of everything on the table."""

NARROWEST = 0.125
"""Standard deviation, pixels, below which scikit-image cuts a Gaussian off to a single weight of 1."""


class Slic:
    """The intersection of a SLIC over-segmentation of the colours and one of the depth.

    The intersection is not connected, so each of its connected pieces becomes a region. Pieces under `min_size` pixels
    are merged into the neighbour with the longest common border.

    Scaling does not rely on scikit-image, whose scaling differs between versions: colours are stretched to [0, 1] and
    converted to Lab; depth is clipped at its 98th percentile and stretched to [0, 1] over its valid pixels. Before
    clustering, missing depth is filled with the nearest valid pixel of its row, so that zeros do not pull cluster
    centres.

    Sources: Achanta et al., TPAMI 2012, DOI 10.1109/TPAMI.2012.120; Örnek et al., RA-L 2023, arXiv 2212.11922.

    Args:
        n_segments: Superpixels requested from each of the two; their intersection has about three times as many.
        rgb: Over-segment by colour.
        depth: Over-segment by depth.
        rgb_compactness: Weight of distance in the image against distance in Lab.
        rgb_sigma: Standard deviation of the Gaussian that smooths the colours, pixels.
        depth_compactness: Weight of distance in the image against distance in scaled depth.
        depth_sigma: Standard deviation of the Gaussian that smooths the depth, pixels.
        min_size: Smallest superpixel to keep, pixels; smaller ones are merged into a neighbour.

    Raises:
        ValueError: If both `rgb` and `depth` are false, or a number is out of its range.
    """

    def __init__(
        self,
        n_segments: int = 128,
        *,
        rgb: bool = True,
        depth: bool = True,
        rgb_compactness: float = 10.0,
        rgb_sigma: float = 1.0,
        depth_compactness: float = 0.08,
        depth_sigma: float = 0.01,
        min_size: int = 25,
    ) -> None:
        if not (rgb or depth):
            raise ValueError("superpixels need rgb=true or depth=true: there is nothing to over-segment by")
        if n_segments < 1:
            raise ValueError(f"superpixels.n_segments must be at least 1; got {n_segments}")
        if min(rgb_compactness, depth_compactness) <= 0 or min(rgb_sigma, depth_sigma) < 0:
            raise ValueError("superpixels: compactness must be positive and sigma not negative")
        self.n_segments = n_segments
        self.rgb = rgb
        self.depth = depth
        self.rgb_compactness = rgb_compactness
        self.rgb_sigma = rgb_sigma
        self.depth_compactness = depth_compactness
        self.depth_sigma = depth_sigma
        self.min_size = min_size

    def __call__(self, frame: Frame) -> LabelMap:
        """Over-segment a frame.

        Args:
            frame: Any frame. One with fewer pixels than `n_segments` gets at most one superpixel per pixel.

        Returns:
            int32 [H, W], ids 0..N-1, each id one 4-connected region.
        """
        jobs: list[Callable[[], npt.NDArray[np.integer]]] = []
        if self.rgb:
            jobs.append(lambda: self._rgb_labels(frame.rgb))
        if self.depth:
            jobs.append(lambda: self._depth_labels(frame.depth))
        # scikit-image's SLIC releases the interpreter lock.
        labels = [found.astype(np.int32) for found in side_by_side(jobs, len(jobs))]
        return connected_superpixels(labels[0], labels[-1], self.min_size)

    def _rgb_labels(self, rgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.integer]:
        from skimage.segmentation import slic  # imported on use: it loads slowly

        return slic(
            stretch(rgb.astype(np.float32)),
            n_segments=self.n_segments,
            compactness=self.rgb_compactness,
            sigma=self.rgb_sigma,
            start_label=0,
            channel_axis=-1,
        )

    def _depth_labels(self, depth: npt.NDArray[np.float32]) -> npt.NDArray[np.integer]:
        from skimage.segmentation import slic  # imported on use: it loads slowly

        return slic(
            scaled_depth(depth),
            n_segments=self.n_segments,
            compactness=self.depth_compactness,
            # Below that width, smoothing would change nothing but the time.
            sigma=self.depth_sigma if self.depth_sigma >= NARROWEST else 0,
            start_label=0,
            channel_axis=None,
        )


def scaled_depth(depth: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Scale depth for clustering: fill holes, clip at the 98th percentile, stretch to [0, 1].

    Args:
        depth: float32 [H, W], metres, 0 = missing.

    Returns:
        float32 [H, W] in [0, 1].
    """
    valid = depth > 0
    ceiling = np.float32(np.percentile(depth[valid], DEPTH_PERCENTILE)) if valid.any() else np.float32(0)
    return stretch(np.minimum(filled_depth(depth), ceiling))


def filled_depth(depth: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Fill missing depth with the nearest valid pixel of its row; rows without any copy the nearest row that has one.

    Args:
        depth: float32 [H, W], metres, 0 = missing.

    Returns:
        float32 [H, W], without zeros unless all depth is missing.
    """
    valid = depth > 0
    if not valid.any():
        return depth.copy()
    rows = np.take_along_axis(depth, _nearest(valid), axis=1)
    # A row without any copies the nearest row that has one.
    known = np.atleast_2d(valid.any(axis=1))
    filled: npt.NDArray[np.float32] = rows[_nearest(known)[0]]
    return filled


def _nearest(valid: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    """Return the column of the nearest True of each element's row, the left one on a tie; any column if there is none.

    Args:
        valid: bool [R, W].

    Returns:
        intp [R, W].
    """
    width = valid.shape[1]
    columns = np.arange(width)
    left = np.maximum.accumulate(np.where(valid, columns, -1), axis=1)
    right = np.minimum.accumulate(np.where(valid, columns, width)[:, ::-1], axis=1)[:, ::-1]
    nearer_left = (right == width) | ((left >= 0) & (columns - left <= right - columns))
    return np.clip(np.where(nearer_left, left, right), 0, width - 1)


def stretch(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Stretch values to [0, 1]; if all are equal, return zeros."""
    low, high = values.min(), values.max()
    return (values - low) / (high - low) if high > low else np.zeros_like(values)
