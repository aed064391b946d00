"""Networks on superpixel graphs: which neighbours to merge, and which superpixels are objects.

- `edge_classifier`: the interface of all edge models. Start here to write your own.
- `mlp`: classifies every pair separately, as in the paper. `gated_gcn`: message passing along directed edges.
  `symmetric_gcn`: the same on undirected edges, at half the cost. `attention`: a graph transformer.
- `objectness`: which superpixels belong to objects; a separate head beside the edge classifier.
- Building blocks: `standardize`, `input_encoder`, `perceptron`, `neighborhood`, `gated_network`.
- Faster implementations with the same results: `gated_messages` in training, `gated_pass` and `in_evaluation` in
  evaluation.
"""

from typing import TYPE_CHECKING, Any

from sgbd.models.edge_classifier import EdgeClassifier
from sgbd.models.gated_gcn import GatedGCN
from sgbd.models.mlp import SharedMLP
from sgbd.models.objectness import ObjectnessHead, object_targets
from sgbd.models.symmetric_gcn import SymmetricGCN

if TYPE_CHECKING:
    from sgbd.models.attention import EdgeTransformer

__all__ = [
    "EdgeClassifier",
    "EdgeTransformer",
    "GatedGCN",
    "ObjectnessHead",
    "SharedMLP",
    "SymmetricGCN",
    "object_targets",
]


def __getattr__(name: str) -> Any:
    # Imported on use: it needs PyG, which loads slowly and which the other models do without.
    if name == "EdgeTransformer":
        from sgbd.models.attention import EdgeTransformer

        return EdgeTransformer
    raise AttributeError(f"module 'sgbd.models' has no attribute {name!r}")
