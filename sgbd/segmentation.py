"""From classified edges to instances: the last step, shared by validation, evaluation and prediction."""

from __future__ import annotations

import copy
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from sgbd.calibration import ScoreCalibration, segment_features
from sgbd.partition import Partitioner
from sgbd.repaint import repaint

if TYPE_CHECKING:
    from torch_geometric.data import Data

    from sgbd.graph_tensors import GraphTensors


@dataclass(frozen=True, eq=False)
class Classification:
    """The outputs of the networks for one graph.

    Attributes:
        edge_probability: float32 [E], merge probability: that both superpixels of each pair of `edge_label_index`
            belong to the same instance.
        objectness: float32 [N], probability that each superpixel belongs to an object; None without an objectness head.
    """

    edge_probability: npt.NDArray[np.float32]
    objectness: npt.NDArray[np.float32] | None


@torch.inference_mode()
def classify(model: nn.Module, objectness: nn.Module | None, data: Data | GraphTensors) -> Classification:
    """Run the networks on one graph, on the device of the networks.

    Args:
        model: An edge classifier in evaluation mode.
        objectness: An objectness head in evaluation mode on the same device, or None.
        data: One graph on any device, where it stays.

    Returns:
        Probabilities of all edges and superpixels.
    """

    def probability(logits: Tensor) -> npt.NDArray[np.float32]:
        return torch.sigmoid(logits).float().cpu().numpy()

    device = _device_of(model)
    # PyG moves a graph in place, so move a shallow copy.
    moved = copy.copy(data).to(device)
    # A caller's autocast, meant for other networks, must not lower the precision. Some devices have none.
    can_autocast = torch.amp.is_autocast_available(device.type)
    with torch.autocast(device.type, enabled=False) if can_autocast else nullcontext():
        return Classification(probability(model(moved)), None if objectness is None else probability(objectness(moved)))


def _device_of(model: nn.Module) -> torch.device:
    """Return the device of a model's weights, or the CPU if it has none."""
    weight = next(chain(model.parameters(), model.buffers()), None)
    return torch.device("cpu") if weight is None else weight.device


@dataclass(frozen=True, eq=False)
class Segments:
    """A partition of the superpixels into S segments, with properties of each segment.

    Attributes:
        segment: int64 [N], the segment of each superpixel, 0..S-1.
        area: int64 [S], pixels.
        objectness: float32 [S], mean objectness over the segment's pixels; 1 without an objectness head.
        score: float32 [S]. With a calibration: the probability that the intersection over union with a true object is
            above 0.75. Without: a confidence that the segment is one whole object, namely its objectness times the mean
            probability, weighted by border length, that its inner edges merge and its outer edges cut.
        is_object: bool [S], whether the segment is classified as an object.
    """

    segment: npt.NDArray[np.int64]
    area: npt.NDArray[np.int64]
    objectness: npt.NDArray[np.float32]
    score: npt.NDArray[np.float32]
    is_object: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class ObjectRule:
    """The rule that decides which segments are objects.

    Attributes:
        min_objectness: Minimum mean objectness of an object, 0 to 1.
        min_area: Minimum area of an object, pixels.
    """

    min_objectness: float = 0.5
    min_area: int = 0

    def __post_init__(self) -> None:
        """Validate the thresholds.

        Raises:
            ValueError: If a threshold is out of range.
        """
        if not 0 <= self.min_objectness <= 1 or self.min_area < 0:
            raise ValueError(f"objects.min_objectness must lie in 0..1 and objects.min_area be at least 0; got {self}")

    def accepts(self, objectness: npt.NDArray[np.floating], area: npt.NDArray[np.number]) -> npt.NDArray[np.bool_]:
        """Decide for each segment whether it is an object.

        Args:
            objectness: float [S], mean objectness.
            area: [S], pixels.

        Returns:
            bool [S].
        """
        accepted: npt.NDArray[np.bool_] = (objectness >= self.min_objectness) & (area >= self.min_area)
        return accepted


def mean_objectness(
    segment: npt.NDArray[np.int64], area: npt.NDArray[np.number], objectness: npt.NDArray[np.floating] | None
) -> npt.NDArray[np.float64]:
    """Return the mean objectness over the pixels of each segment.

    Args:
        segment: int64 [N], segment of each superpixel, 0..S-1.
        area: [N], pixels of each superpixel.
        objectness: float [N], objectness of each superpixel; None counts as 1.

    Returns:
        float64 [S].
    """
    pixels = np.bincount(segment, area)
    if objectness is None:
        return np.ones(len(pixels))
    mean: npt.NDArray[np.float64] = np.bincount(segment, area * objectness) / pixels
    return mean


