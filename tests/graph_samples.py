"""Small hand-made graphs in the format of `sgbd.graph.build_graph`, for tests of models and training."""

from __future__ import annotations

import torch
from torch_geometric.data import Data


def path_graph(labels: list[float], node_channels: int = 3, edge_channels: int = 2, seed: int = 0) -> Data:
    """Return a chain of superpixels, each adjacent to the next; `labels[k]` belongs to the pair (k, k + 1)."""
    count = len(labels)
    start = torch.arange(count)
    return graph_of_pairs(torch.stack([start, start + 1]), labels, count + 1, node_channels, edge_channels, seed)


def graph_of_pairs(
    pairs: torch.Tensor, labels: list[float], nodes: int, node_channels: int = 3, edge_channels: int = 2, seed: int = 0
) -> Data:
    """Return a graph with random features; the edge features of the two directions differ."""
    generator = torch.Generator().manual_seed(seed)
    return Data(
        x=torch.randn(nodes, node_channels, generator=generator),
        edge_index=torch.cat([pairs, pairs.flip(0)], dim=1),
        edge_attr=torch.randn(2 * pairs.size(1), edge_channels, generator=generator),
        edge_label_index=pairs,
        edge_label=torch.tensor(labels, dtype=torch.float32),
        border_length=torch.ones(pairs.size(1)),
        area=torch.ones(nodes, dtype=torch.int64),
        node_instance=torch.arange(nodes) % 4 - 1,
        image_size=torch.tensor([[1, nodes]]),
        name=f"path{seed}",
    )


def grid_graph(
    height: int, width: int, node_channels: int = 3, edge_channels: int = 2, seed: int = 0, groups: int = 4
) -> Data:
    """Return a grid of superpixels in `groups` vertical instances, with noisy features that identify the instance."""
    generator = torch.Generator().manual_seed(seed)
    node = torch.arange(height * width).view(height, width)
    pairs = torch.cat(
        [
            torch.stack([node[:, :-1].flatten(), node[:, 1:].flatten()]),
            torch.stack([node[:-1].flatten(), node[1:].flatten()]),
        ],
        dim=1,
    )
    order = torch.argsort(pairs[0] * node.numel() + pairs[1])
    pairs = pairs[:, order]
    column = torch.arange(width).repeat(height)
    instance = (column * groups) // width
    labels = (instance[pairs[0]] == instance[pairs[1]]).float()
    data = graph_of_pairs(pairs, labels.tolist(), node.numel(), node_channels, edge_channels, seed)
    color = torch.rand(groups, node_channels, generator=generator) * 4
    data.x = color[instance] + 0.1 * torch.randn(node.numel(), node_channels, generator=generator)
    if edge_channels:
        difference = (data.x[data.edge_index[0]] - data.x[data.edge_index[1]]).norm(dim=1)
        data.edge_attr[:, 0] = difference
    data.node_instance = instance
    data.name = f"grid{seed}"
    return data
