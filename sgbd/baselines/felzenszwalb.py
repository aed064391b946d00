"""Graph-based segmentation of the pixel grid (Felzenszwalb and Huttenlocher), with scikit-image."""

from __future__ import annotations

import warnings

import numpy as np
import numpy.typing as npt
from skimage.color import rgb2lab
from skimage.segmentation import felzenszwalb

from sgbd.baselines.baseline import Baseline
from sgbd.baselines.color_depth_graph import LAB_RANGE
from sgbd.frame import Frame
from sgbd.superpixels.slic import filled_depth


class Felzenszwalb(Baseline):
    """Merges pixels as long as the step between two segments is no larger than the steps inside them.

    P. F. Felzenszwalb, D. P. Huttenlocher, "Efficient graph-based image segmentation", IJCV 59(2), 2004,
    doi:10.1023/B:VISI.0000022288.19776.77. The image has four channels: Lab, divided by 100, and weighted depth.

    Args:
        scale: Larger values give larger segments.
        sigma: Standard deviation of the Gaussian that first smooths the image, pixels.
        min_size: Smallest segment, pixels.
        depth_weight: Weight of a depth step of one metre relative to a colour step from black to white.

    Raises:
        ValueError: If a number is negative.
    """

    def __init__(
        self, scale: float = 300.0, sigma: float = 0.8, min_size: int = 500, depth_weight: float = 10.0
    ) -> None:
        if min(scale, sigma, min_size, depth_weight) < 0:
            raise ValueError(
                "scale, sigma, min_size and depth_weight of Felzenszwalb must not be negative; got "
                f"{scale}, {sigma}, {min_size} and {depth_weight}"
            )
        self.scale = scale
        self.sigma = sigma
        self.min_size = min_size
        self.depth_weight = depth_weight

    def __call__(self, frame: Frame) -> npt.NDArray[np.int32]:
        """Segment a frame."""
        image = np.dstack([rgb2lab(frame.rgb) / LAB_RANGE, self.depth_weight * filled_depth(frame.depth)])
        with warnings.catch_warnings():
            # It supports any number of channels; the warning only suspects that four were not intended.
            warnings.filterwarnings("ignore", message="Got image with third dimension", category=RuntimeWarning)
            segments = felzenszwalb(image, scale=self.scale, sigma=self.sigma, min_size=self.min_size)
        return segments.astype(np.int32) + 1
