"""Over-segmentation of a frame: every superpixel is a small connected region that should lie within one object.

Three methods, each a function from a frame to its label map:

- `slic`: the paper's method, with scikit-image: the intersection of SLIC on colour and SLIC on depth.
- `slic_fast`: the same in compiled code. It clusters the planes of `feature_planes` with `local_k_means`.
- `plane_slic`: clusters colour and depth together with `slanted_planes`, then merges regions with `region_merging`.

Every method splits its labels into connected regions and merges those that are too small: `fragments` does this in one
compiled pass, `connect` in separate NumPy steps.
"""

from sgbd.superpixels.connect import connected_regions, intersect, merge_fragments
from sgbd.superpixels.plane_slic import PlaneSlic
from sgbd.superpixels.slic import Slic, Superpixels
from sgbd.superpixels.slic_fast import FastSlic

__all__ = ["FastSlic", "PlaneSlic", "Slic", "Superpixels", "connected_regions", "intersect", "merge_fragments"]
