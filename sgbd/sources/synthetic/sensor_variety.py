"""Simulate many kinds of depth cameras, so that a model trained on the frames generalises across cameras."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, median_filter

from sgbd.frame import SUPPORT
from sgbd.sources.synthetic.log_uniform import log_uniform
from sgbd.sources.synthetic.render import Rendering
from sgbd.sources.synthetic.sensor import StructuredLight, depth_edges, shadow

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]

EXACT, STRUCTURED = 0.15, 0.55
"""Shares of frames with exact depth and with structured light; the rest is stereo."""


def recorded_by_any_camera(
    rgb: npt.NDArray[np.uint8], rendering: Rendering, focal: float, rng: np.random.Generator
) -> tuple[npt.NDArray[np.uint8], Floats]:
    """Record a view with a randomly drawn camera.

    Besides camera type and noise level, several effects are drawn: surfaces without depth (black, shiny), removal of
    everything beyond the table as in some object datasets, smoothing of the measured depth, and a misalignment of one
    or two pixels between colours and depth.

    Args:
        rgb: uint8 [H, W, 3], the colour image.
        rendering: The rendered view.
        focal: Focal length, pixels.
        rng: Random generator.

    Returns:
        Colour uint8 [H, W, 3] and depth float32 [H, W], metres, 0 = missing.
    """
    kind = rng.random()
    if kind < EXACT:
        depth = rendering.depth.copy()
    elif kind < EXACT + STRUCTURED:
        depth = _structured_light(rng).measure(rendering.depth, rendering.facing, focal, rng)
    else:
        depth = _stereo(rendering, focal, rng)
    if kind >= EXACT:
        depth[_dead_surfaces(rendering.label, rng)] = 0
        if rng.random() < 0.3:
            depth = _smoothed(depth)
    if rng.random() < 0.35:
        depth = _cut_off(depth, rendering.label, rng)
    if rng.random() < 0.4:
        rgb = np.roll(rgb, (int(rng.integers(-1, 2)), int(rng.integers(-2, 3))), axis=(0, 1))
    return rgb, depth


def _structured_light(rng: np.random.Generator) -> StructuredLight:
    return StructuredLight(
        steps=8,
        farthest=float(rng.uniform(3.0, 8.0)),
        jitter=float(rng.uniform(0.2, 1.2)),
        noise=log_uniform(rng, 0.02, 0.12),
        grazing=float(rng.uniform(0.1, 0.35)),
        edge_loss=float(rng.uniform(0.05, 0.6)),
    )


def _stereo(rendering: Rendering, focal: float, rng: np.random.Generator) -> Floats:
    """Simulate stereo depth: edges spread by the matching window, spatially correlated noise, no quantisation."""
    depth, shape = rendering.depth, rendering.depth.shape
    scale = focal * rng.uniform(0.04, 0.1)
    with np.errstate(divide="ignore"):
        disparity = np.where(depth > 0, np.float32(scale) / depth, 0).astype(np.float32)
    # A matching window that half covers the nearer surface matches that surface.
    window = int(rng.choice((1, 3, 5)))
    if window > 1:
        disparity = median_filter(disparity, window)
    noise = np.zeros(shape, np.float32)
    for size in (1.0, 4.0):
        grain = gaussian_filter(rng.standard_normal(shape, dtype=np.float32), size)
        noise += grain * np.float32(2 * np.sqrt(np.pi) * size / np.sqrt(2))
    disparity += noise * np.float32(log_uniform(rng, 0.01, 0.08))
    with np.errstate(divide="ignore"):
        measured = np.where(disparity > 0.5, np.float32(scale) / disparity, 0).astype(np.float32)
    lost = shadow(depth, scale) if rng.random() < 0.7 else np.zeros(shape, bool)
    lost |= depth_edges(measured) & (rng.random(shape, dtype=np.float32) < rng.uniform(0, 0.5))
    grazing = rng.uniform(0.05, 0.25)
    lost |= rng.random(shape, dtype=np.float32) < np.clip((grazing - rendering.facing) / grazing, 0, 1)
    lost = gaussian_filter(lost.astype(np.float32), 1.0) > 0.5
    return np.where(lost | (depth <= 0) | (measured > rng.uniform(3, 10)), np.float32(0), measured)


def _dead_surfaces(label: npt.NDArray[np.int32], rng: np.random.Generator) -> Bools:
    """Return random blobs without depth on some objects and, rarely, on the table."""
    dead = rng.random(int(label.max()) + 1) < 0.1
    dead[: SUPPORT + 1] = (False, rng.random() < 0.1)[: len(dead)]
    if not dead.any():
        return np.zeros(label.shape, bool)
    blots = gaussian_filter(rng.standard_normal(label.shape, dtype=np.float32), rng.uniform(2, 10))
    threshold = np.quantile(blots[::4, ::4], rng.uniform(0.3, 0.95))
    return dead[label] & (blots > threshold)


def _smoothed(depth: Floats) -> Floats:
    """Smooth the depth except at edges, as recording software does; holes are kept."""
    known = depth > 0
    weight = gaussian_filter(known.astype(np.float32), 1.5)
    mean = gaussian_filter(depth, 1.5) / np.maximum(weight, 1e-6)
    return np.where(known & ~depth_edges(depth, 0.02), mean, depth).astype(np.float32)


def _cut_off(depth: Floats, label: npt.NDArray[np.int32], rng: np.random.Generator) -> Floats:
    """Remove the depth beyond the table or beyond a distance, and sometimes a strip at the right or bottom border."""
    depth = depth.copy()
    if rng.random() < 0.7:
        depth[label < SUPPORT] = 0
    else:
        things = depth[(label > SUPPORT) & (depth > 0)]
        if things.size:
            depth[depth > things.max() * rng.uniform(1.02, 1.5)] = 0
    if rng.random() < 0.5:
        depth[:, -int(rng.integers(4, 24)) :] = 0
    if rng.random() < 0.5:
        depth[-int(rng.integers(2, 10)) :] = 0
    return depth
