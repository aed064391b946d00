"""The second stage of an agglomerative segmentation: merge, pool features again, classify again.

A first stage merges superpixels into segments. These segments are the nodes of a new graph with the same features, now
of whole surfaces: planes are fitted to hundreds of pixels instead of dozens. The edges of this graph connect touching
segments, and also objects that are near each other without touching. Thus the two ends of a box behind a bottle can
become one object, which is impossible in a graph of touching superpixels.

The edges have additional columns: the first stage's predictions along each border, what lies on the line of sight
between two segments (something nearer may hide a connection, something farther shows that there is none), and how well
the two segments continue each other.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sgbd.adjacency import LabelMap, Pairs
from sgbd.checkpoint import Checkpoint, CheckpointError
from sgbd.features import NODE_NAMES
from sgbd.frame import Frame
from sgbd.graph import GraphBuilder, as_data
from sgbd.graph_arrays import GraphArrays, graph_arrays
from sgbd.machine.compiled import HAS_NUMBA, compiled
from sgbd.machine.torch_threads import torch_threads
from sgbd.partition import GreedyMulticut
from sgbd.regions import Regions, merged_sums, region_and_border_sums
from sgbd.repaint import repaint
from sgbd.segmentation import Classification, classify
from sgbd.segmenter import Segmenter

if TYPE_CHECKING:
    from torch_geometric.data import Data

Floats = npt.NDArray[np.float64]

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
    "color_overlap",
    "width_difference",
    "relative_distance",
)
"""Columns that follow those of `sgbd.features`, for each pair of segments:

- touching: 1 if they share a border, else 0.
- mean_merge_logit, greatest_merge_logit: mean of the first stage's merge logits over the pairs of superpixels along the
  border, weighted by border length, and the greatest of these logits; 0 if the segments do not touch.
- log_smaller_area, log_larger_area: logarithms of the areas in pixels.
- relative_border: border length divided by the square root of the smaller area.
- sight_own, sight_missing, sight_nearer, sight_farther: fractions of the points on the image line between the centroids
  that belong to the two segments, have no depth, are nearer, and are farther than the straight line in space.
- color_overlap: intersection of their colour histograms, 0 to 1 (M. J. Swain, D. H. Ballard, "Color indexing", IJCV
  7(1), 1991, doi:10.1007/BF00130487).
- width_difference: absolute value of the logarithm of the ratio of their widths perpendicular to that line.
- relative_distance: log1p of the distance of their centroids in the image divided by the sum of their lengths along
  that line.
