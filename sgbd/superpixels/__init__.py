"""Over-segmentation of a frame: every superpixel a small connected region that should lie in one object."""

from sgbd.superpixels.connect import connected_regions, intersect, merge_fragments
from sgbd.superpixels.slic import Slic, Superpixels

__all__ = ["Slic", "Superpixels", "connected_regions", "intersect", "merge_fragments"]
