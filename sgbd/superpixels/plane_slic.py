"""Superpixels of even colour on slanted planes, merged until a scene has as few of them as it allows."""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap
from sgbd.frame import Frame
from sgbd.machine.compiled import HAS_NUMBA
from sgbd.machine.reused_memory import reused
from sgbd.machine.side_by_side import bands, side_by_side, thread_count
from sgbd.superpixels.feature_planes import color_memory, gaussian_weights, lab_jobs, label_memory, smoothing_jobs
from sgbd.superpixels.fragments import connected_superpixels
from sgbd.superpixels.local_k_means import Cells, batches
from sgbd.superpixels.region_merging import merge_alike
from sgbd.superpixels.slanted_planes import DISPARITY, PLANES, assign, cluster, work_space, write_inverse_depth
from sgbd.superpixels.slic import Slic
from sgbd.superpixels.slic_fast import say_that_numba_is_missing

SPECK = 8
"""Connected pieces under this many pixels are noise: they join a neighbour before regions are compared."""


class PlaneSlic:
    """One over-segmentation by colour, position and surface: fine at first, then merged if next to nothing is lost.

    Colour and depth are clustered together: a centre is a mean colour, a position and a plane in space (see
    `slanted_planes`). The connected pieces of the clusters are then merged, most similar first (see `region_merging`),
    as long as the squared error hardly rises. So a table or a wall becomes a few superpixels, and clutter gets many.
    Pixels with missing depth are compared by colour and position alone. Intrinsics are not needed.

    The result does not depend on the number of threads. Without Numba, scikit-image's SLIC is used instead.

    Args:
        n_segments: Maximum number of superpixels; scenes of large uniform surfaces get fewer.
        tolerance: Two regions are merged if this raises the squared error of their pixels by at most this much, even
            when there are no more than `n_segments` regions. Colour errors are in units of `compactness`, depth errors
            in units of `depth_noise`. With 0, merging stops at `n_segments`.
        n_cells: Number of centres to start with.
        compactness: Difference in Lab that counts as much as the distance between two centres.
        rgb_sigma: Standard deviation of the Gaussian that smooths the colours, pixels.
        depth_noise: Noise of the depth at one metre, metres. At z metres it is z^2 times as large.
        min_size: Smallest superpixel to keep, pixels; smaller ones are merged into a neighbour.
        iterations: Rounds of assignment and update of the centres.
        subsample: The centres are computed from every `subsample`-th row and column.
        threads: Number of threads. None: one per usable processor, at most 2.

    Raises:
        ValueError: If a number is out of its range.
    """

    def __init__(
        self,
        n_segments: int = 600,
        *,
        tolerance: float = 100.0,
        n_cells: int = 1600,
        compactness: float = 10.0,
        rgb_sigma: float = 1.0,
        depth_noise: float = 0.003,
        min_size: int = 25,
        iterations: int = 2,
        subsample: int = 4,
        threads: int | None = None,
    ) -> None:
        if n_segments < 1 or n_cells < 1 or subsample < 1 or (threads is not None and threads < 1):
            raise ValueError(
                "superpixels: n_segments, n_cells, subsample and threads must be at least 1; "
                f"got n_segments={n_segments}, n_cells={n_cells}, subsample={subsample}, threads={threads}"
            )
        if min(compactness, depth_noise) <= 0 or min(tolerance, rgb_sigma, min_size, iterations) < 0:
            raise ValueError(
                "superpixels: compactness and depth_noise must be above 0, tolerance, rgb_sigma, min_size and "
                f"iterations at least 0; got compactness={compactness}, depth_noise={depth_noise}, "
                f"tolerance={tolerance}, rgb_sigma={rgb_sigma}, min_size={min_size}, iterations={iterations}"
            )
        self.n_segments = n_segments
        self.tolerance = tolerance
        self.n_cells = n_cells
        self.compactness = compactness
        self.rgb_sigma = rgb_sigma
        self.depth_noise = depth_noise
        self.min_size = min_size
        self.iterations = iterations
        self.subsample = subsample
        self.threads = threads
        if not HAS_NUMBA:
            say_that_numba_is_missing()

    def __call__(self, frame: Frame) -> LabelMap:
        """Over-segment a frame.

        Args:
            frame: Any frame.

        Returns:
            int32 [H, W], ids 0..N-1 in raster order of their first pixel, each id one 4-connected region.
        """
        if not HAS_NUMBA:
            # Slic intersects two maps, which gives about three times as many superpixels as each map has.
            return Slic(max(1, self.n_segments // 3), min_size=self.min_size)(frame)
        threads = thread_count(self.threads)
        planes = self._planes(frame, threads)
        labels = self._nearest_centers(planes, threads)
        pieces = connected_superpixels(labels, labels, min(SPECK, self.min_size), threads)
        return merge_alike(pieces, planes, self.n_segments, self.tolerance, self.min_size, threads)

    def _planes(self, frame: Frame, threads: int) -> npt.NDArray[np.float32]:
        """Return the features of the pixels, float32 [4, H, W]: smoothed L, a, b and inverse depth, in their units."""
        height, width = frame.height, frame.width
        rows = bands(height, threads)
        planes = reused("slanted", (PLANES, height, width), np.float32)
        weights = gaussian_weights(self.rgb_sigma)
        smoothed = len(weights) > 1
        lab = color_memory((height, width)) if smoothed else planes[:3]
        depth_scale = np.float32(1 / self.depth_noise)
        jobs = lab_jobs(frame.rgb, self.compactness, lab, rows)
        jobs += [partial(write_inverse_depth, frame.depth, depth_scale, planes[DISPARITY], *band) for band in rows]
        side_by_side(jobs, threads)
        if smoothed:
            side_by_side(smoothing_jobs(lab, weights, planes[:3], rows), threads)
        return planes

    def _nearest_centers(self, planes: npt.NDArray[np.float32], threads: int) -> npt.NDArray[np.int32]:
        """Cluster the pixels and return the nearest centre of each, int32 [H, W]; the next call reuses the array."""
        _, height, width = planes.shape
        cells = Cells.grid(height, width, self.n_cells)
        forms = cluster(planes, cells, self.iterations, self.subsample, threads)
        (labels,) = label_memory((height, width), 1, planes)
        side_by_side(
            [
                partial(assign, planes, batches(cells, *band), cells.near, forms, *work_space(cells), labels)
                for band in bands(len(cells.tops) - 1, threads)
            ],
            threads,
        )
        return labels
