"""The second stage of an agglomerative segmentation: merge, pool again, classify again.

A first stage merges superpixels into segments. These are the nodes of a new graph, with the same features, now of
whole surfaces: planes fitted to hundreds of pixels instead of dozens. Its edges join segments that touch, and also
objects that lie near each other without touching, so that the two ends of a box behind a bottle can become one object,
which no partition of touching superpixels can give.

Beside the columns of every graph there are what the first stage thinks of each border, and what lies on the line of
sight between two segments: something nearer may hide a connection, something farther shows that there is none.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch
from torch_geometric.data import Data

from sgbd.adjacency import LabelMap, Pairs, border_pairs
from sgbd.checkpoint import Checkpoint, CheckpointError
from sgbd.features import NODE_NAMES
from sgbd.frame import Frame
from sgbd.graph import build_graph
from sgbd.partition import GreedyMulticut
from sgbd.segmentation import Classification, classify
from sgbd.segmenter import Segmenter
from sgbd.torch_threads import torch_threads

NODE_COLUMNS = ("objectness",)
EDGE_COLUMNS = (
    "touching",
    "mean_merge_logit",
    "greatest_merge_logit",
    "log_smaller_area",
    "log_larger_area",
    "relative_border",
    "sight_own",
    "sight_missing",
    "sight_nearer",
    "sight_farther",
)
"""Columns after those of `sgbd.features`:

- touching: 1 if the two share a border, else 0.
- mean_merge_logit, greatest_merge_logit: the first stage's logits of the pairs of superpixels along the border,
  weighted by its length, and the greatest of them; 0 if they do not touch.
- log_smaller_area, log_larger_area: logarithm of the pixels.
- relative_border: border length by the square root of the smaller area.
- sight_own, sight_missing, sight_nearer, sight_farther: shares of the points on the straight line between the
  centroids, in the image, that belong to the two, have no depth, and are nearer or farther than the line in space.
