"""Over-segmentation of a frame: every superpixel is a small connected region that should lie within one object.

Three methods, each a function from a frame to its label map:

- `slic`: the paper's method, with scikit-image: the intersection of SLIC on colour and SLIC on depth.
- `slic_fast`: the same in compiled code. It clusters by `local_k_means` on the planes of `feature_planes`.
- `plane_slic`: clusters colour and depth together by `slanted_planes`, then merges by `region_merging`.

All methods end by making superpixels connected and merging those that are too small: in NumPy steps in `connect`, or in
one compiled pass in `fragments`.
"""

from sgbd.superpixels.connect import connected_regions, intersect, merge_fragments
from sgbd.superpixels.plane_slic import PlaneSlic
from sgbd.superpixels.slic import Slic, Superpixels
from sgbd.superpixels.slic_fast import FastSlic

__all__ = ["FastSlic", "PlaneSlic", "Slic", "Superpixels", "connected_regions", "intersect", "merge_fragments"]
