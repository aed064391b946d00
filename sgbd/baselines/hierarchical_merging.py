"""Superpixels merged pairwise, most similar neighbours first."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from skimage.graph import RAG, merge_hierarchical

from sgbd.adjacency import LabelMap
from sgbd.baselines.baseline import SuperpixelBaseline
from sgbd.baselines.color_depth_graph import ColorDepthGraph
from sgbd.frame import Frame
from sgbd.superpixels import Superpixels


class HierarchicalMerging(SuperpixelBaseline):
    """Merges the two most similar neighbours until no two are similar, with scikit-image's `merge_hierarchical`.

    After every merge, the colour and the borders of the new segment are recomputed, so that one weak spot of a border
    does not join what the rest of it separates.

    Args:
        superpixels: Frame to label map int32 [H, W], ids 0..N-1.
        threshold: Edge weight from which two segments are kept apart; see `ColorDepthGraph`.
        depth_weight: Weight of a depth step of one metre relative to a colour step from black to white.
    """

    def __init__(self, superpixels: Superpixels, threshold: float = 0.5, depth_weight: float = 10.0) -> None:
        super().__init__(superpixels)
        self.graph = ColorDepthGraph(depth_weight)
        self.threshold = threshold

    def merge(self, frame: Frame, label_map: LabelMap) -> npt.NDArray[np.int32]:
        """Merge superpixels."""
        segments = merge_hierarchical(
            label_map,
            self.graph(frame, label_map),
            self.threshold,
            rag_copy=False,
            in_place_merge=True,
            merge_func=_pool_nodes,
            weight_func=self._pooled_edge,
        )
        return segments.astype(np.int32) + 1

    def _pooled_edge(self, graph: RAG, source: int, target: int, neighbor: int) -> dict[str, float]:
        """Return the edge of a merged node, whose attributes `target` already has, to a neighbour."""
        edges = [graph[node][neighbor] for node in (source, target) if graph.has_edge(node, neighbor)]
        pooled = {key: sum(edge[key] for edge in edges) for key in ("known", "step")}
        return {**pooled, "weight": self.graph.weight(graph.nodes[target], graph.nodes[neighbor], pooled)}


def _pool_nodes(graph: RAG, source: int, target: int) -> None:
    """Add the pixels and the colour of `source` to `target`."""
    graph.nodes[target]["pixels"] += graph.nodes[source]["pixels"]
    graph.nodes[target]["color"] = graph.nodes[target]["color"] + graph.nodes[source]["color"]
