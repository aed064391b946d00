"""Over-segmentation of a frame: every superpixel a small connected region that should lie in one object."""

from sgbd.superpixels.connect import connected_regions, intersect, merge_fragments
from sgbd.superpixels.plane_slic import PlaneSlic
from sgbd.superpixels.slic import Slic, Superpixels
from sgbd.superpixels.slic_fast import FastSlic

__all__ = ["FastSlic", "PlaneSlic", "Slic", "Superpixels", "connected_regions", "intersect", "merge_fragments"]