"""

SIGHT_POINTS = 24
SIGHT_MARGIN = 0.012
"""Metres by which a point must differ from the line to count as nearer or farther."""
CERTAIN = 1e-4
"""Merge probabilities are clipped to this distance from 0 and 1 before their logits are averaged."""


class AgglomeratedGraph:
    """Builds the graph of the segments that a first stage makes of a frame's superpixels.

    The graph is a `Data` as of `sgbd.graph.build_graph`, whose nodes are the first stage's segments. It has
    `NODE_COLUMNS` and `EDGE_COLUMNS` after the columns of every graph. `label_map` is the map of the segments;
    `node_of_superpixel` int64 [M] has the segment of each of the M superpixels; `border_length` is not the border's
    length but the square root of the smaller area, so that pairs which do not touch have a say, too.

    Args:
        first_stage: A checkpoint, or its file; it is kept in the checkpoints of what is trained on these graphs.
            In a recipe, "sha256:" and the digest of its content: then `bind` provides it.
        threshold: Merge probability from which on the first stage's multicut merges; high, because what it merges
            stays merged.
        reach: Pairs of objects are joined by an edge if their centroids are nearer than so many metres, whether they
            touch or not.
        min_objectness: Segments that count as objects there have at least this objectness in the first stage.
        min_area: And so many pixels.

    Raises:
        sgbd.checkpoint.CheckpointError: If the first stage cannot be read.
        ValueError: If a number is out of its range.
    """

    node_columns = NODE_COLUMNS
    edge_columns = EDGE_COLUMNS

    def __init__(
        self,
        first_stage: Checkpoint | str | Path,
        threshold: float = 0.9,
        reach: float = 0.35,
        min_objectness: float = 0.25,
        min_area: int = 60,
    ) -> None:
        if not (0 < threshold < 1 and reach >= 0 and 0 <= min_objectness <= 1 and min_area >= 0):
            raise ValueError(
                "graph.threshold must lie between 0 and 1, min_objectness in 0..1, reach and min_area be at least 0; "
                f"got threshold={threshold}, min_objectness={min_objectness}, reach={reach}, min_area={min_area}"
            )
        self.threshold = threshold
        self.reach = reach
        self.min_objectness = min_objectness
        self.min_area = min_area
        self.checkpoint: Checkpoint | None = None
        if isinstance(first_stage, str) and first_stage.startswith("sha256:"):
            # A recipe: the weights are elsewhere in the same file, see `bind`.
            self.first_stage = first_stage
        else:
            self.bind(first_stage if isinstance(first_stage, Checkpoint) else Checkpoint.load(first_stage))

    def bind(self, checkpoint: Checkpoint) -> None:
        """Provide the first stage.

        Args:
            checkpoint: The model; it needs an objectness head.

        Raises:
            sgbd.checkpoint.CheckpointError: If it is not the one that the recipe names, or has no objectness head.
        """
        digest = f"sha256:{hashlib.sha256(checkpoint.to_bytes()).hexdigest()}"
        named = getattr(self, "first_stage", digest)
        if named != digest:
            raise CheckpointError(f"the recipe names a first stage {named}, but this one is {digest}")
        if checkpoint.objectness is None:
            raise CheckpointError("a first stage needs an objectness head: train it with objectness=mlp")
        self.first_stage = digest
        self.checkpoint = checkpoint
        self._segmenter = Segmenter(checkpoint)
        self._partition = GreedyMulticut(self.threshold)

    def __call__(
        self, frame: Frame, label_map: LabelMap, category_names: Sequence[str] = (), *, store_maps: bool = True
    ) -> Data:
        """Build the graph of a frame; arguments as of `sgbd.graph.build_graph`.

        Args:
            frame: The frame.
            label_map: int32 [H, W], its superpixels, made as the first stage's recipe says.
            category_names: All categories of the dataset.
            store_maps: Pack the map of the segments and the truth into the graph.

        Raises:
            sgbd.checkpoint.CheckpointError: If no first stage has been provided.
        """
        if self.checkpoint is None:
            raise CheckpointError(
                f"the first stage {self.first_stage} is not there: load the whole checkpoint with Segmenter.load, or "
                "give graph.first_stage=<checkpoint.safetensors>"
            )
        first = self._segmenter
        fine = first.build_graph(frame, label_map)
        with torch_threads(first.threads):
            classification = classify(first.model, first.objectness, fine)
        pairs = fine.edge_label_index.cpu().numpy()
        length = fine.border_length.cpu().numpy()
        area = fine.area.cpu().numpy()
        segment = self._partition(len(area), pairs, classification.edge_probability, length)
        count = int(segment.max()) + 1
        pixels = np.bincount(segment, area, count).astype(np.int64)
        objectness = np.bincount(segment, area * classification.objectness, count) / pixels

        coarse_map = segment.astype(np.int32)[label_map]
        touching = border_pairs(coarse_map)
        data = build_graph(frame, coarse_map, category_names=category_names, store_maps=store_maps)
        objects = np.nonzero((objectness >= self.min_objectness) & (pixels >= self.min_area))[0]
        wanted = self._joined(touching, objects, data)
        if wanted.shape != touching.shape:
            data = build_graph(frame, coarse_map, lambda _: wanted, category_names, store_maps=store_maps)
        forth = edge_columns(frame, coarse_map, data, wanted, (pairs, length, segment), classification, pixels)
        both = torch.from_numpy(np.concatenate([forth, forth]))
        data.edge_attr = torch.cat([data.edge_attr, both], dim=1)
        data.x = torch.cat([data.x, torch.from_numpy(objectness[:, None].astype(np.float32))], dim=1)
        data.border_length = torch.from_numpy(np.sqrt(pixels[wanted].min(0)).astype(np.float32))
        data.node_of_superpixel = torch.from_numpy(segment)
        return data

    def _joined(self, touching: Pairs, objects: npt.NDArray[np.int64], data: Data) -> Pairs:
        """Add the pairs of objects within reach to those that touch."""
        position = data.x[:, _columns("scene_x", "scene_y", "scene_z")].numpy()[objects]
        i, j = np.triu_indices(len(objects), 1)
        near = np.linalg.norm(position[i] - position[j], axis=1) < self.reach
        count = data.x.size(0)
        keys = np.concatenate([touching[0] * count + touching[1], objects[i[near]] * count + objects[j[near]]])
        return np.stack(np.divmod(np.unique(keys), count))


def edge_columns(
    frame: Frame,
    label_map: LabelMap,
    data: Data,
    wanted: Pairs,
    fine: tuple[Pairs, npt.NDArray[np.float32], npt.NDArray[np.int64]],
    classification: Classification,
    pixels: npt.NDArray[np.int64],
) -> npt.NDArray[np.float32]:
    """Compute `EDGE_COLUMNS`.

    Args:
        frame: The frame.
        label_map: int32 [H, W], its segments.
        data: Their graph.
        wanted: int64 [2, E], pairs of segments, i < j, sorted.
        fine: Pairs of superpixels int64 [2, e], the lengths of their borders [e], and the segment of each [M].
        classification: What the first stage says of these pairs.
        pixels: int64 [S], size of each segment.

    Returns:
        float32 [E, 10].
    """
    fine_pairs, length, segment = fine
    count = len(pixels)
    keys = wanted[0] * count + wanted[1]
    ends = np.sort(segment[fine_pairs], axis=0)
    across = ends[0] != ends[1]
    place = np.searchsorted(keys, ends[0, across] * count + ends[1, across])
    clipped = np.clip(classification.edge_probability[across].astype(np.float64), CERTAIN, 1 - CERTAIN)
    logit = np.log(clipped / (1 - clipped))
    # Superpixels may be paired without a common border, if the first stage was trained on such pairs.
    border = np.maximum(length[across], 1)
    total = np.bincount(place, border, len(keys))
    mean = np.bincount(place, border * logit, len(keys)) / np.maximum(total, 1)
    greatest = np.full(len(keys), -np.inf)
    np.maximum.at(greatest, place, logit)
    smaller, larger = np.sort(pixels[wanted], axis=0)
    return np.column_stack(
        [
            total > 0,
            mean,
            np.where(total > 0, greatest, 0),
            np.log(smaller),
            np.log(larger),
            total / np.sqrt(smaller),
            sight(frame, label_map, data, wanted),
        ]
    ).astype(np.float32)


def sight(frame: Frame, label_map: LabelMap, data: Data, pairs: Pairs) -> npt.NDArray[np.float64]:
    """Look along the lines between the centroids of pairs of segments.

    Args:
        frame: The frame.
        label_map: int32 [H, W], its segments.
        data: Their graph.
        pairs: int64 [2, E].

    Returns:
        float64 [E, 4]: shares of the points between the two that belong to them, have no depth, are nearer, and are
        farther than the line; a plane between them has none of the last two.
    """
    place = data.x[:, _columns("centroid_x", "centroid_y", "depth")].numpy().astype(np.float64)
    known = frame.depth[frame.depth > 0]
    near, far = (float(known.min()), float(known.max())) if known.size else (1.0, 1.0)
    depth = np.maximum(near + place[:, 2] * (far - near), 1e-3)
    column, row = place[:, 0] * frame.width, place[:, 1] * frame.height
    step = (np.arange(1, SIGHT_POINTS) / SIGHT_POINTS)[None]
    i, j = pairs[0][:, None], pairs[1][:, None]

    def between(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return values[i] * (1 - step) + values[j] * step

    rows = np.clip(np.rint(between(row)), 0, frame.height - 1).astype(int)
    columns = np.clip(np.rint(between(column)), 0, frame.width - 1).astype(int)
    # On a straight line in space, the inverse of the depth is linear in the image.
    line = 1 / between(1 / depth)
    seen, owner = frame.depth[rows, columns], label_map[rows, columns]
    own = (owner == i) | (owner == j)
    missing = ~own & (seen <= 0)
    nearer = ~own & (seen > 0) & (seen < line - SIGHT_MARGIN)
    farther = ~own & (seen > line + SIGHT_MARGIN)
    return np.stack([share.mean(1) for share in (own, missing, nearer, farther)], axis=1)


def _columns(*names: str) -> list[int]:
    return [NODE_NAMES.index(name) for name in names]
