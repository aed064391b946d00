"""Simulate a camera: convert exact depth and linear light to measured depth and 8-bit colours.

The depth model follows the first Kinect: K. Khoshelham, S. O. Elberink, "Accuracy and resolution of Kinect depth data
for indoor mapping applications", Sensors 12(2), 2012, doi:10.3390/s120201437; noise and holes as in C. V. Nguyen,
S. Izadi, D. Lovell, "Modeling Kinect sensor noise for improved 3D reconstruction and tracking", 3DIMPVT 2012,
doi:10.1109/3DIMPVT.2012.84.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, map_coordinates, maximum_filter, minimum_filter

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class StructuredLight:
    """A structured-light depth camera: triangulates the dots of a projector next to it.

    Attributes:
        baseline: Distance between camera and projector, metres; the projector is on the right.
        steps: Number of disparity levels per pixel.
        nearest: Minimum measurable depth, metres.
        farthest: Maximum measurable depth, metres.
        jitter: Standard deviation of the lateral displacement of edges, pixels.
        noise: Standard deviation of the disparity, pixels.
        grazing: Cosine of the angle of incidence below which depth starts to drop out.
        edge_loss: Probability that a pixel next to a depth edge is missing.
    """

    baseline: float = 0.075
    steps: int = 8
    nearest: float = 0.4
    farthest: float = 6.0
    jitter: float = 0.7
    noise: float = 0.07
    grazing: float = 0.25
    edge_loss: float = 0.35

    def measure(self, depth: Floats, facing: Floats, focal: float, rng: np.random.Generator) -> Floats:
        """Simulate the measured depth of a view.

        Args:
            depth: float32 [H, W], exact depth, metres; 0 = nothing there.
            facing: float32 [H, W], cosine of the angle of incidence.
            focal: Focal length, pixels.
            rng: Random generator.

        Returns:
            float32 [H, W], metres, 0 = missing.
        """
        scale = focal * self.baseline
        hidden = shadow(depth, scale)
        rows, columns = np.indices(depth.shape, dtype=np.float32)
        shifts = [gaussian_filter(rng.standard_normal(depth.shape, dtype=np.float32), 1.2) for _ in range(2)]
        # The filtered noise has a standard deviation of 1 / (2 sqrt(pi) sigma).
        strength = np.float32(self.jitter * 2 * np.sqrt(np.pi) * 1.2)
        places = [rows + strength * shifts[0], columns + strength * shifts[1]]
        moved = map_coordinates(depth, places, order=0, mode="nearest")
        # The matching window averages over a patch, but not across depth edges.
        blurred = gaussian_filter(moved, 0.8)
        edge = depth_edges(moved)
        smooth = np.where(edge, moved, blurred)
        with np.errstate(divide="ignore"):
            disparity = np.where(smooth > 0, np.float32(scale) / smooth, 0)
        grain = gaussian_filter(rng.standard_normal(depth.shape, dtype=np.float32), 1.0) * np.float32(
            2 * np.sqrt(np.pi)
        )
        disparity += grain * np.float32(self.noise)
        measured = quantised(disparity, scale, self.steps)
        loss = np.clip((self.grazing - facing) / self.grazing, 0, 1)
        lost = rng.random(depth.shape, dtype=np.float32) < loss
        lost |= edge & (rng.random(depth.shape, dtype=np.float32) < self.edge_loss)
        missing = hidden | (moved <= 0) | lost | (measured < self.nearest) | (measured > self.farthest)
        # Dropouts form blobs: a pixel mostly surrounded by missing pixels is missing too.
        missing |= gaussian_filter(missing.astype(np.float32), 1.2) > 0.55
        return np.where(missing, np.float32(0), measured)


def shadow(depth: Floats, scale: float) -> Bools:
    """Return the pixels that the projector's light does not reach.

    A point in column x with depth z lies in the projector's column x - scale / z. It is in shadow if the camera sees
    another point further to the right whose projector column is further to the left.

    Args:
        depth: float32 [H, W], metres; 0 = nothing there.
        scale: Focal length times baseline, pixel metres.

    Returns:
        bool [H, W].
    """
    columns = np.arange(depth.shape[1], dtype=np.float32)
    with np.errstate(divide="ignore"):
        lit = columns - np.where(depth > 0, np.float32(scale) / depth, 0)
    blocked_from = np.minimum.accumulate(lit[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(depth.shape, dtype=bool)
    # Half a pixel of tolerance prevents slanted surfaces from shadowing themselves by rounding.
    hidden[:, :-1] = blocked_from[:, 1:] < lit[:, :-1] - np.float32(0.5)
    return hidden & (depth > 0)


def quantised(disparity: Floats, scale: float, steps: int) -> Floats:
    """Return the depth in metres of disparities rounded to `1 / steps` pixels; 0 if the disparity is not positive."""
    level = np.round(disparity * steps)
    with np.errstate(divide="ignore"):
        return np.where(level > 0, np.float32(scale * steps) / level, 0).astype(np.float32)


def depth_edges(depth: Floats, share: float = 0.03) -> Bools:
    """Return the pixels whose 3x3 neighbourhood spans a depth range above a share of its maximum."""
    low, high = minimum_filter(depth, 3), maximum_filter(depth, 3)
    return high - low > share * np.maximum(high, 1e-6)


def exposed(color: Floats, weight: Floats, middle: float) -> Floats:
    """Expose linear light so that the weighted geometric mean brightness becomes `middle`; compress highlights.

    Args:
        color: float32 [H, W, 3], linear light.
        weight: float32 [H, W], weight of each pixel.
        middle: Target brightness (linear, 0 to 1) of the geometric mean; reduced if otherwise more than 5 % of the
            weight would exceed 1.

    Returns:
        float32 [H, W, 3], gamma encoded (exponent 2), 0 to 1.
    """
    # Every 16th pixel is enough for these statistics.
    sample, counts = color[::4, ::4], weight[::4, ::4].ravel()
    luminance = (sample @ np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)).ravel()
    mean = np.exp(np.average(np.log(luminance + np.float32(1e-4)), weights=counts + np.float32(1e-6)))
    order = np.argsort(luminance)
    share = np.cumsum(counts[order])
    bright = luminance[order][np.searchsorted(share, 0.95 * share[-1])]
    gain = min(middle / max(float(mean), 1e-5), 1 / max(float(bright), 1e-5))
    scaled = color * np.float32(gain)
    # Linear up to the knee, above it asymptotic to 1.
    knee = np.float32(0.6)
    over = np.maximum(scaled - knee, 0)
    rolled = np.minimum(scaled, knee) + (1 - knee) * over / (over + (1 - knee))
    # Gamma encoding: the inverse of squaring texture colours to linear light.
    return np.sqrt(rolled)


def photographed(
    color: Floats, blur: float, noise: float, tint: Floats, rng: np.random.Generator
) -> npt.NDArray[np.uint8]:
    """Simulate the 8-bit image of a camera.

    Args:
        color: float32 [H, W, 3], gamma encoded, 0 to 1.
        blur: Standard deviation of the lens blur, pixels.
        noise: Standard deviation of the sensor noise, grey levels (0 to 255).
        tint: float32 [3], white balance error, near 1.
        rng: Random generator.
    """
    soft = gaussian_filter(color, (blur, blur, 0)) * tint
    levels = soft * 255
    if noise > 0:
        levels += rng.standard_normal(levels.shape, dtype=np.float32) * np.float32(noise)
    return np.clip(np.round(levels), 0, 255).astype(np.uint8)
