"""Label-preserving augmentation of training graphs."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import torch
from torch import Generator, Tensor
from torch_geometric.data import Data

from sgbd.features import EDGE_NAMES, NODE_GROUPS, NODE_NAMES, edge_columns, node_columns
from sgbd.node_block import split_groups

COLORS = ("red", "green", "blue")
SPREADS = ("red_spread", "green_spread", "blue_spread")
EDGE_COLORS = ("color_step", "color_distance")
SIDEWAYS = ("normal_x", "scene_x", "plane_normal_x")


class GraphAugmentation:
    """Mirrors graphs, changes brightness and colour, and adds a little noise, drawn again in every epoch.

    The features of a graph stay consistent: mirroring applies to positions and normals, and a change of colour applies
    to the means, spreads and steps of colour.

    Args:
        node_features: Groups of `sgbd.features.NODE_GROUPS` that are columns of `x`; None for all.
        edge_features: Groups of `sgbd.features.EDGE_GROUPS` that are columns of `edge_attr`; None for all.
        mirror: Fraction of graphs that are mirrored left to right.
        gain: Standard deviation of the logarithm of each colour channel's gain.
        brightness: Standard deviation of an offset added to all colours, which range from 0 to 1.
        gray: Fraction of graphs that are converted to gray.
        noise: Standard deviation of noise on all features, relative to their standard deviation within the batch.

    Raises:
        ValueError: If a number is out of range.
    """

    def __init__(
        self,
        node_features: Sequence[str] | None = None,
        edge_features: Sequence[str] | None = None,
        mirror: float = 0.5,
        gain: float = 0.12,
        brightness: float = 0.04,
        gray: float = 0.1,
        noise: float = 0.02,
    ) -> None:
        if not (0 <= mirror <= 1 and 0 <= gray <= 1 and min(gain, brightness, noise) >= 0):
            raise ValueError(
                "augmentation: mirror and gray are shares from 0 to 1, gain, brightness and noise at least 0; got "
                f"mirror={mirror}, gray={gray}, gain={gain}, brightness={brightness}, noise={noise}"
            )
        self.mirror, self.gain, self.brightness, self.gray, self.noise = mirror, gain, brightness, gray, noise
        stored, others = split_groups(node_features)
        if others:
            raise ValueError(
                f"augmentation: unknown node feature group {', '.join(others)}; choose from {', '.join(NODE_GROUPS)}. "
                "The columns of a node block only get noise, so leave its group out: "
                f"trainer.augmentation.node_features=[{','.join(stored or [])}]"
            )
        nodes = [NODE_NAMES[column] for column in node_columns(stored)]
        edges = [EDGE_NAMES[column] for column in edge_columns(edge_features)]
        self._node = {name: column for column, name in enumerate(nodes)}
        self._edge = {name: column for column, name in enumerate(edges)}

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(mirror={self.mirror}, gain={self.gain}, brightness={self.brightness}, "
            f"gray={self.gray}, noise={self.noise})"
        )

    def __call__(self, batch: Data, generator: Generator) -> Data:
        """Augment a batch.

        Args:
            batch: A graph, or a batch of graphs with the vectors `batch` and `ptr`; on the CPU, with image_size
                int64 [G, 2].
            generator: Source of all randomness, on the CPU.

        Returns:
            A shallow copy with new `x` and `edge_attr`.

        Raises:
            ValueError: If the batch has fewer columns than the groups. Additional columns are those of the graph
                builder and of a node block; they only get noise.
        """
        for field, names in (("x", self._node), ("edge_attr", self._edge)):
            if batch[field].size(1) < len(names):
                raise ValueError(
                    f"augmentation: {field} has {batch[field].size(1)} columns, the chosen groups have {len(names)}. "
                    "Set node_features and edge_features of the augmentation to the features that are trained on, "
                    "${features.node} and ${features.edge}."
                )
        changed = copy.copy(batch)
        nodes, edges = batch.x.clone(), batch.edge_attr.clone()
        graph = batch.batch if "batch" in batch else torch.zeros(nodes.size(0), dtype=torch.int64)
        count = batch.ptr.numel() - 1 if "ptr" in batch else 1
        edge_graph = graph[batch.edge_index[0]]

        mirrored = (torch.rand(count, generator=generator) < self.mirror)[graph]
        for name in SIDEWAYS:
            if name in self._node:
                column = nodes[:, self._node[name]]
                nodes[:, self._node[name]] = torch.where(mirrored, -column, column)
        if "centroid_x" in self._node:
            # Pixel c of W becomes pixel W - 1 - c, and the feature is c / W.
            farthest = 1 - 1 / batch.image_size[:, 1].to(nodes)[graph]
            column = nodes[:, self._node["centroid_x"]]
            nodes[:, self._node["centroid_x"]] = torch.where(mirrored, farthest - column, column)

        gain = torch.exp(self.gain * torch.randn(count, 3, generator=generator))
        shift = self.brightness * torch.randn(count, 1, generator=generator)
        gray = torch.rand(count, generator=generator) < self.gray
        self._recolor(nodes, COLORS, gain[graph], shift[graph], gray[graph])
        self._recolor(nodes, SPREADS, gain[graph], torch.zeros(1, 1), gray[graph])
        for name in EDGE_COLORS:
            if name in self._edge:
                edges[:, self._edge[name]] *= gain.mean(1)[edge_graph]
        if "color_distance" in self._edge and all(name in self._node for name in COLORS):
            # Recompute it exactly, including the effects of clipping and gray.
            colors = nodes[:, [self._node[name] for name in COLORS]]
            source, target = batch.edge_index
            edges[:, self._edge["color_distance"]] = (colors[source] - colors[target]).norm(dim=1)

        if self.noise > 0:
            for rows in (nodes, edges):
                if rows.numel():
                    spread = rows.std(0, correction=0)
                    rows += self.noise * spread * torch.randn(rows.shape, generator=generator)
        changed.x, changed.edge_attr = nodes, edges
        return changed

    def _recolor(self, nodes: Tensor, names: Sequence[str], gain: Tensor, shift: Tensor, gray: Tensor) -> None:
        if not all(name in self._node for name in names):
            return
        columns = [self._node[name] for name in names]
        colors = (nodes[:, columns] * gain + shift).clamp(0, 1)
        nodes[:, columns] = torch.where(gray[:, None], colors.mean(1, keepdim=True).expand_as(colors), colors)
