from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from torch import Tensor

from sgbd.agglomeration import EDGE_COLUMNS, NODE_COLUMNS
from sgbd.checkpoint import Checkpoint
from sgbd.export import files_of_stages, table
from sgbd.features import EDGE_NAMES, NODE_GROUPS, NODE_NAMES
from sgbd.jobs.configuration import ConfigurationError
from sgbd.jobs.untrained import untrained_checkpoint
from sgbd.machine.availability import NotAvailableError
from sgbd.models import SharedMLP
from sgbd.onnx_export import (
    Check,
    ExportError,
    check,
    column_names,
    largest_difference,
    least_pairs,
    random_graph,
    session,
    to_onnx,
)

onnx = pytest.importorskip("onnx", reason="the extra sgbd[export] is not installed")
pytest.importorskip("onnxruntime", reason="the extra sgbd[export] is not installed")
pytest.importorskip("onnxscript", reason="the extra sgbd[export] is not installed")

CONF = Path(__file__).parents[1] / "conf"
MODELS = sorted(path.stem for path in (CONF / "model").glob("*.yaml"))
SIZES = ((1, 0), (5, 0), (2, 1), (3, 2), (11, 30), (200, 600))


def made(*overrides: str) -> Checkpoint:
    """Return networks with changed buffers, because initial buffers have no effect and would hide errors."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        config = compose("train", list(overrides))
    GlobalHydra.instance().clear()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        checkpoint = untrained_checkpoint(config)
    generator = torch.Generator().manual_seed(1)
    for module in (checkpoint.model, checkpoint.objectness):
        if module is not None:
            module.eval()
            for name, buffer in module.named_buffers():
                if buffer.is_floating_point():
                    noise = torch.rand(buffer.shape, generator=generator)
                    buffer.copy_(noise - 0.5 if name.endswith("mean") else noise + 0.5)
    return checkpoint


@functools.cache
def exported(*overrides: str) -> tuple[Checkpoint, bytes]:
    """A checkpoint and its file, created once for all tests, which must not change them."""
    checkpoint = made(*overrides)
    return checkpoint, to_onnx(checkpoint)


@pytest.mark.parametrize("model", MODELS)
def test_shipped_models_agree_on_graphs_of_every_size(model: str) -> None:
    checkpoint, content = exported(f"model={model}", "features=all")
    sizes = [size for size in SIZES if size[1] >= least_pairs(checkpoint)]
    assert len(sizes) == len(SIZES) - 2 * (model == "attention")
    checks = check(checkpoint, content, sizes)
    assert [(row.nodes, row.pairs) for row in checks] == sizes
    assert max(row.difference for row in checks) <= 1e-5
    assert checks[-1].torch is None


@pytest.mark.parametrize("model", ["gated_gcn", "symmetric_gcn"])
def test_gates_that_are_all_but_shut_agree(model: str) -> None:
    """A node divides by the sum of its gates, so a sigmoid with an absolute error of 1e-7 is not accurate enough."""
    checkpoint = made(f"model={model}", "features=all")
    for layer in checkpoint.model.layers:  # type: ignore[union-attr]
        with torch.no_grad():
            layer.node_linear.bias[: checkpoint.model.hidden_channels] -= 14  # type: ignore[index, operator]
    content = to_onnx(checkpoint)
    assert "Sigmoid" not in {node.op_type for node in onnx.load_from_string(content).graph.node}
    assert max(row.difference for row in check(checkpoint, content, SIZES)) <= 1e-5


def test_without_edge_features_and_head_there_are_none() -> None:
    checkpoint, content = exported("model=symmetric_gcn", "features=paper", "objectness=none")
    running = session(content)
    assert [entry.name for entry in running.get_inputs()] == ["x", "pairs"]
    assert [entry.name for entry in running.get_outputs()] == ["merge_logits"]
    check(checkpoint, content, SIZES)


def test_the_file_says_what_it_is() -> None:
    checkpoint, content = exported("model=gated_gcn", "features=all")
    file = onnx.load_from_string(content)
    assert {entry.domain: entry.version for entry in file.opset_import}[""] == 18
    (told,) = [json.loads(entry.value) for entry in file.metadata_props if entry.key == "sgbd"]
    assert told["opset"] == 18
    assert told["node_columns"] == list(NODE_NAMES)
    assert told["edge_columns"] == list(EDGE_NAMES)
    assert told["recipe"] == checkpoint.recipe
    running = session(content)
    assert running.get_inputs()[0].shape == ["nodes", len(NODE_NAMES)]
    assert (
        [entry.name for entry in running.get_inputs()]
        == ["x", "pairs", "edge_attr"]
        == sorted(told["inputs"], key=["x", "pairs", "edge_attr"].index)
    )
    assert [entry.name for entry in running.get_outputs()] == ["merge_logits", "object_logits"] == list(told["outputs"])


def test_networks_are_not_changed() -> None:
    checkpoint, _ = exported("model=gated_gcn", "features=all")
    fresh = made("model=gated_gcn", "features=all")
    assert not checkpoint.model.training
    assert checkpoint.to_bytes() == fresh.to_bytes()


def test_a_file_that_computes_something_else_is_refused() -> None:
    _, content = exported("model=mlp", "features=all")
    other = made("model=mlp", "features=all")
    assert isinstance(other.model, SharedMLP)
    with torch.no_grad():
        other.model.mlp.lins[-1].bias += 1e-3
    with pytest.raises(ExportError, match=r"differ from PyTorch's by .* Nothing was written"):
        check(other, content, SIZES[-1:])


def test_what_is_no_model_is_told() -> None:
    with pytest.raises(ExportError, match="ONNX Runtime .* cannot run the model"):
        session(b"no model")


def test_speed_is_measured_on_request() -> None:
    checkpoint, content = exported("model=mlp", "features=all")
    (row,) = check(checkpoint, content, ((5, 6),), repeats=2)
    assert row.torch is not None
    assert row.onnx is not None
    assert row.torch.repeats == row.onnx.repeats == 2
    assert "PyTorch ms" in table([row])
    assert table([Check(5, 6, 1e-7)]).splitlines()[-1].split() == ["|", "5", "|", "6", "|", "1.0e-07", "|"]


def test_a_model_that_depends_on_values_is_explained() -> None:
    class Branching(SharedMLP):
        def score_pairs(self, nodes: Tensor, edges: Tensor, pairs: Tensor) -> Tensor:
            scores = super().score_pairs(nodes, edges, pairs)
            return scores if float(scores.sum()) > 0 else -scores

    checkpoint = made("model=mlp", "features=all")
    checkpoint.model = Branching(checkpoint.model.node_channels, checkpoint.model.edge_channels).eval()
    with pytest.raises(ExportError, match="Branching cannot be turned into ONNX operators of opset 18"):
        to_onnx(checkpoint)


@pytest.mark.parametrize("opset", [9, 1000, "18"])
def test_impossible_opsets_are_told(opset: object) -> None:
    with pytest.raises(ConfigurationError, match=f"opset must be an integer from 18 to [0-9]+; got {opset!r}"):
        to_onnx(made(), opset)  # type: ignore[arg-type]


def test_missing_packages_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "onnxscript", None)
    with pytest.raises(NotAvailableError, match=r"pip install 'sgbd\[export\]'"):
        to_onnx(made())


def test_differences_are_relative_to_large_logits() -> None:
    expected = [np.array([0.0, 99.0]), np.array([1.0])]
    assert largest_difference(expected, [np.array([0.25, 99.0]), np.array([1.0])]) == 0.25
    assert largest_difference(expected, [np.array([0.0, 100.0]), np.array([1.0])]) == 0.01
    assert np.isnan(largest_difference(expected, [np.array([0.0, np.nan]), np.array([1.0])]))
    assert largest_difference(expected, [np.array([0.0]), np.array([1.0])]) == np.inf
    assert largest_difference([np.zeros(0)], [np.zeros(0)]) == 0


def test_made_up_graphs_are_spread_like_the_training_set() -> None:
    checkpoint = made()
    graph = random_graph(checkpoint, 300, 800, np.random.default_rng(0))
    np.testing.assert_allclose(graph["x"].mean(0), checkpoint.model.standardize_nodes.mean.numpy(), atol=0.3)
    assert (graph["pairs"][0] < graph["pairs"][1]).all()
    assert len(np.unique(graph["pairs"], axis=1).T) == 800


def test_columns_of_node_blocks_and_builders_are_named() -> None:
    checkpoint = made()
    plain = [name for group in ("rgb", "depth") for name in NODE_GROUPS[group]]
    own = {"_target_": "sgbd.agglomeration.AgglomeratedGraph", "first_stage": "sha256:0"}
    checkpoint.recipe |= {"graph": own, "features": {"node": ["rgb", "depth", "dino"], "edge": []}}
    checkpoint.model = SharedMLP(len(plain) + len(NODE_COLUMNS) + 2, len(EDGE_COLUMNS))
    nodes, edges = column_names(checkpoint)
    assert sorted(nodes) == sorted([*plain, *NODE_COLUMNS, "dino_0", "dino_1"])
    assert nodes[-3:] == [*NODE_COLUMNS, "dino_0", "dino_1"]
    assert edges == list(EDGE_COLUMNS)
    checkpoint.model = SharedMLP(3, 0)
    with pytest.raises(ExportError, match="the model reads 3 and 0"):
        column_names(checkpoint)


def test_each_stage_has_its_file() -> None:
    first, second = made(), made()
    second.first_stage = first
    files = files_of_stages(second, Path("folder/merge.onnx"))
    assert list(files.items()) == [
        (Path("folder/merge.onnx"), second),
        (Path("folder/merge.first_stage.onnx"), first),
    ]
