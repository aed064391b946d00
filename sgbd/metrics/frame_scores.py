"""All scores of one frame as one row, and their means over frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from sgbd.metrics.boundary import BoundaryScores, ContourMap, boundary_scores
from sgbd.metrics.clustering import ClusteringScores, clustering_scores
from sgbd.metrics.contingency import ContingencyTable
from sgbd.metrics.edges import EdgeScores
from sgbd.metrics.overlap import OverlapScores, match_objects, overlap_scores

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class FrameScores:
    """Scores of one frame. All are shares from 0 to 1, except counts and the entropies (bits) in `clustering`.

    Attributes:
        name: Name of the frame.
        overlap: Overlap of objects.
        clustering: Agreement of all regions.
        boundary: Agreement of object contours, None if they weren't compared.
        edges: Decisions on edges, None if they weren't scored.
        oracle_overlap: Overlap that the best partition of the superpixels would have, None if not computed.
        oracle_boundary: The same for contours.
    """

    name: str
    overlap: OverlapScores
    clustering: ClusteringScores
    boundary: BoundaryScores | None = None
    edges: EdgeScores | None = None
    oracle_overlap: OverlapScores | None = None
    oracle_boundary: BoundaryScores | None = None

    def as_dict(self) -> dict[str, str | float | int]:
        """Return a row of a table: ``overlap_f_measure``, ``boundary_recall``, ``oracle_overlap_f_measure`` and so on.

        Scores that are None are left out.
        """
        row: dict[str, str | float | int] = {"name": self.name}
        groups = {
            "overlap": self.overlap,
            "boundary": self.boundary,
            "oracle_overlap": self.oracle_overlap,
            "oracle_boundary": self.oracle_boundary,
        }
        for prefix, group in groups.items():
            if group is not None:
                row |= {f"{prefix}_{name}": value for name, value in asdict(group).items()}
        row |= asdict(self.clustering)
        if self.edges is not None:
            row |= asdict(self.edges)
        return row


def score_frame(
    table: ContingencyTable,
    objects: ArrayLike | None = None,
    *,
    prediction: ArrayLike | ContourMap | None = None,
    truth: ArrayLike | ContourMap | None = None,
    oracle: ContingencyTable | None = None,
    oracle_prediction: ArrayLike | ContourMap | None = None,
    edges: EdgeScores | None = None,
    name: str = "",
) -> FrameScores:
    """Score one frame.

    Args:
        table: The contingency table of the predicted segments.
        objects: Labels of the segments that are objects (see `sgbd.metrics.objects`); by default those from 2 on.
        prediction: Integers [H, W], predicted segment of each pixel, for boundaries.
        truth: Integers [H, W], ground-truth instance of each pixel, -1 = ignore, for boundaries.
        oracle: The contingency table of the oracle's segments (see `sgbd.metrics.oracle`).
        oracle_prediction: Integers [H, W], the oracle's segment of each pixel, for its boundaries.
        edges: Scores of the decisions on edges.
        name: Name of the frame.

    Raises:
        ValueError: If a label map for boundaries is given without the one to compare it with.
    """
    if prediction is not None and truth is None:
        raise ValueError("boundaries need the true label map as well: give truth with prediction")
    if oracle_prediction is not None and (truth is None or oracle is None):
        raise ValueError("the oracle's boundaries need truth and oracle as well")
    matching = match_objects(table, objects)
    boundary = oracle_overlap = oracle_boundary = None
    if prediction is not None and truth is not None:
        boundary = boundary_scores(prediction, truth, matching)
    if oracle is not None:
        oracle_matching = match_objects(oracle)
        oracle_overlap = overlap_scores(oracle, oracle_matching)
        if oracle_prediction is not None and truth is not None:
            oracle_boundary = boundary_scores(oracle_prediction, truth, oracle_matching)
    return FrameScores(
        name=name,
        overlap=overlap_scores(table, matching),
        clustering=clustering_scores(table),
        boundary=boundary,
        edges=edges,
        oracle_overlap=oracle_overlap,
        oracle_boundary=oracle_boundary,
    )


def frame_table(frames: Sequence[FrameScores]) -> pd.DataFrame:
    """Return a table with one row for each frame, indexed by name."""
    import pandas as pd  # imported on use: segmenting imports the metrics but not pandas

    columns = [frame.as_dict() for frame in frames]
    return pd.DataFrame(columns).set_index("name") if columns else pd.DataFrame(index=pd.Index([], name="name"))


def summarize(frames: Sequence[FrameScores]) -> dict[str, float]:
    """Average every score over the frames that have it, each frame with the same weight, as published.

    F is the mean of the frames' F, not the F of mean precision and recall. Shares stay shares: multiply them by 100 to
    show percentages. ``frames`` holds the number of frames.
    """
    table = frame_table(frames)
    return {**{str(name): float(value) for name, value in table.mean().items()}, "frames": float(len(table))}