"""

SIGHT_POINTS = 24
SIGHT_MARGIN = 0.012
"""Minimum distance in depth from the line, metres, at which a point counts as nearer or farther."""
CERTAIN = 1e-4
"""Merge probabilities are clipped to this distance from 0 and 1 before their logits are averaged."""
STRIDE = 3
"""Step between the rows and between the columns on which colours and extents are sampled."""
BINS = 4
"""Histogram bins per colour channel."""


class AgglomeratedGraph:
    """Builds the graph whose nodes are the segments that a first stage merges from a frame's superpixels.

    The graph is a `Data` as described in `sgbd.graph.build_graph`, with `NODE_COLUMNS` and `EDGE_COLUMNS` after the
    usual columns. `label_map` is the map of the segments. `node_of_superpixel` int64 [M] is the segment of each of the
    M superpixels. `border_length` is the square root of the smaller area instead of a length, so that pairs which do
    not touch have a weight too.

    Args:
        first_stage: A checkpoint or its file, which is also stored in the checkpoints of models trained on these
            graphs. In a recipe: "sha256:" and the digest of its content; then `bind` provides the checkpoint.
        threshold: Merge probability above which the first stage's multicut merges. It is high because the second stage
            cannot split what the first one has merged.
        reach: Pairs of objects whose centroids are nearer than this distance, metres, get an edge even if they do not
            touch.
        min_objectness: Minimum first-stage objectness of a segment that counts as an object for `reach`.
        min_area: Minimum area of such a segment, pixels.

    Raises:
        sgbd.checkpoint.CheckpointError: If the first stage cannot be read.
        ValueError: If a number is out of range.
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
            # From a recipe: the weights are stored elsewhere in the same file, see `bind`.
            self.first_stage = first_stage
        else:
            self.bind(first_stage if isinstance(first_stage, Checkpoint) else Checkpoint.load(first_stage))

    def bind(self, checkpoint: Checkpoint, trust: Sequence[str] = ()) -> None:
        """Provide the checkpoint of the first stage.

        Args:
            checkpoint: The checkpoint; it needs an objectness head.
            trust: Names of packages besides `sgbd` whose classes its recipe may name.

        Raises:
            sgbd.checkpoint.CheckpointError: If its digest differs from the recipe's, it has no objectness head or two
                stages itself, or a class of its recipe is not trusted.
        """
        digest = digest_of(checkpoint)
        named = getattr(self, "first_stage", digest)
        if named != digest:
            raise CheckpointError(f"the recipe names a first stage {named}, but this one is {digest}")
        if checkpoint.objectness is None:
            raise CheckpointError("a first stage needs an objectness head: train it with objectness=mlp")
        if checkpoint.first_stage is not None:
            raise CheckpointError(
                "this checkpoint has two stages itself; give the one that was graph.first_stage in its training"
            )
        self.first_stage = digest
        self.checkpoint = checkpoint
        self._segmenter = Segmenter(checkpoint, trust=trust)
        self._partition = GreedyMulticut(self.threshold)

    def __call__(
        self, frame: Frame, label_map: LabelMap, category_names: Sequence[str] = (), *, store_maps: bool = True
    ) -> Data:
        """Build the graph of a frame as PyG `Data`; see `arrays` for arguments and errors."""
        return as_data(self.arrays(frame, label_map, category_names, store_maps=store_maps))

    def arrays(
        self, frame: Frame, label_map: LabelMap, category_names: Sequence[str] = (), *, store_maps: bool = True
    ) -> GraphArrays:
        """Build the graph of a frame as NumPy arrays.

        Args:
            frame: The frame.
            label_map: int32 [H, W], its superpixels, computed as in the first stage's recipe.
            category_names: All categories of the dataset.
            store_maps: Whether to pack the map of the segments and the ground truth into the graph.

        Returns:
            The fields of the graph.

        Raises:
            sgbd.checkpoint.CheckpointError: If no first stage has been provided.
        """
        if self.checkpoint is None:
            raise CheckpointError(
                f"the first stage {self.first_stage} is not there: load the whole checkpoint with Segmenter.load, or "
                "give graph.first_stage=<checkpoint.safetensors>"
            )
        first = self._segmenter
        fine_sums = region_and_border_sums(frame, label_map)
        fine = first.graph_tensors(frame, label_map, fine_sums if isinstance(first.graph, GraphBuilder) else None)
        with torch_threads(first.threads):
            said = classify(first.model, first.objectness, fine)
        pairs, length, area = (field.cpu().numpy() for field in (fine.edge_label_index, fine.border_length, fine.area))
        segment = self._partition(len(area), pairs, said.edge_probability, length)
        count = int(segment.max()) + 1
        pixels = np.bincount(segment, area, count).astype(np.int64)
        objectness = np.bincount(segment, area * said.objectness, count) / pixels

        coarse_map = repaint(label_map, segment)
        samples = Samples(frame, coarse_map, count)
        objects = np.nonzero((objectness >= self.min_objectness) & (pixels >= self.min_area))[0]

        # The pairs: segments with touching superpixels, and objects within reach of each other.
        ends = np.sort(segment[pairs[:, length > 0]], axis=0)
        i, j = np.triu_indices(len(objects), 1)
        i, j = objects[i], objects[j]
        near = np.linalg.norm(samples.position[i] - samples.position[j], axis=1) < self.reach
        keys = np.concatenate([(ends[0] * count + ends[1])[ends[0] != ends[1]], i[near] * count + j[near]])
        joined = np.stack(np.divmod(np.unique(keys), count))

        sums = merged_sums(fine_sums, segment)
        graph = graph_arrays(frame, coarse_map, lambda _: joined, category_names, store_maps=store_maps, sums=sums)
        x, edge_attr, wanted = (np.asarray(graph[field]) for field in ("x", "edge_attr", "edge_label_index"))
        forth = np.concatenate(
            [
                evidence(wanted, (pairs, length, segment), said, pixels),
                sight(frame, coarse_map, x, wanted, sums[0]),
                continuation(samples, wanted),
            ],
            axis=1,
        ).astype(np.float32)
        graph["edge_attr"] = np.concatenate([edge_attr, np.concatenate([forth, forth])], axis=1)
        graph["x"] = np.concatenate([x, objectness[:, None].astype(np.float32)], axis=1)
        graph["border_length"] = np.sqrt(pixels[wanted].min(0)).astype(np.float32)
        graph["node_of_superpixel"] = segment
        return graph


