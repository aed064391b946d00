"""Export of trained networks to ONNX, checked against PyTorch."""

from __future__ import annotations

import copy
import importlib
import io
import json
import logging
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn
from torch_geometric.data import Data

from sgbd import __version__
from sgbd.benchmarking.timing import Timing, take_turns
from sgbd.checkpoint import Checkpoint, instantiate
from sgbd.features import EDGE_NAMES, NODE_NAMES, edge_columns, node_columns
from sgbd.jobs.configuration import ConfigurationError
from sgbd.machine.availability import NotAvailableError
from sgbd.machine.torch_threads import torch_threads
from sgbd.models import EdgeClassifier, EdgeTransformer, ObjectnessHead
from sgbd.node_block import split_groups
from sgbd.own_columns import own_columns

if TYPE_CHECKING:
    import onnxruntime

METADATA_KEY = "sgbd"
TOLERANCE = 1e-5
"""Maximum difference from PyTorch's logits s, relative to 1 + |s|, because float32 limits the digits of large ones."""
SIZES = ((1, 0), (2, 1), (40, 95), (600, 1550), (1500, 4000))
"""Numbers of nodes and pairs of the graphs on which a model is checked."""
SMALLEST_OPSET = 18
"""The first opset with scatter sums and maxima, which message passing needs."""


class ExportError(ValueError):
    """Raised if a model cannot be exported; the message says why and what to do."""


@dataclass(frozen=True)
class Check:
    """Agreement and speed on one graph.

    Attributes:
        nodes: Number of superpixels.
        pairs: Number of adjacencies.
        difference: Largest difference from PyTorch's logits s, relative to 1 + |s|.
        torch: Time of PyTorch; None if not measured.
        onnx: Time of ONNX Runtime; None if not measured.
    """

    nodes: int
    pairs: int
    difference: float
    torch: Timing | None = None
    onnx: Timing | None = None


class Networks(nn.Module):
    """Edge model and objectness head as one module with plain tensors as inputs and outputs.

    Args:
        model: The edge model, which is copied.
        objectness: The objectness head, which is copied too, or None.
    """

    def __init__(self, model: EdgeClassifier, objectness: ObjectnessHead | None) -> None:
        super().__init__()
        self.model = copy.deepcopy(model)
        self.objectness = copy.deepcopy(objectness)
        self.cpu().eval()

    def forward(self, x: Tensor, pairs: Tensor, edge_attr: Tensor | None = None) -> tuple[Tensor, ...]:
        """Classify the pairs and superpixels of a graph with the layout of `sgbd.graph.build_graph`.

        Args:
            x: float32 [N, F], node features.
            pairs: int64 [2, E], every adjacency once, i < j.
            edge_attr: float32 [2E, D], edge features of the pairs, then of the same pairs reversed; None if the model
                has none.

        Returns:
            Merge logits float32 [E] and, with a head, object logits float32 [N].
        """
        if edge_attr is None:
            edge_attr = x.new_zeros(2 * pairs.size(1), 0)
        merge = self.model.pair_logits(x, pairs, edge_attr)
        if self.objectness is None:
            return (merge,)
        # The head reads only these fields of PyG's `Data`.
        graph = SimpleNamespace(x=x, edge_index=torch.cat([pairs, pairs.flip(0)], dim=1))
        return merge, self.objectness(graph)


