"""Partition of superpixel graphs into segments, given the merge probability of every edge.

- `partitioner`: the interface. `threshold_partitioner` and `edge_weight`: what the partitioners here have in common.
- `components`: the paper's partition, the connected components of all edges above a threshold. One wrong edge joins two
  objects.
- `multicut`, `average_linkage` and `mutex_watershed`: partitions in which all edges between two segments decide
  together. They share one compiled loop, `contraction`, with its `heap`.
- `kernighan_lin`: improves a multicut by moving superpixels between its segments.
"""

from sgbd.partition.average_linkage import AverageLinkage
from sgbd.partition.components import ConnectedComponents
from sgbd.partition.contraction import agglomerate
from sgbd.partition.kernighan_lin import Multicut, kernighan_lin
from sgbd.partition.multicut import GreedyMulticut, greedy_additive_edge_contraction, multicut_cost
from sgbd.partition.mutex_watershed import MutexWatershed
from sgbd.partition.partitioner import Partitioner

__all__ = [
    "AverageLinkage",
    "ConnectedComponents",
    "GreedyMulticut",
    "Multicut",
    "MutexWatershed",
    "Partitioner",
    "agglomerate",
    "greedy_additive_edge_contraction",
    "kernighan_lin",
    "multicut_cost",
]
