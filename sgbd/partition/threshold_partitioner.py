"""Base classes of the partitioners here: a threshold, the influence of objectness, and signed weights of edges."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgbd.partition.edge_weight import EDGE_EPSILON, BorderWeight, border_share, check_border_weight, logit_weights
from sgbd.partition.partitioner import check_graph, joint_probability


class ThresholdPartitioner(ABC):
    """Checks a graph and applies the objectness before a subclass partitions it.

    Args:
        threshold: Merge probability above which an edge favours merging.
        objectness_weight: How much a difference in objectness lowers the probability of an edge, see
            `sgbd.partition.partitioner.joint_probability`; 0 ignores objectness.

    Raises:
        ValueError: If the threshold isn't between 0 and 1 (both excluded), or the weight is negative or not finite.
    """

    def __init__(self, threshold: float, objectness_weight: float) -> None:
        if not 0 < threshold < 1:
            raise ValueError(f"threshold must be a probability between 0 and 1 (both excluded), got {threshold}")
        if not 0 <= objectness_weight < np.inf:
            raise ValueError(f"objectness_weight must be a finite number from 0 on, got {objectness_weight}")
        self.threshold = float(threshold)
        self.objectness_weight = float(objectness_weight)

    def __call__(
        self,
        num_nodes: int,
        pairs: ArrayLike,
        probability: ArrayLike,
        border_length: ArrayLike,
        objectness: ArrayLike | None = None,
    ) -> NDArray[np.int64]:
        """Partition a graph; see `sgbd.partition.Partitioner`."""
        ends, merge, length = check_graph(num_nodes, pairs, probability, border_length)
        merge = joint_probability(ends, merge, objectness, self.objectness_weight)
        return self.partition(num_nodes, ends, merge, length)

    @abstractmethod
    def partition(
        self,
        num_nodes: int,
        pairs: NDArray[np.int64],
        probability: NDArray[np.float64],
        border_length: NDArray[np.float64],
    ) -> NDArray[np.int64]:
        """Partition a checked graph; arguments and result as in `sgbd.partition.Partitioner`."""

    def __repr__(self) -> str:
        arguments = inspect.signature(type(self)).parameters
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!r}' for name in arguments)})"


class SignedWeightPartitioner(ThresholdPartitioner):
    """Gives every edge the weight (logit(p) - logit(threshold)) · s: positive favours merging, negative cutting.

    Args:
        threshold: Merge probability at which an edge has weight 0.
        border_weight: Choice of s: "length", the border length; "log", log(1 + border length); or "none", 1.
        epsilon: Probabilities are clipped to [epsilon, 1 - epsilon], so that 0 and 1 have finite weights.
        objectness_weight: As in `ThresholdPartitioner`.

    Raises:
        ValueError: If an argument is out of its range.
    """

    def __init__(
        self,
        threshold: float = 0.5,
        border_weight: BorderWeight = "length",
        epsilon: float = EDGE_EPSILON,
        objectness_weight: float = 0.0,
    ) -> None:
        super().__init__(threshold, objectness_weight)
        if not 0 < epsilon < 0.5:
            raise ValueError(f"epsilon must be between 0 and 0.5 (both excluded), got {epsilon}")
        self.border_weight: BorderWeight = check_border_weight(border_weight)
        self.epsilon = float(epsilon)

    def partition(
        self,
        num_nodes: int,
        pairs: NDArray[np.int64],
        probability: NDArray[np.float64],
        border_length: NDArray[np.float64],
    ) -> NDArray[np.int64]:
        """Partition a checked graph."""
        return self.solve(num_nodes, pairs, self.weights(probability, border_length))

    def weights(self, probability: ArrayLike, border_length: ArrayLike) -> NDArray[np.float64]:
        """Return the signed weight of each edge, float64 [E]: positive for merging, negative for cutting.

        Args:
            probability: float [E], merge probabilities.
            border_length: float [E], pixels.
        """
        share = border_share(border_length, self.border_weight)
        return logit_weights(probability, self.threshold, self.epsilon) * share

    @abstractmethod
    def solve(self, num_nodes: int, pairs: NDArray[np.int64], weight: NDArray[np.float64]) -> NDArray[np.int64]:
        """Partition a graph with signed weights.

        Args:
            num_nodes: Number of superpixels N.
            pairs: int64 [2, E], ends of each edge, no loops.
            weight: float64 [E], positive for merging.

        Returns:
            int64 [N], segment of each superpixel, numbered in the order of first appearance.
        """
