"""Classical methods for comparison: from a frame to a label map, without learning."""

from sgbd.baselines.baseline import Baseline
from sgbd.baselines.felzenszwalb import Felzenszwalb
from sgbd.baselines.hierarchical_merging import HierarchicalMerging
from sgbd.baselines.normalized_cut import NormalizedCut
from sgbd.baselines.plane_removal import PlaneRemoval
from sgbd.baselines.threshold_cut import ThresholdCut

__all__ = ["Baseline", "Felzenszwalb", "HierarchicalMerging", "NormalizedCut", "PlaneRemoval", "ThresholdCut"]