def agreement(
    segment: npt.NDArray[np.int64],
    pairs: npt.NDArray[np.int64],
    probability: npt.NDArray[np.float32],
    border_length: npt.NDArray[np.float32],
) -> npt.NDArray[np.float64]:
    """Return how well the edges of each segment agree with the partition.

    Args:
        segment: int64 [N], segment of each superpixel, 0..S-1.
        pairs: int64 [2, E].
        probability: float32 [E], merge probabilities.
        border_length: float32 [E], pixels. Pairs that do not touch (bounding-box adjacency) count as one pixel.

    Returns:
        float64 [S], mean probability, weighted by border length, that the inner edges of the segment merge and its
        outer edges cut; 1 without edges.
    """
    count = int(segment.max(initial=-1)) + 1
    weight = np.maximum(border_length, 1)
    first, second = segment[pairs]
    inside = first == second
    right = np.where(inside, probability, 1 - probability) * weight
    total, agreeing = np.bincount(first, weight, count), np.bincount(first, right, count)
    total += np.bincount(second[~inside], weight[~inside], count)
    agreeing += np.bincount(second[~inside], right[~inside], count)
    return np.where(total > 0, agreeing / np.maximum(total, 1e-9), 1.0)


def partition_graph(
    data: Data | GraphTensors,
    classification: Classification,
    partition: Partitioner,
    rule: ObjectRule,
    calibration: ScoreCalibration | None = None,
) -> Segments:
    """Partition a classified graph, and score and classify its segments.

    Args:
        data: The graph.
        classification: The outputs of the networks for it.
        partition: The partitioner.
        rule: Decides which segments are objects.
        calibration: Maps segment features to calibrated scores; None keeps the confidences described in `Segments`.

    Returns:
        The segments.

    Raises:
        ValueError: If the partitioner does not return one segment per superpixel.
    """
    pairs = data.edge_label_index.cpu().numpy()
    length = data.border_length.cpu().numpy()
    area = data.area.cpu().numpy()
    probability = classification.edge_probability
    segment = partition(len(area), pairs, probability, length, classification.objectness)
    if np.shape(segment) != area.shape:
        raise ValueError(
            f"{type(partition).__name__} must give the segment of each of {len(area)} superpixels, an array of shape "
            f"[{len(area)}]; got {list(np.shape(segment))}"
        )
    segment_area = np.bincount(segment, area)
    objectness = mean_objectness(segment, area, classification.objectness)
    if calibration is None:
        score = objectness * agreement(segment, pairs, probability, length)
    else:
        score = calibration(segment_features(segment, area, pairs, probability, length, classification.objectness))
    return Segments(
        segment=segment,
        area=segment_area.astype(np.int64),
        objectness=objectness.astype(np.float32),
        score=score.astype(np.float32),
        is_object=rule.accepts(objectness, segment_area),
    )


@dataclass(frozen=True, eq=False)
class Segmentation:
    """The objects of one frame.

    Attributes:
        instances: int32 [H, W], 0 not an object, 1..K objects in order of descending score.
        scores: float32 [K], 0 to 1, see `Segments.score`. Calibrated scores are probabilities: of the objects with
            score 0.9, nine in ten are right.
        objectness: float32 [K], mean probability that the object's superpixels belong to an object.
        superpixels: int32 [H, W], the over-segmentation, ids 0..N-1; for a two-stage model, the segments of the first
            stage.
        edge_index: int64 [2, E], pairs of adjacent superpixels, i < j.
        edge_probability: float32 [E], merge probability of each pair.
        from_first_stage: Whether `superpixels` are segments of a first stage.
    """

    instances: npt.NDArray[np.int32]
    scores: npt.NDArray[np.float32]
    objectness: npt.NDArray[np.float32]
    superpixels: npt.NDArray[np.int32]
    edge_index: npt.NDArray[np.int64]
    edge_probability: npt.NDArray[np.float32]
    from_first_stage: bool = False

    @property
    def kind_of_nodes(self) -> str:
        """What the nodes of the graph are, in words: "superpixels" or "segments of the first stage"."""
        return "segments of the first stage" if self.from_first_stage else "superpixels"

    @property
    def described_nodes(self) -> str:
        """Number and kind of the nodes, such as "212 superpixels"."""
        return f"{int(self.superpixels.max(initial=-1)) + 1} {self.kind_of_nodes}"

    def __repr__(self) -> str:
        height, width = self.instances.shape
        return (
            f"Segmentation({len(self.scores)} objects, {width}x{height} pixels, {self.described_nodes}, "
            f"{len(self.edge_probability)} edges)"
        )


def paint(
    superpixels: npt.NDArray[np.int32], data: Data | GraphTensors, classification: Classification, segments: Segments
) -> Segmentation:
    """Map the segments that are objects to pixels.

    Args:
        superpixels: int32 [H, W], label map of the graph's nodes.
        data: The graph.
        classification: The outputs of the networks for it.
        segments: Its partition.

    Returns:
        The objects, numbered by descending score; ties go to the larger object.
    """
    objects = np.nonzero(segments.is_object)[0]
    objects = objects[np.lexsort((-segments.area[objects], -segments.score[objects]))]
    number = np.zeros(len(segments.area), np.int32)
    number[objects] = np.arange(1, len(objects) + 1)
    return Segmentation(
        instances=repaint(superpixels, number[segments.segment]),
        scores=segments.score[objects],
        objectness=segments.objectness[objects],
        superpixels=superpixels,
        edge_index=data.edge_label_index.cpu().numpy(),
        edge_probability=classification.edge_probability,
        from_first_stage=getattr(data, "node_of_superpixel", None) is not None,
    )
