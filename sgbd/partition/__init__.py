"""Partition of superpixel graphs into segments."""

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
