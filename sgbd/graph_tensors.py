"""The tensors of one graph, named as in PyG's `Data`: the input of this package's networks."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from sgbd.features import EDGE_NAMES, NODE_NAMES
from sgbd.graph_arrays import GraphArrays
from sgbd.own_columns import with_own_columns


class GraphTensors:
    """One graph for inference.

    It replaces `torch_geometric.data.Data`, whose import takes seconds, if only the fields are needed.

    Args:
        graph: The graph; the tensors share its memory if all columns are kept.
        node_columns: Columns of `x` to keep. Additional columns of the graph builder are always kept.
        edge_columns: Columns of `edge_attr` to keep; additional ones likewise.

    Attributes:
        x: float32 [N, F], node features.
        edge_index: int64 [2, 2E].
        edge_attr: float32 [2E, D], edge features.
        edge_label_index: int64 [2, E].
        border_length: float32 [E].
        area: int64 [N].
        node_of_superpixel: int64 [M], the node of each superpixel if the nodes are segments of a first stage
            (`sgbd.agglomeration`), else None.
    """

    def __init__(self, graph: GraphArrays, node_columns: Sequence[int], edge_columns: Sequence[int]) -> None:
        def tensor(field: str) -> Tensor:
            return torch.from_numpy(graph[field])

        self.x = _columns(tensor("x"), node_columns, len(NODE_NAMES))
        self.edge_index = tensor("edge_index")
        self.edge_attr = _columns(tensor("edge_attr"), edge_columns, len(EDGE_NAMES))
        self.edge_label_index = tensor("edge_label_index")
        self.border_length = tensor("border_length")
        self.area = tensor("area")
        self.node_of_superpixel = tensor("node_of_superpixel") if "node_of_superpixel" in graph else None

    def to(self, device: torch.device | str) -> GraphTensors:
        """Move the tensors to a device, in place as PyG does."""
        for name, value in vars(self).items():
            if isinstance(value, Tensor):
                setattr(self, name, value.to(device))
        return self


def _columns(matrix: Tensor, columns: Sequence[int], declared: int) -> Tensor:
    kept = with_own_columns(columns, declared, matrix.size(1))
    return matrix if len(kept) == matrix.size(1) else matrix[:, kept]
