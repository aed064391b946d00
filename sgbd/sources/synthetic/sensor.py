"""From exact depth and linear light to what a camera delivers.

The depth model follows the first Kinect's: K. Khoshelham, S. O. Elberink, "Accuracy and resolution of Kinect depth data
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
    """A camera that triangulates the dots of a projector beside it.

    Attributes:
        baseline: Distance from camera to projector, metres; the projector stands to the right.
        steps: Disparity levels a pixel.
        nearest: Shortest measurable depth, metres.
        farthest: Longest, metres.
        jitter: Standard deviation of the lateral displacement of edges, pixels.
        noise: Standard deviation of the disparity, pixels.
        grazing: Cosine of the angle of incidence from which on, downwards, depth starts to drop out.
        edge_loss: Probability that a pixel beside a depth edge is missing.
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
        """Return the measured depth of a view.

        Args:
            depth: float32 [H, W], exact, metres; 0 = nothing there.
            facing: float32 [H, W], cosine of the angle of incidence.
            focal: Focal length, pixels.
            rng: Source of randomness.

        Returns:
            float32 [H, W], metres, 0 = missing.
        """
        scale = focal * self.baseline
        hidden = shadow(depth, scale)
        rows, columns = np.indices(depth.shape, dtype=np.float32)
        shifts = [gaussian_filter(rng.standard_normal(depth.shape, dtype=np.float32), 1.2) for _ in range(2)]
        # The filter leaves a standard deviation of 1 / (2 sqrt(pi) sigma).
        strength = np.float32(self.jitter * 2 * np.sqrt(np.pi) * 1.2)
        places = [rows + strength * shifts[0], columns + strength * shifts[1]]
        moved = map_coordinates(depth, places, order=0, mode="nearest")
        # The matching window sees a patch, not a point, but never mixes near and far.
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
        # Dropouts come in blots: what is mostly surrounded by missing pixels is missing.
        missing |= gaussian_filter(missing.astype(np.float32), 1.2) > 0.55
        return np.where(missing, np.float32(0), measured)


def shadow(depth: Floats, scale: float) -> Bools:
    """Return where the projector's light does not reach what the camera sees.

    A point in column x with depth z lies in the projector's column x - scale / z. Whatever the camera sees further to
    the right at a projector column not further right stands in its light.

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
    # Half a pixel of tolerance: a slanted surface must not shade itself by rounding.
    hidden[:, :-1] = blocked_from[:, 1:] < lit[:, :-1] - np.float32(0.5)
    return hidden & (depth > 0)


def quantised(disparity: Floats, scale: float, steps: int) -> Floats:
    """Return the depth, metres, of disparities rounded to `1 / steps` pixels; 0 where the disparity is not positive."""
    level = np.round(disparity * steps)
    with np.errstate(divide="ignore"):
        return np.where(level > 0, np.float32(scale * steps) / level, 0).astype(np.float32)


def depth_edges(depth: Floats, share: float = 0.03) -> Bools:
    """Return pixels in whose 3x3 neighbourhood the depth differs by more than a share of it."""
    low, high = minimum_filter(depth, 3), maximum_filter(depth, 3)
    return high - low > share * np.maximum(high, 1e-6)


def exposed(color: Floats, weight: Floats, middle: float) -> Floats:
    """Scale light so that the middle brightness of the weighted pixels is `middle`, with highlights rolled off.

    Args:
        color: float32 [H, W, 3], linear light.
        weight: float32 [H, W], how much a pixel counts.
        middle: Linear brightness, 0 to 1, that the weighted mean of the logarithms gets, or less where more than a
            twentieth of the weight would lie above 1.

    Returns:
        float32 [H, W, 3], gamma encoded (exponent 2), 0 to 1.
    """
    # A fifteenth of the pixels is plenty for a mean.
    sample, counts = color[::4, ::4], weight[::4, ::4].ravel()
    luminance = (sample @ np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)).ravel()
    mean = np.exp(np.average(np.log(luminance + np.float32(1e-4)), weights=counts + np.float32(1e-6)))
    order = np.argsort(luminance)
    share = np.cumsum(counts[order])
    bright = luminance[order][np.searchsorted(share, 0.95 * share[-1])]
    gain = min(middle / max(float(mean), 1e-5), 1 / max(float(bright), 1e-5))
    scaled = color * np.float32(gain)
    # Linear up to the knee, then towards 1 without reaching it.
    knee = np.float32(0.6)
    over = np.maximum(scaled - knee, 0)
    rolled = np.minimum(scaled, knee) + (1 - knee) * over / (over + (1 - knee))
    # Textures are squared to make them linear, so that the root brings them back.
    return np.sqrt(rolled)


def photographed(
    color: Floats, blur: float, noise: float, tint: Floats, rng: np.random.Generator
) -> npt.NDArray[np.uint8]:
    """Return the 8-bit image of a camera.

    Args:
        color: float32 [H, W, 3], gamma encoded, 0 to 1.
        blur: Standard deviation of the lens's blur, pixels.
        noise: Standard deviation of the sensor's noise, grey levels of 255.
        tint: float32 [3], white balance error, near 1.
        rng: Source of randomness.
    """
    soft = gaussian_filter(color, (blur, blur, 0)) * tint
    levels = soft * 255
    if noise > 0:
        levels += rng.standard_normal(levels.shape, dtype=np.float32) * np.float32(noise)
    return np.clip(np.round(levels), 0, 255).astype(np.uint8)
