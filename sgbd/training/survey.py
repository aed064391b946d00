"""One pass over the training graphs before the first epoch: the scale of their features, and which have labels."""

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
"""Graphs that are looked at together."""


@dataclass(frozen=True)
class Survey:
    """What one pass over the training graphs found.

    Attributes:
        usable: int64 [U], the graphs that have a labelled pair.
        nodes: Moments of the node features.
        edges: Moments of the edge features.
        merges: Pairs labelled 1.
        cuts: Pairs labelled 0.
    """

    usable: Tensor
    nodes: ColumnMoments
    edges: ColumnMoments
    merges: int
    cuts: int


def survey_graphs(graphs: Sequence[Data], num_workers: int = 0, progress: bool = True) -> Survey:
    """Go once over the training graphs: moments of all features, and which graphs have labels.

    Args:
        graphs: Training graphs.
        num_workers: Processes that read graphs ahead.
        progress: Whether to show a progress bar.

    Returns:
        What was found.

    Raises:
        TrainingError: If a graph has no labels field or features that are not finite, or no graph a labelled pair.
    """
    nodes = edges = None
    usable, merges, cuts, start = [], 0, 0, 0
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
        usable.append(start + known.nonzero().squeeze(1))
        start += num_graphs
    assert nodes is not None
    assert edges is not None
    survey = Survey(torch.cat(usable), nodes, edges, merges, cuts)
    _check_labels(survey, start)
    return survey


def _check_labels(survey: Survey, graphs: int) -> None:
    """Refuse graphs without any labelled pair, and warn of labels that say little."""
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
    """Say which graph, from number `start` on, has a value in a field that is not finite, and in which columns."""
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
