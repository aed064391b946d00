"""Samplers of the superpixel pairs to train on, within a batch of graphs."""

from __future__ import annotations

import copy
import math
from typing import Protocol

import torch
from torch import Generator, Tensor
from torch_geometric.data import Data

from sgbd.graph_arrays import MERGE, UNKNOWN


class EdgeSampler(Protocol):
    """Anything that picks the supervised pairs of a batch."""

    def __call__(self, batch: Data, generator: Generator) -> Data:
        """Return a shallow copy of the batch whose `edge_label_index` and `edge_label` are the pairs to train on."""
        ...


class BalancedEdgeSampler:
    """Draws a fixed number of labelled pairs from every graph, a fixed share of them positive (merge).

    The rules, for each graph on its own, exact and not on average:

    * `round(positive_share * pairs_per_graph)` pairs are positive (halves rounded up), the others negative (cut).
    * A class is drawn without replacement, unless it holds fewer pairs than wanted; then with replacement.
    * A graph without negatives gives positives only, and the other way round.
    * With `positive_share=None` (natural), pairs are drawn from both classes alike, without replacement unless the
      graph has fewer than wanted.
    * A graph without labelled pairs gives none. Pairs labelled -1 (unknown) are never drawn.
    * The two ends of exactly half of the drawn pairs change places (`pairs // 2`, at random), so that the model learns
      both directions.

    What is drawn are *supervised* pairs: `edge_index` and `edge_attr` stay whole, so message passing sees all edges.
    All graphs of the batch are drawn from at once. The sampling of Örnek et al., "SupeRGB-D", IEEE RA-L 8(6), 2023,
    https://doi.org/10.1109/LRA.2023.3271527, where a quarter positive is the best share of the four compared.

    Args:
        pairs_per_graph: Pairs drawn from each graph.
        positive_share: Share of positive pairs, 0 to 1; None for pairs as they come.

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
        # Class 1 is positive; with natural sampling there is but one class.
        balanced = self.positive_share is not None
        kind = (labels[known] == MERGE).long() if balanced else torch.zeros_like(known)
        group = graph[known] * 2 + kind
        size = torch.bincount(group, minlength=2 * num_graphs)
        wanted = self._wanted(size.view(num_graphs, 2)).view(-1)

        # One random order of each group; a group that is large enough gives its first pairs, a short one gives pairs
        # drawn with replacement.
        shuffled = known[random_order(group, generator)]
        slot_group = torch.repeat_interleave(wanted)
        slot = torch.arange(slot_group.numel()) - (wanted.cumsum(0) - wanted)[slot_group]
        slot_size = size[slot_group]
        redrawn = (torch.rand(slot.numel(), generator=generator, dtype=torch.float64) * slot_size).long()
        # The product may round up to the size.
        redrawn = torch.minimum(redrawn, slot_size - 1)
        place = torch.where(wanted[slot_group] > slot_size, redrawn, slot)
        drawn = shuffled[(size.cumsum(0) - size)[slot_group] + place]

        sampled = copy.copy(batch)
        sampled.edge_label_index = swap_half(batch.edge_label_index[:, drawn], slot_group // 2, num_graphs, generator)
        sampled.edge_label = labels[drawn]
        return sampled

    def _wanted(self, size: Tensor) -> Tensor:
        """Return int64 [G, 2]: how many pairs of each class to draw, from how many there are."""
        total = self.pairs_per_graph
        positive = 0 if self.positive_share is None else int(self.positive_share * total + 0.5)
        wanted = torch.tensor([total - positive, positive]).expand_as(size)
        # Where a class is empty the other gives everything.
        empty = size == 0
        wanted = torch.where(empty.flip(1), total, wanted)
        return torch.where(empty, 0, wanted)


class AllEdges:
    """Trains on every labelled pair of every graph once, a random half of each graph's with their ends swapped.

    Args:
        border_exponent: A pair counts as the length of its border to this power: 0 for all alike, 1 for as many votes
            as it has in a multicut whose edges are weighted by border length.

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
        """Take all labelled pairs; arguments and result as `BalancedEdgeSampler`.

        With a `border_exponent` the batch needs border_length float32 [E], and the result has edge_label_weight
        float32 [P], how much each pair counts in the loss.
        """
        labels = edge_labels(batch)
        num_graphs, graph = graphs_of_pairs(batch)
        known = (labels != UNKNOWN).nonzero().squeeze(1)
        sampled = copy.copy(batch)
        sampled.edge_label_index = swap_half(batch.edge_label_index[:, known], graph[known], num_graphs, generator)
        sampled.edge_label = labels[known]
        if self.border_exponent > 0:
            # Pairs that don't touch count like one pixel of border.
            sampled.edge_label_weight = batch.border_length[known].clamp(min=1) ** self.border_exponent
        return sampled


def edge_labels(batch: Data) -> Tensor:
    """Return the labels of the pairs, or say that there are none."""
    labels = batch.edge_label if "edge_label" in batch else None
    if labels is None:
        raise ValueError("these graphs have no edge_label, so nothing can be learned: the frames have no instances")
    return labels


def graphs_of_pairs(batch: Data) -> tuple[int, Tensor]:
    """Return the number of graphs of a batch, and int64 [E], the graph that each pair belongs to."""
    pairs = batch.edge_label_index
    if "batch" not in batch or batch.batch is None:
        return 1, torch.zeros(pairs.size(1), dtype=torch.int64)
    return batch.ptr.numel() - 1, batch.batch[pairs[0]]


def random_order(group: Tensor, generator: Generator) -> Tensor:
    """Return the order that sorts by group and shuffles inside each group.

    Args:
        group: int64 [R], not negative.
        generator: Source of randomness.

    Returns:
        int64 [R], positions in `group`.
    """
    # Noise of 24 bits in float64: the sum is exact, so none of it can round up into the next group.
    noise = torch.rand(group.numel(), generator=generator).double()
    return torch.argsort(group + noise, stable=True)


def swap_half(pairs: Tensor, graph: Tensor, num_graphs: int, generator: Generator) -> Tensor:
    """Swap the two ends of a random half of every graph's pairs.

    Args:
        pairs: int64 [2, P], grouped by graph.
        graph: int64 [P], ascending.
        num_graphs: Number of graphs.
        generator: Source of randomness.

    Returns:
        int64 [2, P]; of the k pairs of a graph exactly k // 2 are swapped.
    """
    count = torch.bincount(graph, minlength=num_graphs)
    order = random_order(graph, generator)
    rank = torch.arange(graph.numel()) - (count.cumsum(0) - count)[graph]
    swapped = torch.empty(graph.numel(), dtype=torch.bool)
    swapped[order] = rank < (count // 2)[graph]
    return torch.where(swapped, pairs.flip(0), pairs)