def to_onnx(checkpoint: Checkpoint, opset: int = SMALLEST_OPSET, trust: Sequence[str] = ()) -> bytes:
    """Export a checkpoint's networks, without those of a first stage, to ONNX.

    Args:
        checkpoint: The networks and their recipe.
        opset: ONNX opset version.
        trust: Names of packages besides `sgbd` whose classes the recipe may name.

    Returns:
        The content of the ONNX file. Inputs and outputs are those of `Networks`, for any number of nodes and pairs.
        There is no input `edge_attr` if the model has no edge features, and no output `object_logits` without a head.
        The metadata key `sgbd` contains a JSON text with the recipe, the names of the feature columns, and a
        description of the inputs and outputs.

    Raises:
        sgbd.machine.availability.NotAvailableError: If a package needed for the export is missing.
        ConfigurationError: If the opset is not supported.
        ExportError: If PyTorch cannot convert the model to ONNX operators.
    """
    onnx = _required("onnx")
    _required("onnxscript")
    newest = onnx.defs.onnx_opset_version()
    if not isinstance(opset, int) or not SMALLEST_OPSET <= opset <= newest:
        raise ConfigurationError(f"opset must be an integer from {SMALLEST_OPSET} to {newest}; got {opset!r}")
    metadata = description(checkpoint, opset, trust)
    names = input_names(checkpoint)
    example = random_graph(checkpoint, 7, 9, np.random.default_rng(0))
    nodes, pairs = torch.export.Dim("nodes", min=2), torch.export.Dim("pairs", min=2)
    shapes: dict[str, Any] = {"x": {0: nodes}, "pairs": {1: pairs}, "edge_attr": {0: 2 * pairs}}
    with _silence():
        try:
            program = torch.onnx.export(
                Networks(checkpoint.model, checkpoint.objectness),
                tuple(torch.from_numpy(example[name]) for name in names),
                input_names=list(names),
                output_names=list(output_names(checkpoint)),
                opset_version=opset,
                dynamo=True,
                dynamic_shapes=tuple(shapes[name] for name in names),
                custom_translation_table={torch.ops.aten.sigmoid.default: _sigmoid},
                verbose=False,
            )
        except torch.onnx.OnnxExporterError as error:
            reason = str(error.__cause__ or error).strip().splitlines()[0]
            raise ExportError(
                f"{type(checkpoint.model).__name__} cannot be turned into ONNX operators of opset {opset}: {reason}. "
                "A model of your own must have a method pair_logits without branches that depend on values; see "
                "sgbd.models.EdgeClassifier."
            ) from error
        assert program is not None
    model = program.model_proto
    (got,) = (entry.version for entry in model.opset_import if entry.domain == "")
    if got != opset:
        raise ExportError(
            f"PyTorch wrote {type(checkpoint.model).__name__} in opset {got} instead of {opset}. Choose opset={got}."
        )
    model.doc_string = f"sgbd {__version__}: merge logits of pairs of superpixels"
    onnx.helper.set_model_props(model, {METADATA_KEY: json.dumps(metadata, sort_keys=True)})
    onnx.checker.check_model(model)
    content: bytes = model.SerializeToString()
    return content


def _sigmoid(values: Any) -> Any:
    """Translate a sigmoid to 1 / (1 + exp(-v)).

    ONNX Runtime's own sigmoid has an absolute error of 1e-7, not a relative one. A gated convolution divides by the sum
    of the gates around a node: if all of these are nearly 0, logits would be off by one per cent.
    """
    from onnxscript import opset18

    return opset18.Reciprocal(opset18.Add(opset18.Exp(opset18.Neg(values)), 1.0))


def description(checkpoint: Checkpoint, opset: int, trust: Sequence[str] = ()) -> dict[str, Any]:
    """Return what a user of the file needs to know, as JSON values; arguments and errors are those of `to_onnx`."""
    meaning = {
        "x": "float32 [nodes, F], node features, columns as node_columns, not standardised",
        "pairs": "int64 [2, pairs], every adjacency once, i < j",
        "edge_attr": "float32 [2*pairs, D], edge features of the pairs, then of the same pairs reversed, columns as "
        "edge_columns, not standardised",
        "merge_logits": "float32 [pairs], the merge probability is their sigmoid",
        "object_logits": "float32 [nodes], the objectness is their sigmoid",
    }
    node_names, edge_names = column_names(checkpoint, trust)
    return {
        "version": __version__,
        "opset": opset,
        "inputs": {name: meaning[name] for name in input_names(checkpoint)},
        "outputs": {name: meaning[name] for name in output_names(checkpoint)},
        "node_columns": node_names,
        "edge_columns": edge_names,
        "recipe": checkpoint.recipe,
    }


