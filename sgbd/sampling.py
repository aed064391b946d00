"""Samplers that select the superpixel pairs to train on in a batch of graphs."""

from __future__ import annotations

import copy
import math
from typing import Protocol

import torch
from torch import Generator, Tensor
from torch_geometric.data import Data

from sgbd.graph_arrays import MERGE, UNKNOWN


class EdgeSampler(Protocol):
    """Selects the supervised pairs of a batch."""

    def __call__(self, batch: Data, generator: Generator) -> Data:
        """Return a shallow copy of the batch whose `edge_label_index` and `edge_label` are the pairs to train on."""
        ...


class BalancedEdgeSampler:
    """Draws a fixed number of labelled pairs from every graph, a fixed fraction of them positive (merge).

    These rules hold exactly, not only on average, for each graph:

    * `round(positive_share * pairs_per_graph)` pairs are positive (halves rounded up), the others negative (cut).
    * Pairs of a class are drawn without replacement, or with replacement if the class has too few pairs.
    * If a graph has no pairs of one class, all its pairs are drawn from the other class.
    * With `positive_share=None`, pairs are drawn regardless of their class, without replacement unless the graph has
      too few pairs.
    * Nothing is drawn from a graph without labelled pairs. Pairs labelled -1 (unknown) are never drawn.
    * The two superpixels of exactly half of the drawn pairs (`pairs // 2`, at random) are swapped, so that the model
      learns both directions.

    Only *supervised* pairs are drawn: `edge_index` and `edge_attr` stay complete, so message passing uses all edges.
    The sampling is vectorised over all graphs of the batch. It follows Örnek et al., "SupeRGB-D", IEEE RA-L 8(6), 2023,
    https://doi.org/10.1109/LRA.2023.3271527, where a quarter is the best of four compared fractions of positives.

    Args:
        pairs_per_graph: Number of pairs drawn from each graph.
        positive_share: Fraction of positive pairs, 0 to 1; None to draw pairs regardless of their class.

    Raises:
        ValueError: If `pairs_per_graph` is not a positive integer, or `positive_share` is not in [0, 1].
    """

    def __init__(self, pairs_per_graph: int = 128, positive_share: float | None = 0.25) -> None:
        if isinstance(pairs_per_graph, bool) or not isinstance(pairs_per_graph, int) or pairs_per_graph < 1:
            raise ValueError(f"pairs_per_graph must be an integer of at least 1; got {pairs_per_graph!r}")
        is_share = isinstance(positive_share, int | float) and 0 <= positive_share <= 1
        if positive_share is not None and not is_share:
            raise ValueError(
                f"positive_share must be a share from 0 to 1, or null for pairs as they come; got {positive_share!r}"
            )
        self.pairs_per_graph = pairs_per_graph
        self.positive_share = positive_share

    def __repr__(self) -> str:
        return f"{type(self).__name__}(pairs_per_graph={self.pairs_per_graph}, positive_share={self.positive_share})"

    def __call__(self, batch: Data, generator: Generator) -> Data:
        """Draw the pairs to train on.

        Args:
            batch: A graph, or a batch of graphs with the vectors `batch` and `ptr`, on the CPU, with
                edge_label_index int64 [2, E] and edge_label float32 [E].
            generator: Source of all randomness, on the CPU.

        Returns:
            A shallow copy with edge_label_index int64 [2, P] and edge_label float32 [P], ordered by graph.

        Raises:
            ValueError: If the batch has no labels.
        """
        labels = edge_labels(batch)
        num_graphs, graph = graphs_of_pairs(batch)
        known = (labels != UNKNOWN).nonzero().squeeze(1)
        # Class 1 is positive. Without balancing, all pairs are in one class.
        balanced = self.positive_share is not None
        kind = (labels[known] == MERGE).long() if balanced else torch.zeros_like(known)
        group = graph[known] * 2 + kind
        size = torch.bincount(group, minlength=2 * num_graphs)
        wanted = self._wanted(size.view(num_graphs, 2)).view(-1)

        # Shuffle each group. Take the first pairs of a group that is large enough, and draw from a smaller one with
        # replacement.
        shuffled = known[random_order(group, generator)]
        slot_group = torch.repeat_interleave(wanted)
        slot = torch.arange(slot_group.numel()) - (wanted.cumsum(0) - wanted)[slot_group]
        slot_size = size[slot_group]
        redrawn = (torch.rand(slot.numel(), generator=generator, dtype=torch.float64) * slot_size).long()
        # The product may be rounded up to the size itself.
        redrawn = torch.minimum(redrawn, slot_size - 1)
        place = torch.where(wanted[slot_group] > slot_size, redrawn, slot)
        drawn = shuffled[(size.cumsum(0) - size)[slot_group] + place]

        sampled = copy.copy(batch)
        sampled.edge_label_index = swap_half(batch.edge_label_index[:, drawn], slot_group // 2, num_graphs, generator)
        sampled.edge_label = labels[drawn]
        return sampled

    def _wanted(self, size: Tensor) -> Tensor:
        """Return the number of pairs to draw from each class, int64 [G, 2], given the sizes of the classes."""
        total = self.pairs_per_graph
        positive = 0 if self.positive_share is None else int(self.positive_share * total + 0.5)
        wanted = torch.tensor([total - positive, positive]).expand_as(size)
        # If a class is empty, draw all pairs from the other one.
        empty = size == 0
        wanted = torch.where(empty.flip(1), total, wanted)
        return torch.where(empty, 0, wanted)


class AllEdges:
    """Selects every labelled pair of every graph once; in each graph, a random half of the pairs is swapped.

    Args:
        border_exponent: The weight of a pair in the loss is its border length to this power: 0 for equal weights, 1 for
            the weights of a multicut whose edges are weighted by border length.

    Raises:
        ValueError: If the exponent is negative or not finite.
    """

    def __init__(self, border_exponent: float = 0.0) -> None:
        if not 0 <= border_exponent < math.inf:
            raise ValueError(f"border_exponent must be a finite number of at least 0; got {border_exponent}")
        self.border_exponent = border_exponent

    def __repr__(self) -> str:
        return f"{type(self).__name__}(border_exponent={self.border_exponent})"

    def __call__(self, batch: Data, generator: Generator) -> Data:
        """Select all labelled pairs; arguments and result are those of `BalancedEdgeSampler`.

        With a `border_exponent` above 0, the batch needs border_length float32 [E], and the result has
        edge_label_weight float32 [P], the weight of each pair in the loss.
        """
        labels = edge_labels(batch)
        num_graphs, graph = graphs_of_pairs(batch)
        known = (labels != UNKNOWN).nonzero().squeeze(1)
        sampled = copy.copy(batch)
        sampled.edge_label_index = swap_half(batch.edge_label_index[:, known], graph[known], num_graphs, generator)
        sampled.edge_label = labels[known]
        if self.border_exponent > 0:
            # Pairs that do not touch get the weight of one border pixel.
            sampled.edge_label_weight = batch.border_length[known].clamp(min=1) ** self.border_exponent
        return sampled


def edge_labels(batch: Data) -> Tensor:
    """Return the edge labels of a batch; raise a ValueError if it has none."""
    labels = batch.edge_label if "edge_label" in batch else None
    if labels is None:
        raise ValueError("these graphs have no edge_label, so nothing can be learned: the frames have no instances")
    return labels


def graphs_of_pairs(batch: Data) -> tuple[int, Tensor]:
    """Return the number of graphs in a batch, and the graph of each pair, int64 [E]."""
    pairs = batch.edge_label_index
    if "batch" not in batch or batch.batch is None:
        return 1, torch.zeros(pairs.size(1), dtype=torch.int64)
    return batch.ptr.numel() - 1, batch.batch[pairs[0]]


def random_order(group: Tensor, generator: Generator) -> Tensor:
    """Return an order that sorts by group and shuffles within each group.

    Args:
        group: int64 [R], not negative.
        generator: Source of randomness.

    Returns:
        int64 [R], positions in `group`.
    """
    # 24-bit noise in float64: the sum is exact, so rounding cannot move a pair into the next group.
    noise = torch.rand(group.numel(), generator=generator).double()
    return torch.argsort(group + noise, stable=True)


def swap_half(pairs: Tensor, graph: Tensor, num_graphs: int, generator: Generator) -> Tensor:
    """Swap the two superpixels in a random half of every graph's pairs.

    Args:
        pairs: int64 [2, P], grouped by graph.
        graph: int64 [P], ascending.
        num_graphs: Number of graphs.
        generator: Source of randomness.

    Returns:
        int64 [2, P]; exactly k // 2 of the k pairs of a graph are swapped.
    """
    count = torch.bincount(graph, minlength=num_graphs)
    order = random_order(graph, generator)
    rank = torch.arange(graph.numel()) - (count.cumsum(0) - count)[graph]
    swapped = torch.empty(graph.numel(), dtype=torch.bool)
    swapped[order] = rank < (count // 2)[graph]
    return torch.where(swapped, pairs.flip(0), pairs)
