"""Partition of superpixel graphs into segments."""

from sgbd.partition.components import ConnectedComponents
from sgbd.partition.multicut import GreedyMulticut, greedy_additive_edge_contraction, multicut_cost
from sgbd.partition.partitioner import Partitioner

__all__ = [
    "ConnectedComponents",
    "GreedyMulticut",
    "Partitioner",
    "greedy_additive_edge_contraction",
    "multicut_cost",
]
