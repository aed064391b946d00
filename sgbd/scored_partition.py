"""Cached scores of many partitions of a validation graph under many object rules.

A search over thresholds often produces the same partition of a frame, and the same objects in it. Everything that
depends only on the partition (contingency table, areas, objectness) is therefore stored with it, and the scores are
stored for each set of objects.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from torch_geometric.data import Data

from sgbd.label_map import unpack
from sgbd.metrics import ContingencyTable, boundary_scores, match_objects, objects_by_majority, overlap_scores
from sgbd.partition import Partitioner
from sgbd.segmentation import Classification, ObjectRule, mean_objectness


class ScoredPartition:
    """A partition of a graph with ground truth.

    Args:
        segment: int64 [N], segment of each superpixel, 0..S-1.
        data: The graph.
        objectness: float [N], objectness of each superpixel; None without an objectness head.
    """

    def __init__(self, segment: npt.NDArray[np.int64], data: Data, objectness: npt.NDArray[np.floating] | None) -> None:
        area = data.area.numpy()
        self.segment = segment
        self.area = np.bincount(segment, area)
        self.objectness = mean_objectness(segment, area, objectness)
        self.table = ContingencyTable.from_superpixels(
            data.overlap_index.numpy(), data.overlap_instance.numpy(), data.overlap_count.numpy(), segment
        )
        self._overlap: dict[bytes, tuple[float, float]] = {}
        self._boundary: dict[bytes, float] = {}

    def objects(self, rule: ObjectRule | None) -> npt.NDArray[np.int64]:
        """Return the segments that are objects, ascending, except those with ignored pixels only.

        Args:
            rule: Decides which segments are objects; None lets the ground truth decide (protocol `all`).
        """
        if rule is None:
            return objects_by_majority(self.table)
        known = self.table.segments
        return known[rule.accepts(self.objectness[known], self.area[known])]

    def overlap(self, objects: npt.NDArray[np.int64]) -> tuple[float, float]:
        """Return overlap F and F@.75 if the given segments are the predicted objects."""
        key = objects.tobytes()
        if key not in self._overlap:
            scores = overlap_scores(self.table, match_objects(self.table, objects))
            self._overlap[key] = scores.f_measure, scores.detected_share
        return self._overlap[key]

    def boundary_f(
        self, objects: npt.NDArray[np.int64], label_map: npt.NDArray[np.integer], truth: npt.NDArray[np.integer]
    ) -> float:
        """Return boundary F if the given segments are the predicted objects; for the maps see `ScoredGraph.maps`."""
        key = objects.tobytes()
        if key not in self._boundary:
            matching = match_objects(self.table, objects)
            self._boundary[key] = boundary_scores(self.segment[label_map], truth, matching).f_measure
        return self._boundary[key]


class ScoredGraph:
    """A classified graph with ground truth, and a cache of its partitions.

    Args:
        data: The graph.
        classification: The outputs of the networks for it.
    """

    def __init__(self, data: Data, classification: Classification) -> None:
        self.data = data
        self.classification = classification
        self._pairs = data.edge_label_index.numpy()
        self._length = data.border_length.numpy()
        self._met: dict[bytes, ScoredPartition] = {}

    def partition(self, partitioner: Partitioner) -> ScoredPartition:
        """Partition the graph, or return the cached partition with the same segments."""
        known = self.classification
        segment = partitioner(
            self.data.area.numel(), self._pairs, known.edge_probability, self._length, known.objectness
        )
        key = segment.tobytes()
        if key not in self._met:
            self._met[key] = ScoredPartition(segment, self.data, known.objectness)
        return self._met[key]

    def maps(self) -> tuple[npt.NDArray[np.integer], npt.NDArray[np.integer]]:
        """Unpack the label map of the superpixels and the ground-truth instances, integers [H, W]."""
        height, width = self.data.image_size[0].tolist()
        return unpack(self.data.label_map, (height, width)), unpack(self.data.truth_map, (height, width))