def digest_of(checkpoint: Checkpoint) -> str:
    """Return what stands for a first stage in a recipe: "sha256:" and the digest of the checkpoint's content."""
    return f"sha256:{hashlib.sha256(checkpoint.to_bytes()).hexdigest()}"


class Samples:
    """Positions, extents and colours of segments, sampled on a coarse grid of pixels.

    Args:
        frame: The frame.
        label_map: int32 [H, W], its segments.
        count: Number S of segments.

    Attributes:
        position: float64 [S, 3], mean point in camera coordinates, metres; NaN without depth.
        center: float64 [S, 2], mean column and row.
        covariance: float64 [S, 2, 2], covariance of column and row.
        colors: float64 [S, 64], joint histogram of red, green and blue, as fractions of the sampled pixels.
    """

    def __init__(self, frame: Frame, label_map: LabelMap, count: int) -> None:
        camera = np.array([frame.camera.fx, frame.camera.fy, frame.camera.cx, frame.camera.cy])
        sums, histogram = np.zeros((count, _SUMS)), np.zeros((count, BINS**3), np.int64)
        (_sample if HAS_NUMBA else sample_numpy)(label_map, frame.depth, frame.rgb, camera, sums, histogram)
        pixels = np.maximum(sums[:, :1], 1)
        mean = sums[:, 1:6] / pixels
        self.center = mean[:, :2].copy()
        x, y = self.center.T
        xx, xy, yy = mean[:, 2] - x**2, mean[:, 3] - x * y, mean[:, 4] - y**2
        self.covariance = np.stack([xx, xy, xy, yy], axis=1).reshape(-1, 2, 2)
        with np.errstate(invalid="ignore"):
            self.position = sums[:, 7:] / sums[:, 6:7]
        self.colors = histogram / pixels


# Number of sums over the sampled pixels of a segment: count, column, row, column², column * row, row²; then, over the
# pixels with depth, count, X, Y, Z.
_SUMS = 10


