"""Over-segmentation of a frame: every superpixel a small connected region that should lie in one object.

Three methods, each a function of a frame that gives its label map:

- `slic`: the paper's, with scikit-image: SLIC on the colours and SLIC on the depth, intersected.
- `slic_fast`: the same in compiled code. It clusters by `local_k_means` on the planes of `feature_planes`.
- `plane_slic`: colour and depth clustered together by `slanted_planes`, then joined by `region_merging`.

All end by connecting what they found and merging what is too small: in NumPy steps in `connect`, in one compiled pass
in `fragments`.
"""

from sgbd.superpixels.connect import connected_regions, intersect, merge_fragments
from sgbd.superpixels.plane_slic import PlaneSlic
from sgbd.superpixels.slic import Slic, Superpixels
from sgbd.superpixels.slic_fast import FastSlic

__all__ = ["FastSlic", "PlaneSlic", "Slic", "Superpixels", "connected_regions", "intersect", "merge_fragments"]
