"""Augmentation of training frames, before over-segmentation: a different camera, lighting and sensor."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter
from skimage.transform import resize

from sgbd.frame import Frame, Intrinsics

Floats = npt.NDArray[np.float32]


@dataclass(frozen=True)
class FrameAugmentation:
    """A random change of a frame that keeps colours, depth, ground truth and camera consistent.

    `sgbd.augmentation.GraphAugmentation` changes graphs, again in every epoch and at no cost. This class changes the
    frames from which superpixels are computed, so every augmented frame needs another graph to be prepared.

    Attributes:
        mirror: Fraction of frames that are mirrored left to right.
        crop: A random window of at least this fraction of the width (and the same fraction of the height) is enlarged
            to the size of the frame, like a longer focal length; 1 keeps the whole frame.
        exposure: Standard deviation of the logarithm of the gain of all colours together; bright colours are clipped.
        gain: Standard deviation of the logarithm of each colour channel's gain.
        contrast: Standard deviation of the logarithm of the exponent applied to all colours.
        color_noise: Maximum standard deviation of the noise on colours, on the scale 0 to 255.
        depth_noise: Maximum standard deviation of the noise on depth at 1 m, metres; it grows with the square of the
            depth (K. Khoshelham, S. O. Elberink, Sensors 12(2), 2012, doi:10.3390/s120201437).
        holes: Maximum fraction of pixels whose depth is removed, in blobs.

    Raises:
        ValueError: On construction, if a number is out of range.
    """

    mirror: float = 0.5
    crop: float = 0.6
    exposure: float = 0.25
    gain: float = 0.12
    contrast: float = 0.15
    color_noise: float = 4.0
    depth_noise: float = 0.003
    holes: float = 0.1

    def __post_init__(self) -> None:
        """Validate the numbers.

        Raises:
            ValueError: If one is out of range.
        """
        shares = 0 <= self.mirror <= 1 and 0 < self.crop <= 1 and 0 <= self.holes < 1
        strengths = self.exposure, self.gain, self.contrast, self.color_noise, self.depth_noise
        if not shares or min(strengths) < 0:
            raise ValueError(
                "frame augmentation: mirror must lie in 0..1, crop above 0 and at most 1, holes from 0 to below 1, and "
                f"the rest be at least 0; got {asdict(self)}"
            )

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Augment a frame.

        Args:
            frame: The frame; without intrinsics, the default camera is used.
            rng: Source of all randomness.

        Returns:
            A frame of the same size. Objects outside the window are removed from its ground truth.
        """
        frame = replace(frame, intrinsics=frame.camera)
        frame = self._cropped(frame, rng)
        if rng.random() < self.mirror:
            frame = mirrored(frame)
        return replace(frame, rgb=self._recolored(frame.rgb, rng), depth=self._measured(frame.depth, rng))

    def _cropped(self, frame: Frame, rng: np.random.Generator) -> Frame:
        share = rng.uniform(self.crop, 1.0)
        width, height = max(round(share * frame.width), 1), max(round(share * frame.height), 1)
        left, top = (
            int(rng.integers(full - part + 1)) for full, part in ((frame.width, width), (frame.height, height))
        )
        if not frame.depth[top : top + height, left : left + width].any():
            # A window without any depth would not be a valid frame.
            return frame
        return enlarged(frame, left, top, width, height)

    def _recolored(self, rgb: npt.NDArray[np.uint8], rng: np.random.Generator) -> npt.NDArray[np.uint8]:
        exponent = np.exp(self.contrast * rng.standard_normal())
        gain = np.exp(self.exposure * rng.standard_normal() + self.gain * rng.standard_normal(3))
        table = 255 * (np.arange(256)[:, None] / 255) ** exponent * gain
        colors = np.stack([table[rgb[..., channel], channel] for channel in range(3)], axis=-1)
        colors += rng.uniform(0, self.color_noise) * rng.standard_normal(rgb.shape)
        return np.clip(np.round(colors), 0, 255).astype(np.uint8)

    def _measured(self, depth: Floats, rng: np.random.Generator) -> Floats:
        noise = rng.uniform(0, self.depth_noise) * _grain(depth.shape, 1.0, rng)
        measured = np.maximum(depth + noise.astype(np.float32) * depth**2, 0)
        share, size = rng.uniform(0, self.holes), rng.uniform(2.0, 12.0)
        blots = _grain(depth.shape, size, rng)
        kept = (depth > 0) & (blots >= np.quantile(blots, share))
        return np.where(kept, measured, np.float32(0)) if kept.any() else measured


def mirrored(frame: Frame) -> Frame:
    """Mirror a frame and its camera left to right."""
    camera = frame.camera
    return replace(
        frame,
        rgb=frame.rgb[:, ::-1],
        depth=frame.depth[:, ::-1],
        instances=None if frame.instances is None else frame.instances[:, ::-1],
        intrinsics=replace(camera, cx=frame.width - 1 - camera.cx),
    )


def enlarged(frame: Frame, left: int, top: int, width: int, height: int) -> Frame:
    """Enlarge a window of a frame to the frame's size.

    Args:
        frame: The frame.
        left: First column of the window.
        top: First row of the window.
        width: Width of the window, pixels.
        height: Height of the window, pixels.

    Returns:
        The enlarged frame: colours are interpolated, depth and ground truth are taken from the nearest pixel, and the
        intrinsics match the enlarged image.
    """
    window = np.s_[top : top + height, left : left + width]
    size = (frame.height, frame.width)
    wide, high = frame.width / width, frame.height / height
    camera = frame.camera
    # Pixel centres: column c of the window becomes column (c + 1/2) * wide - 1/2 of the result.
    rows = ((np.arange(frame.height) + 0.5) / high).astype(np.intp)
    columns = ((np.arange(frame.width) + 0.5) / wide).astype(np.intp)
    nearest = np.ix_(rows, columns)
    rgb = resize(frame.rgb[window], size, order=1, preserve_range=True, mode="edge")
    instances = None if frame.instances is None else frame.instances[window][nearest]
    return replace(
        frame,
        rgb=np.round(rgb).astype(np.uint8),
        depth=frame.depth[window][nearest],
        instances=instances,
        categories={k: v for k, v in frame.categories.items() if instances is None or (instances == k).any()},
        intrinsics=Intrinsics(
            camera.fx * wide,
            camera.fy * high,
            (camera.cx - left + 0.5) * wide - 0.5,
            (camera.cy - top + 0.5) * high - 0.5,
        ),
    )


def _grain(shape: tuple[int, ...], size: float, rng: np.random.Generator) -> Floats:
    """Draw noise of standard deviation 1 with a grain of about `size` pixels."""
    noise = gaussian_filter(rng.standard_normal(shape, dtype=np.float32), size)
    spread = float(noise.std())
    return noise / np.float32(spread) if spread > 0 else noise