@compiled(error_model="numpy")
def _sample(label_map, depth, rgb, camera, sums, histogram):  # type: ignore[no-untyped-def]
    """Compute the sums and histograms that `Samples` needs.

    Args:
        label_map: int32 [H, W].
        depth: float32 [H, W].
        rgb: uint8 [H, W, 3].
        camera: float64 [4], fx, fy, cx, cy.
        sums: float64 [S, 10] of zeros, output.
        histogram: int64 [S, 64] of zeros, output: number of pixels in each colour bin.
    """
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    for row in range(STRIDE // 2, label_map.shape[0], STRIDE):
        for column in range(STRIDE // 2, label_map.shape[1], STRIDE):
            segment, z = np.int64(label_map[row, column]), np.float64(depth[row, column])
            total = sums[segment]
            total[0] += 1
            total[1] += column
            total[2] += row
            total[3] += column * column
            total[4] += column * row
            total[5] += row * row
            total[6] += z > 0
            total[7] += (column - cx) / fx * z
            total[8] += (row - cy) / fy * z
            total[9] += z
            color = np.int64(0)
            for k in range(3):
                color = color * BINS + np.int64(rgb[row, column, k]) * BINS // 256
            histogram[segment, color] += 1


def sample_numpy(
    label_map: LabelMap,
    depth: npt.NDArray[np.float32],
    rgb: npt.NDArray[np.uint8],
    camera: Floats,
    sums: Floats,
    histogram: npt.NDArray[np.int64],
) -> None:
    """Compute the same as `_sample` in NumPy, for installations without Numba."""
    fx, fy, cx, cy = camera
    every = np.s_[STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
    segment, z = label_map[every].ravel(), depth[every].ravel().astype(np.float64)
    rows, columns = np.indices(label_map.shape)[:, every[0], every[1]].reshape(2, -1)
    weights = (
        np.ones(len(z)),
        columns,
        rows,
        columns * columns,
        columns * rows,
        rows * rows,
        z > 0,
        (columns - cx) / fx * z,
        (rows - cy) / fy * z,
        z,
    )
    for place, weight in enumerate(weights):
        sums[:, place] = np.bincount(segment, weight, len(sums))
    red, green, blue = (rgb[every].reshape(-1, 3).astype(np.int64) * BINS // 256).T
    place_in_histogram = ((segment.astype(np.int64) * BINS + red) * BINS + green) * BINS + blue
    histogram[...] = np.bincount(place_in_histogram, minlength=histogram.size).reshape(histogram.shape)


def evidence(
    wanted: Pairs,
    fine: tuple[Pairs, npt.NDArray[np.float32], npt.NDArray[np.int64]],
    said: Classification,
    pixels: npt.NDArray[np.int64],
) -> Floats:
    """Pool the first stage's predictions along the border of each pair of segments.

    Args:
        wanted: int64 [2, E], pairs of segments, i < j, sorted.
        fine: Pairs of superpixels int64 [2, e], the lengths of their borders [e], and the segment of each superpixel
            [M].
        said: The first stage's predictions for the pairs of superpixels.
        pixels: int64 [S], area of each segment.

    Returns:
        float64 [E, 6], the columns from touching to relative_border.
    """
    fine_pairs, length, segment = fine
    count = len(pixels)
    keys = wanted[0] * count + wanted[1]
    ends = np.sort(segment[fine_pairs], axis=0)
    # With bounding-box adjacency, pairs of superpixels need no common border; those say nothing about one.
    across = (ends[0] != ends[1]) & (length > 0)
    place = np.searchsorted(keys, ends[0, across] * count + ends[1, across])
    clipped = np.clip(said.edge_probability[across].astype(np.float64), CERTAIN, 1 - CERTAIN)
    logit = np.log(clipped / (1 - clipped))
    border = length[across]
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
        ]
    )


def sight(frame: Frame, label_map: LabelMap, x: npt.NDArray[np.float32], pairs: Pairs, regions: Regions) -> Floats:
    """Sample the lines between the centroids of pairs of segments.

    Args:
        frame: The frame.
        label_map: int32 [H, W], its segments.
        x: float32 [S, F], their node features (`sgbd.features`).
        pairs: int64 [2, E].
        regions: Sums over the segments, with the depth range of the frame.

    Returns:
        float64 [E, 4]: fractions of the points between the centroids that belong to the two segments, have no depth,
        are nearer, and are farther than the line. A plane through both has no points of the last two kinds.
    """
    place = x[:, [NODE_NAMES.index(name) for name in ("centroid_x", "centroid_y", "depth")]].astype(np.float64)
    near, far = (regions.nearest, regions.farthest) if regions.farthest > 0 else (1.0, 1.0)
    depth = np.maximum(near + place[:, 2] * (far - near), 1e-3)
    column, row = place[:, 0] * frame.width, place[:, 1] * frame.height
    step = (np.arange(1, SIGHT_POINTS) / SIGHT_POINTS)[None]
    i, j = pairs[0][:, None], pairs[1][:, None]

    def between(values: Floats) -> Floats:
        return values[i] * (1 - step) + values[j] * step

    rows = np.clip(np.rint(between(row)), 0, frame.height - 1).astype(int)
    columns = np.clip(np.rint(between(column)), 0, frame.width - 1).astype(int)
    # Along a straight line in space, the inverse depth is linear in image coordinates.
    line = 1 / between(1 / depth)
    seen, owner = frame.depth[rows, columns], label_map[rows, columns]
    own = (owner == i) | (owner == j)
    missing = ~own & (seen <= 0)
    nearer = ~own & (seen > 0) & (seen < line - SIGHT_MARGIN)
    farther = ~own & (seen > line + SIGHT_MARGIN)
    return np.stack([share.mean(1) for share in (own, missing, nearer, farther)], axis=1)


def continuation(samples: Samples, pairs: Pairs) -> Floats:
    """Compare the two segments of each pair as possible ends of one object.

    Args:
        samples: Extents and colours of the segments.
        pairs: int64 [2, E].

    Returns:
        float64 [E, 3]: color_overlap, width_difference and relative_distance.
    """
    i, j = pairs
    overlap = np.minimum(samples.colors[i], samples.colors[j]).sum(1)
    between = samples.center[j] - samples.center[i]
    distance = np.linalg.norm(between, axis=1)
    along = between / np.maximum(distance, 1e-9)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)

    def extent(segment: npt.NDArray[np.int64], direction: Floats) -> Floats:
        variance = np.einsum("ea,eab,eb->e", direction, samples.covariance[segment], direction)
        # Assume at least one pixel of extent.
        return np.sqrt(np.maximum(variance, 1.0))

    width = np.abs(np.log(extent(i, across) / extent(j, across)))
    length = extent(i, along) + extent(j, along)
    return np.stack([overlap, width, np.log1p(distance / length)], axis=1)