def column_names(checkpoint: Checkpoint, trust: Sequence[str] = ()) -> tuple[list[str], list[str]]:
    """Return the names of the feature columns that a model reads, in order.

    Args:
        checkpoint: The networks and their recipe.
        trust: Names of packages besides `sgbd` whose classes the recipe may name.

    Returns:
        Names of the node columns and of the edge columns. The columns of a node block are named by its group and a
        number, because the real names are only available if the block's weights are.

    Raises:
        ExportError: If the number of columns differs between recipe and model.
    """
    features, model = checkpoint.recipe["features"], checkpoint.model
    own = own_columns(instantiate(checkpoint.recipe.get("graph"), object, trust))
    stored, others = split_groups(features["node"])
    nodes = [*(NODE_NAMES[column] for column in node_columns(stored)), *own.get("own_node_columns", [])]
    for group in others:
        nodes += [f"{group}_{number}" for number in range(model.node_channels - len(nodes))]
    edges = [*(EDGE_NAMES[column] for column in edge_columns(features["edge"])), *own.get("own_edge_columns", [])]
    if (len(nodes), len(edges)) != (model.node_channels, model.edge_channels):
        raise ExportError(
            f"the recipe names {len(nodes)} node and {len(edges)} edge feature columns, but the model reads "
            f"{model.node_channels} and {model.edge_channels}. The checkpoint may be of another version: train anew."
        )
    return nodes, edges


def input_names(checkpoint: Checkpoint) -> tuple[str, ...]:
    """Return the names of the model's inputs."""
    return ("x", "pairs", "edge_attr") if checkpoint.model.edge_channels else ("x", "pairs")


def output_names(checkpoint: Checkpoint) -> tuple[str, ...]:
    """Return the names of the model's outputs."""
    return ("merge_logits",) if checkpoint.objectness is None else ("merge_logits", "object_logits")


def random_graph(
    checkpoint: Checkpoint, nodes: int, pairs: int, generator: np.random.Generator
) -> dict[str, npt.NDArray[Any]]:
    """Generate a random graph whose features have the mean and spread of the training features.

    Args:
        checkpoint: The networks.
        nodes: Number of nodes.
        pairs: Number of distinct pairs.
        generator: Source of randomness.

    Returns:
        x, pairs and edge_attr, as in `Networks.forward`.
    """
    first, second = np.triu_indices(nodes, 1)
    chosen = np.sort(generator.choice(len(first), pairs, replace=False)) if pairs else np.zeros(0, np.int64)
    columns = {
        "x": (checkpoint.model.standardize_nodes, nodes),
        "edge_attr": (checkpoint.model.standardize_edges, 2 * pairs),
    }
    features = {
        name: standardize.mean.cpu().numpy()
        + standardize.scale.cpu().numpy() * generator.standard_normal((rows, len(standardize.mean)))
        for name, (standardize, rows) in columns.items()
    }
    return {
        **{name: values.astype(np.float32) for name, values in features.items()},
        "pairs": np.stack([first[chosen], second[chosen]]).astype(np.int64),
    }


