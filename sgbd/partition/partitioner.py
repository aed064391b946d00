"""The interface of partitioners, with checks of their input and helpers for their result."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Partitioner(Protocol):
    """Groups the superpixels of a graph into segments."""

    def __call__(
        self,
        num_nodes: int,
        pairs: ArrayLike,
        probability: ArrayLike,
        border_length: ArrayLike,
        objectness: ArrayLike | None = None,
    ) -> NDArray[np.int64]:
        """Partition a graph.

        Args:
            num_nodes: Number of superpixels N.
            pairs: int [2, E], the two ends of each edge; either order, no edge from a superpixel to itself.
            probability: float [E], probability that the two ends belong to one instance.
            border_length: float [E], length of the common border of the two ends, pixels.
            objectness: float [N], probability that each superpixel belongs to an object; None if it is not known.

        Returns:
            int64 [N], segment of each superpixel, 0 to S-1, numbered in the order of first appearance.
        """
        ...


def check_graph(
    num_nodes: int, pairs: ArrayLike, probability: ArrayLike, border_length: ArrayLike
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Check the input of a `Partitioner`, and return pairs, probability and border length as int64, float64, float64.

    Raises:
        ValueError: If shapes disagree, an end isn't a superpixel, an edge joins a superpixel with itself, a
            probability isn't in 0 to 1, or a border length is negative or not finite.
    """
    ends = np.asarray(pairs, dtype=np.int64)
    merge = np.asarray(probability, dtype=np.float64)
    length = np.asarray(border_length, dtype=np.float64)
    if num_nodes < 0:
        raise ValueError(f"the number of superpixels must not be negative, got {num_nodes}")
    if ends.ndim != 2 or ends.shape[0] != 2:
        raise ValueError(f"pairs must have shape [2, E], got {list(ends.shape)}")
    if merge.shape != ends.shape[1:] or length.shape != ends.shape[1:]:
        raise ValueError(
            f"there are {ends.shape[1]} pairs, so probability and border_length must have shape [{ends.shape[1]}], "
            f"got {list(merge.shape)} and {list(length.shape)}"
        )
    if ends.size == 0:
        return ends, merge, length
    if ends.min() < 0 or ends.max() >= num_nodes:
        raise ValueError(
            f"pairs must name superpixels 0 to {num_nodes - 1}, got {ends.min()} to {ends.max()}: "
            "pairs and num_nodes must come from one graph, not from a batch"
        )
    if (ends[0] == ends[1]).any():
        raise ValueError(f"superpixel {ends[0][ends[0] == ends[1]][0]} is paired with itself")
    if not (merge.min() >= 0 and merge.max() <= 1):  # written so that NaN fails too
        raise ValueError(
            f"probabilities must be in 0 to 1, got {merge.min()} to {merge.max()}: apply the sigmoid to logits first"
        )
    if not (length.min() >= 0 and length.max() < np.inf):
        raise ValueError(f"border lengths must be finite and not negative, got {length.min()} to {length.max()}")
    return ends, merge, length


def joint_probability(
    pairs: NDArray[np.int64], probability: NDArray[np.float64], objectness: ArrayLike | None, weight: float
) -> NDArray[np.float64]:
    """Lower the merge probability of superpixels that differ in objectness.

    An object and the table beneath it are never one instance. So the probability p of an edge becomes
    p · (1 - |o_i - o_j|)^weight, where o is the objectness of its ends: two superpixels are merged only if the edge
    favours it and both ends are objects or both are not.

    Args:
        pairs: int64 [2, E].
        probability: float64 [E], merge probabilities from the edges alone.
        objectness: float [N], 0 to 1; None if it is not known.
        weight: Influence of the objectness; 0 for none.

    Returns:
        float64 [E], 0 to 1; `probability` itself if there is no objectness or `weight` is 0.

    Raises:
        ValueError: If an objectness isn't in 0 to 1 or there are too few for the pairs.
    """
    if objectness is None or weight == 0:
        return probability
    node = np.asarray(objectness, dtype=np.float64)
    if node.ndim != 1 or (pairs.size and pairs.max() >= len(node)):
        raise ValueError(f"there must be one objectness for each superpixel, got shape {list(node.shape)}")
    if node.size and not (node.min() >= 0 and node.max() <= 1):
        raise ValueError(
            f"objectness must be in 0 to 1, got {node.min()} to {node.max()}: apply the sigmoid to logits first"
        )
    joint: NDArray[np.float64] = probability * (1 - np.abs(node[pairs[0]] - node[pairs[1]])) ** weight
    return joint


def number_by_first_appearance(group: NDArray[np.integer]) -> NDArray[np.int64]:
    """Renumber groups to 0, 1, 2 … in the order in which they first appear.

    Args:
        group: int [N], any id of each superpixel's group.

    Returns:
        int64 [N].
    """
    _, first, inverse = np.unique(group, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]
