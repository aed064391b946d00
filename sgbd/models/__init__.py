"""Networks on superpixel graphs: which neighbours to merge, and what is an object."""

from sgbd.models.attention import EdgeTransformer
from sgbd.models.edge_classifier import EdgeClassifier
from sgbd.models.gated_gcn import GatedGCN
from sgbd.models.mlp import SharedMLP
from sgbd.models.objectness import ObjectnessHead, object_targets
from sgbd.models.symmetric_gcn import SymmetricGCN

__all__ = [
    "EdgeClassifier",
    "EdgeTransformer",
    "GatedGCN",
    "ObjectnessHead",
    "SharedMLP",
    "SymmetricGCN",
    "object_targets",
]