def session(content: bytes) -> onnxruntime.InferenceSession:
    """Load an ONNX model into ONNX Runtime, on one CPU thread.

    Raises:
        sgbd.machine.availability.NotAvailableError: If ONNX Runtime is missing.
        ExportError: If ONNX Runtime cannot run the model.
    """
    runtime = _required("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = 1
    options.log_severity_level = 3  # errors only: the warnings about opsets are of no use to users
    try:
        return runtime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's exceptions have no common base class
        raise ExportError(
            f"ONNX Runtime {runtime.__version__} cannot run the model: {str(error).strip()} Choose a smaller opset "
            f"({SMALLEST_OPSET} or more), or a newer ONNX Runtime. Nothing was written."
        ) from error


def least_pairs(checkpoint: Checkpoint) -> int:
    """Return the minimum number of pairs of a graph: ONNX Runtime cannot run PyG's attention without any edges."""
    return int(isinstance(checkpoint.model, EdgeTransformer))


def check(
    checkpoint: Checkpoint, content: bytes, sizes: Sequence[tuple[int, int]] | None = None, repeats: int = 0
) -> list[Check]:
    """Compare an ONNX model with the PyTorch networks on graphs of several sizes.

    Args:
        checkpoint: The networks.
        content: The ONNX model.
        sizes: Nodes and pairs of each graph; None for those `SIZES` that the model supports (`least_pairs`).
        repeats: Number of timed runs on each graph; 0 for no timing.

    Returns:
        The agreement on each graph.

    Raises:
        ExportError: If the logits differ by more than `TOLERANCE`.
    """
    model = checkpoint.model.cpu().eval()
    head = None if checkpoint.objectness is None else checkpoint.objectness.cpu().eval()
    running = session(content)
    generator = np.random.default_rng(1)
    checks = []
    if sizes is None:
        sizes = [size for size in SIZES if size[1] >= least_pairs(checkpoint)]
    for nodes, pairs in sizes:
        graph = random_graph(checkpoint, nodes, pairs, generator)
        feed = {name: graph[name] for name in input_names(checkpoint)}
        tensors = {name: torch.from_numpy(value) for name, value in graph.items()}
        # User-defined networks may need a full PyG `Data`; those of this package only read its fields.
        data = Data(
            x=tensors["x"],
            edge_index=torch.cat([tensors["pairs"], tensors["pairs"].flip(0)], dim=1),
            edge_attr=tensors["edge_attr"],
            edge_label_index=tensors["pairs"],
        )

        @torch.inference_mode()
        def by_torch(_: int = 0, data: Any = data) -> list[Tensor]:
            return [model(data)] if head is None else [model(data), head(data)]

        def by_onnx(_: int = 0, feed: Mapping[str, npt.NDArray[Any]] = feed) -> Any:
            return running.run(None, dict(feed))

        timings: dict[str, Timing] = {}
        with torch_threads(1):
            difference = largest_difference([logits.numpy() for logits in by_torch()], by_onnx())
            # Negated, so that NaN fails the check.
            if not difference <= TOLERANCE:
                raise ExportError(
                    f"the ONNX model's logits s differ from PyTorch's by {difference:.1e} of 1 + |s| on a graph of "
                    f"{nodes} nodes and {pairs} pairs; at most {TOLERANCE:.0e} is allowed. Nothing was written. A "
                    "model of your own with its own forward needs a pair_logits that gives the same."
                )
            if repeats:
                timings = take_turns({"torch": by_torch, "onnx": by_onnx}, range(repeats)).timings()
        checks.append(Check(nodes, pairs, difference, timings.get("torch"), timings.get("onnx")))
    return checks


def largest_difference(expected: Sequence[npt.NDArray[Any]], given: Sequence[npt.NDArray[Any]]) -> float:
    """Return the largest difference of logits from the expected logits s, relative to 1 + |s|.

    Args:
        expected: Arrays of expected logits, float [R] each.
        given: Arrays of logits with the same shapes.

    Returns:
        The difference; NaN if a logit is NaN, infinity if the shapes differ.
    """
    if [logits.shape for logits in expected] != [logits.shape for logits in given]:
        return float("inf")
    shares = [np.abs(theirs - ours) / (1 + np.abs(ours)) for ours, theirs in zip(expected, given, strict=True)]
    return float(np.max(np.concatenate(shares), initial=0))


def _required(package: str) -> Any:
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise NotAvailableError(
            f"the export needs the package {package}, which cannot be imported ({error}). Install the extra: "
            "pip install 'sgbd[export]'"
        ) from error


@contextmanager
def _silence() -> Iterator[None]:
    """Silence the log messages and warnings of PyTorch's exporter; its errors are exceptions."""
    loggers = [logging.getLogger(name) for name in ("torch.onnx", "onnxscript", "onnx_ir")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
