"""Batches of graphs for training, assembled fast from only the fields that training reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset, DistributedSampler, Subset
from torch_geometric.data import Data

FIELDS = (
    "x",
    "edge_index",
    "edge_attr",
    "edge_label_index",
    "edge_label",
    "border_length",
    "node_instance",
    "image_size",
)
"""What training reads of a graph. Label maps and overlap tables, which evaluation needs, are left behind."""


Fields = Mapping[str, torch.Tensor]
"""The tensors of a graph by name. Putting them into a `Data` and taking them out again takes longer than reading."""


class SupervisedGraphs(Dataset[Fields]):
    """A view of a dataset of graphs that keeps `FIELDS` only.

    Args:
        graphs: Anything with a length that gives a `Data` for an index.
    """

    def __init__(self, graphs: Sequence[Data]) -> None:
        self.graphs = graphs

    def __len__(self) -> int:
        return len(self.graphs)

    def __getitem__(self, index: int) -> Fields:
        present = self.graphs[index].to_dict()
        return {name: present[name] for name in FIELDS if name in present}


def collate(graphs: Sequence[Fields]) -> Data:
    """Put graphs together into one with several components.

    The same numbers as `torch_geometric.data.Batch.from_data_list` gives for `FIELDS`, which for graphs of this size
    takes longer than the training step itself; this takes a twentieth of it.

    Args:
        graphs: The fields of each graph; one that the first graph lacks must be missing from all.

    Returns:
        A `Data` with these fields, batch int64 [N], the graph of each node, and ptr int64 [G + 1], the first node of
        each graph.
    """
    nodes = [graph["x"].size(0) for graph in graphs]
    first = [0, *accumulate(nodes)]
    batch = {}
    for name in graphs[0]:
        pieces = [graph[name] for graph in graphs]
        if name in ("edge_index", "edge_label_index"):
            batch[name] = torch.cat(pieces, dim=1)
            ends = list(accumulate(piece.size(1) for piece in pieces))
            # In place, graph by graph: the first one stays as it is.
            for k in range(1, len(pieces)):
                batch[name][:, ends[k - 1] : ends[k]] += first[k]
        else:
            batch[name] = torch.cat(pieces)
    return Data.from_dict(
        {
            **batch,
            "batch": torch.repeat_interleave(torch.arange(len(graphs)), torch.tensor(nodes)),
            "ptr": torch.tensor(first),
        }
    )


class EpochBatches:
    """The batches of every epoch, in an order that the seed and the epoch alone decide.

    Args:
        graphs: Training graphs.
        usable: int64 [U], which of them to use.
        batch_size: Graphs in a batch of one process.
        seed: Seed of the order.
        num_workers: Processes that read graphs ahead; 0 reads in this one. It does not change the batches.
        rank: Number of this training process.
        world_size: Training processes; each gets its own share of the graphs, all of one size (a few graphs are
            repeated where the number does not divide).
        pin_memory: Whether batches are put into page-locked memory, for a GPU.
    """

    def __init__(
        self,
        graphs: Sequence[Data],
        usable: torch.Tensor,
        batch_size: int,
        seed: int,
        num_workers: int = 0,
        rank: int = 0,
        world_size: int = 1,
        pin_memory: bool = False,
    ) -> None:
        chosen = Subset(SupervisedGraphs(graphs), usable.tolist())
        # The sampler adds the epoch to its seed: hashed first, the seeds 0 and 1 do not share their orders.
        self.order: DistributedSampler[Data] = DistributedSampler(
            chosen, num_replicas=world_size, rank=rank, seed=derived_seeds(seed)[0]
        )
        self.loader = DataLoader(
            chosen,
            batch_size=batch_size,
            sampler=self.order,
            num_workers=num_workers,
            collate_fn=collate,
            persistent_workers=num_workers > 0,
            pin_memory=pin_memory,
            # Else every epoch would draw from the global generator.
            generator=torch.Generator(),
        )

    def __len__(self) -> int:
        return len(self.loader)

    def epoch(self, number: int) -> DataLoader[Data]:
        """Return the batches of an epoch, to be iterated once."""
        self.order.set_epoch(number)
        return self.loader


def batches_in_order(graphs: Sequence[Data], batch_size: int, num_workers: int = 0) -> DataLoader[Data]:
    """Return batches of all graphs in the order of the dataset."""
    return DataLoader(
        SupervisedGraphs(graphs),
        batch_size=batch_size,
        num_workers=num_workers,
        collate_fn=collate,
        generator=torch.Generator(),
    )


def derived_seeds(*numbers: int) -> tuple[int, int]:
    """Hash numbers, such as seed, epoch and rank, into two seeds of 31 bits without visible relation to them."""
    first, second = np.random.SeedSequence(numbers).generate_state(2)
    return int(first >> 1), int(second >> 1)
