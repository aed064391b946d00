"""A trained model with its complete recipe, which segments RGB-D frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy.typing as npt
import torch
from torch import nn

from sgbd.adjacency import LabelMap
from sgbd.calibration import ScoreCalibration
from sgbd.checkpoint import Checkpoint, CheckpointError, instantiate, pretrained_checkpoint
from sgbd.features import EDGE_NAMES, NODE_NAMES, edge_columns, node_columns
from sgbd.frame import Frame, Intrinsics
from sgbd.graph import GraphBuilder, array_builder
from sgbd.graph_tensors import GraphTensors
from sgbd.machine.torch_threads import torch_threads
from sgbd.node_block import NodeBlock, required_block, split_groups
from sgbd.own_columns import with_own_columns
from sgbd.partition import Partitioner
from sgbd.reduction import check_factor, enlarged, reduced
from sgbd.regions import Borders, Regions
from sgbd.repaint import node_map
from sgbd.segmentation import ObjectRule, Segmentation, classify, paint, partition_graph
from sgbd.superpixels import Superpixels

if TYPE_CHECKING:
    from torch_geometric.data import Data


class Segmenter:
    """Segments the objects of RGB-D frames.

    It runs the same steps as training and evaluation, with the settings stored in the checkpoint.

    Example:
        >>> segmenter = Segmenter.pretrained()  # or Segmenter.load("checkpoint.safetensors")
        >>> result = segmenter.segment(rgb, depth)
        >>> result.instances  # int32 [H, W], 0 = not an object, 1..K objects

    Args:
        checkpoint: The model and its recipe.
        partition: Replaces the recipe's partitioner.
        rule: Replaces the recipe's object rule.
        node_block: Replaces the recipe's block of node features, for example if its weights are stored elsewhere on
            this machine. Ignored if the model uses no block.
        device: Where the networks run; those of a first stage, which are part of the graph, run on the CPU.
        threads: CPU threads for each PyTorch operation of the networks; see `sgbd.machine.torch_threads`. With 1, work
            that can be split runs in parallel threads instead (`sgbd.machine.side_by_side`), as it does for superpixels
            and graphs.
        trust: Names of packages besides `sgbd` whose classes the recipe may name.
        reduce: Frames are segmented at this fraction of their width and height, 2 for a half, which is faster. Maps
            have full size, but the object rule counts pixels of the reduced frame. Models work best at about the size
            of the frames that they were trained on.

    Raises:
        sgbd.checkpoint.CheckpointError: If a class of the recipe is missing or not trusted, or `node_block` does not
            match the recipe.
        ValueError: If this machine or this build of PyTorch does not have the device, or `reduce` is not a positive
            integer.
    """

    def __init__(
        self,
        checkpoint: Checkpoint,
        *,
        partition: Partitioner | None = None,
        rule: ObjectRule | None = None,
        node_block: NodeBlock | None = None,
        device: torch.device | str = "cpu",
        threads: int = 1,
        trust: Sequence[str] = (),
        reduce: int = 1,
    ) -> None:
        recipe = checkpoint.recipe
        self.recipe = recipe
        self.device = _usable_device(device)
        self.threads = threads
        check_factor("reduce", reduce)
        self.reduce = reduce
        self.superpixels: Superpixels = instantiate(recipe.get("superpixels"), object, trust)  # type: ignore[assignment]
        self.graph: GraphBuilder = instantiate(recipe.get("graph"), object, trust)  # type: ignore[assignment]
        if checkpoint.first_stage is not None:
            self.graph.bind(checkpoint.first_stage, trust)  # type: ignore[attr-defined]
        self.partition: Partitioner = (
            instantiate(recipe.get("partition"), object, trust) if partition is None else partition  # type: ignore[assignment]
        )
        self.rule = instantiate(recipe.get("objects"), ObjectRule, trust) if rule is None else rule
        calibration = recipe.get("calibration")
        self.calibration = None if calibration is None else instantiate(calibration, ScoreCalibration, trust)
        self.model = checkpoint.model.to(self.device).eval()
        self.objectness = None if checkpoint.objectness is None else checkpoint.objectness.to(self.device).eval()
        features = recipe["features"]
        self.node_block = _block(features, node_block, trust)
        stored, _ = split_groups(features["node"])
        self._node_columns = node_columns(stored)
        self._edge_columns = edge_columns(features["edge"])

    @classmethod
    def load(
        cls,
        path: str | Path,
        *,
        partition: Partitioner | None = None,
        rule: ObjectRule | None = None,
        node_block: NodeBlock | None = None,
        device: torch.device | str = "cpu",
        threads: int = 1,
        trust: Sequence[str] = (),
        reduce: int = 1,
    ) -> Segmenter:
        """Load a checkpoint file; the other arguments are those of the class.

        Raises:
            sgbd.checkpoint.CheckpointError: If the file is missing, damaged or not a checkpoint.
        """
        checkpoint = Checkpoint.load(path, trust)
        return cls(
            checkpoint,
            partition=partition,
            rule=rule,
            node_block=node_block,
            device=device,
            threads=threads,
            trust=trust,
            reduce=reduce,
        )

    @classmethod
    def pretrained(
        cls,
        *,
        partition: Partitioner | None = None,
        rule: ObjectRule | None = None,
        node_block: NodeBlock | None = None,
        device: torch.device | str = "cpu",
        threads: int = 1,
        trust: Sequence[str] = (),
        reduce: int = 1,
    ) -> Segmenter:
        """Load the model that is installed with the package; the arguments are those of the class.

        Raises:
            sgbd.checkpoint.CheckpointError: If the package was installed without the model.
        """
        return cls.load(
            pretrained_checkpoint(),
            partition=partition,
            rule=rule,
            node_block=node_block,
            device=device,
            threads=threads,
            trust=trust,
            reduce=reduce,
        )

    def segment(self, rgb: npt.ArrayLike, depth: npt.ArrayLike, intrinsics: Intrinsics | None = None) -> Segmentation:
        """Segment one frame.

        Args:
            rgb: uint8 [H, W, 3].
            depth: [H, W]; float metres or uint16 millimetres, 0 or NaN = missing.
            intrinsics: The camera; if None, a typical camera is assumed.

        Returns:
            The objects.

        Raises:
            sgbd.frame.FrameError: If the arrays are not a valid RGB-D frame.
        """
        return self.segment_frame(Frame(rgb, depth, intrinsics))  # type: ignore[arg-type]

    def segment_frame(self, frame: Frame) -> Segmentation:
        """Segment a frame, ignoring any ground truth it has."""
        small = self.reduced(frame)
        label_map = self.superpixels(small)
        data = self.graph_tensors(small, label_map)
        with torch_threads(self.threads):
            classification = classify(self.model, self.objectness, data)
        segments = partition_graph(data, classification, self.partition, self.rule, self.calibration)
        return paint(self.enlarged(node_map(label_map, data), frame), data, classification, segments)

    def reduced(self, frame: Frame) -> Frame:
        """Return the frame that is segmented in place of a frame: reduced as asked for, without ground truth."""
        if frame.instances is not None:
            frame = replace(frame, instances=None)
        return frame if self.reduce == 1 else reduced(frame, self.reduce)

    def enlarged(self, label_map: LabelMap, frame: Frame) -> LabelMap:
        """Enlarge the label map of what `reduced` makes of a frame to the size of the frame."""
        return label_map if self.reduce == 1 else enlarged(label_map, self.reduce, frame.height, frame.width)

    def build_graph(self, frame: Frame, label_map: LabelMap) -> Data:
        """Build the PyG graph of a frame with the feature columns that the model was trained on.

        Args:
            frame: The frame.
            label_map: int32 [H, W], its superpixels.

        Returns:
            The graph described in `sgbd.graph.build_graph`, without the packed maps.
        """
        data = self.graph(frame, label_map, store_maps=False)
        data.x = data.x[:, with_own_columns(self._node_columns, len(NODE_NAMES), data.x.size(1))]
        if self.node_block is not None:
            (block,) = self.node_block([frame.rgb], [node_map(label_map, data)])
            data.x = torch.cat([data.x, torch.from_numpy(block)], dim=1)
        data.edge_attr = data.edge_attr[
            :, with_own_columns(self._edge_columns, len(EDGE_NAMES), data.edge_attr.size(1))
        ]
        return data

    def graph_tensors(
        self, frame: Frame, label_map: LabelMap, sums: tuple[Regions, Borders] | None = None
    ) -> GraphTensors | Data:
        """Build the graph of a frame, without PyG if builder and networks belong to this package.

        Args:
            frame: The frame.
            label_map: int32 [H, W], its superpixels.
            sums: What `sgbd.regions.region_and_border_sums` returns for them, for a `GraphBuilder`, which would compute
                them; None otherwise.

        Returns:
            The graph of `build_graph`: as plain tensors, or as `Data` if the builder or a network is user-defined or
            the model uses a node block.
        """
        networks = [network for network in (self.model, self.objectness) if network is not None]
        build = array_builder(self.graph)
        if build is None or self.node_block is not None or not all(map(_reads_fields_only, networks)):
            return self.build_graph(frame, label_map)
        known = {} if sums is None else {"sums": sums}
        arrays = build(frame, label_map, store_maps=False, **known)
        # PyTorch's threads go on spinning after a small operation, on the cores that the loops of others need.
        with torch_threads(self.threads):
            return GraphTensors(arrays, self._node_columns, self._edge_columns)


def _reads_fields_only(network: nn.Module) -> bool:
    """Return whether a network belongs to this package, whose networks only read the fields of a graph."""
    return type(network).forward.__module__.startswith("sgbd.models.")


def _block(features: Mapping[str, Any], given: NodeBlock | None, trust: Sequence[str]) -> NodeBlock | None:
    """Return the node block that a recipe's features need. Load its weights now, so that missing ones show early."""
    recipe = features.get("block")
    if recipe is None:
        return required_block(features["node"], None)
    block = instantiate(recipe, NodeBlock, trust) if given is None else given  # type: ignore[type-abstract]
    # Weights are identified by their digest, not by their location.
    wanted, found = (
        {key: value for key, value in each.items() if key != "weights"} for each in (recipe, block.recipe())
    )
    if wanted != found:
        raise CheckpointError(
            f"the model was trained with the node block {wanted}, not with {found}. Give node_block the same settings "
            "and weights."
        )
    return required_block(features["node"], block)


def _usable_device(device: torch.device | str) -> torch.device:
    try:
        chosen = torch.device(device)
        torch.empty(0, device=chosen)
    # A build without CUDA raises an AssertionError, a machine without a GPU or an unknown name a RuntimeError.
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        reason = str(error).splitlines()[0]
        raise ValueError(f"device {device!s} cannot be used here: {reason}. Without a GPU, use device=cpu.") from error
    return chosen
