"""One pass over the training graphs before the first epoch: feature moments, and which graphs have labels."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch_geometric.data import Data

from sgbd.batches import batches_in_order
from sgbd.graph_arrays import CUT, MERGE
from sgbd.machine.progress_bar import ProgressBar
from sgbd.models.standardize import ColumnMoments
from sgbd.sampling import edge_labels, graphs_of_pairs
from sgbd.training.error import TrainingError

log = logging.getLogger(__name__)

SURVEY_BATCH = 32
"""Number of graphs that are processed together."""


@dataclass(frozen=True)
class Survey:
    """Statistics of the training graphs.

    Attributes:
        usable: int64 [U], indices of the graphs with at least one labelled pair.
        nodes: Moments of the node features.
        edges: Moments of the edge features.
        merges: Number of pairs labelled 1.
        cuts: Number of pairs labelled 0.
    """

    usable: Tensor
    nodes: ColumnMoments
    edges: ColumnMoments
    merges: int
    cuts: int


def survey_graphs(graphs: Sequence[Data], num_workers: int = 0, progress: bool = True) -> Survey:
    """Compute the moments of all features, and find the graphs that have labels.

    Args:
        graphs: Training graphs.
        num_workers: Number of processes that read graphs ahead.
        progress: Whether to show a progress bar.

    Returns:
        The statistics.

    Raises:
        TrainingError: If a graph has no field `edge_label`, if features are not finite, or if no graph has a labelled
            pair.
    """
    nodes = edges = None
    # One tensor for all graphs: many small ones, allocated between the batches, would fragment the memory.
    labeled = torch.zeros(len(graphs), dtype=torch.bool)
    merges, cuts, start = 0, 0, 0
    loader = batches_in_order(graphs, SURVEY_BATCH, num_workers)
    for batch in ProgressBar(loader, desc="feature statistics", unit="batch", disable=not progress, leave=False):
        for field in ("x", "edge_attr"):
            if not torch.isfinite(batch[field]).all():
                raise TrainingError(_not_finite(graphs, field, start))
        if nodes is None or edges is None:
            nodes, edges = ColumnMoments(batch.x.size(1)), ColumnMoments(batch.edge_attr.size(1))
        nodes.update(batch.x)
        edges.update(batch.edge_attr)
        try:
            labels = edge_labels(batch)
        except ValueError as error:
            raise TrainingError(str(error)) from error
        num_graphs, graph = graphs_of_pairs(batch)
        merge, cut = labels == MERGE, labels == CUT
        merges, cuts = merges + int(merge.sum()), cuts + int(cut.sum())
        known = torch.bincount(graph[merge | cut], minlength=num_graphs)
        labeled[start : start + num_graphs] = known > 0
        start += num_graphs
    assert nodes is not None
    assert edges is not None
    survey = Survey(labeled.nonzero().squeeze(1), nodes, edges, merges, cuts)
    _check_labels(survey, start)
    return survey


def _check_labels(survey: Survey, graphs: int) -> None:
    """Reject a training set without any labelled pair; warn if some graphs, or one of the classes, have none."""
    if survey.usable.numel() == 0:
        raise TrainingError(
            f"none of the {graphs} training graphs has a labelled pair of superpixels: every frame is one superpixel "
            "or lies wholly in ignored pixels. Look at the labels and at superpixels.*."
        )
    if survey.usable.numel() < graphs:
        log.warning(
            "%d of %d training graphs have no labelled pair and are left out", graphs - len(survey.usable), graphs
        )
    if survey.merges == 0 or survey.cuts == 0:
        log.warning(
            "all labelled pairs are of one class (%d merge, %d cut): there is nothing to tell apart",
            survey.merges,
            survey.cuts,
        )


def _not_finite(graphs: Sequence[Data], field: str, start: int) -> str:
    """Return a message that names the first graph, from index `start` on, with non-finite values, and their columns."""
    for index in range(start, len(graphs)):
        graph = graphs[index]
        bad = (~torch.isfinite(graph[field])).any(0).nonzero().squeeze(1).tolist()
        if bad:
            name = getattr(graph, "name", "") or f"number {index}"
            return (
                f"training graph {name}: {field} holds NaN or infinite values in column {', '.join(map(str, bad))}. "
                "Prepare the graphs anew; if it stays, the frame's depth or your own features are at fault."
            )
    raise AssertionError("unreachable: a batch holds a value that none of its graphs has")
