"""Many partitions of one validation graph under many object rules, with nothing computed twice.

A search over thresholds meets the same partition of a frame, and the same objects in it, again and again. Everything
that depends on the partition alone (contingency table, areas, objectness) is stored with it, and the scores are stored
with the set of objects.
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
    """A partition of a graph with truth.

    Args:
        segment: int64 [N], segment of each superpixel, 0..S-1.
        data: The graph.
        objectness: float [N], of its superpixels; None without an objectness head.
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
        """Return the objects that have a pixel of known truth, ascending; None asks the truth (`all`)."""
        if rule is None:
            return objects_by_majority(self.table)
        known = self.table.segments
        return known[rule.accepts(self.objectness[known], self.area[known])]

    def overlap(self, objects: npt.NDArray[np.int64]) -> tuple[float, float]:
        """Return overlap F and F@.75 of some of the segments, taken for the objects."""
        key = objects.tobytes()
        if key not in self._overlap:
            scores = overlap_scores(self.table, match_objects(self.table, objects))
            self._overlap[key] = scores.f_measure, scores.detected_share
        return self._overlap[key]

    def boundary_f(
        self, objects: npt.NDArray[np.int64], label_map: npt.NDArray[np.integer], truth: npt.NDArray[np.integer]
    ) -> float:
        """Return boundary F of some of the segments; maps as `ScoredGraph.maps` gives them."""
        key = objects.tobytes()
        if key not in self._boundary:
            matching = match_objects(self.table, objects)
            self._boundary[key] = boundary_scores(self.segment[label_map], truth, matching).f_measure
        return self._boundary[key]


class ScoredGraph:
    """A classified graph with truth, and the partitions of it that have been met.

    Args:
        data: The graph.
        classification: What the networks say of it.
    """

    def __init__(self, data: Data, classification: Classification) -> None:
        self.data = data
        self.classification = classification
        self._pairs = data.edge_label_index.numpy()
        self._length = data.border_length.numpy()
        self._met: dict[bytes, ScoredPartition] = {}

    def partition(self, partitioner: Partitioner) -> ScoredPartition:
        """Partition the graph."""
        known = self.classification
        segment = partitioner(
            self.data.area.numel(), self._pairs, known.edge_probability, self._length, known.objectness
        )
        key = segment.tobytes()
        if key not in self._met:
            self._met[key] = ScoredPartition(segment, self.data, known.objectness)
        return self._met[key]

    def maps(self) -> tuple[npt.NDArray[np.integer], npt.NDArray[np.integer]]:
        """Unpack the map of the superpixels and that of the truth, integers [H, W]."""
        height, width = self.data.image_size[0].tolist()
        return unpack(self.data.label_map, (height, width)), unpack(self.data.truth_map, (height, width))
