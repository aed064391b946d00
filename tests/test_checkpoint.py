"""Checkpoints are restored exactly, and untrusted files do no harm."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
import safetensors.torch
import torch
from torch import Tensor, nn

from sgbd.checkpoint import Checkpoint, CheckpointError, find_checkpoint, instantiate
from sgbd.models import EdgeClassifier, GatedGCN, ObjectnessHead, SharedMLP
from sgbd.sampling import BalancedEdgeSampler
from tests.graph_samples import grid_graph

MLP = {"_target_": "sgbd.models.SharedMLP", "node_channels": 3, "edge_channels": 2, "hidden_channels": [8, 8]}
HEAD = {"_target_": "sgbd.models.ObjectnessHead", "node_channels": 3}


class OwnModel(EdgeClassifier):
    """A user-defined class in a user's package."""

    def __init__(self, node_channels: int, edge_channels: int) -> None:
        super().__init__(node_channels, edge_channels)
        self.linear = nn.Linear(2 * node_channels + edge_channels, 1)

    def score(self, source: Tensor, target: Tensor, edge: Tensor) -> Tensor:
        return self.linear(torch.cat([source, target, edge], dim=1)).squeeze(1)


def checkpoint(**recipe: Any) -> Checkpoint:
    torch.manual_seed(0)
    model, head = SharedMLP(3, 2, hidden_channels=[8, 8]), ObjectnessHead(3)
    graph = grid_graph(4, 5)
    for module in (model, head):
        module.standardize_nodes.fit([graph.x])
        module.train()(graph)  # running moments differ from their initial values
    return Checkpoint(model, head, {"model": MLP, "objectness": HEAD, **recipe})


def write(path: Path, header: dict | None, tensors: dict[str, Tensor] | None = None) -> Path:
    metadata = None if header is None else {"sgbd": json.dumps(header)}
    path.write_bytes(safetensors.torch.save(tensors or {"a": torch.zeros(1)}, metadata=metadata))
    return path


def header(recipe: Any, version: int = 1) -> dict:
    return {"format": "sgbd checkpoint", "format_version": version, "recipe": recipe}


def test_round_trip_gives_the_same_logits_and_recipe(tmp_path: Path) -> None:
    saved = checkpoint(features={"node": ["rgb"], "edge": []}, scores={"overlap_f": 0.5})
    loaded = Checkpoint.load(saved.save(tmp_path / "checkpoint.safetensors"))
    graph = grid_graph(4, 5, seed=1)
    assert loaded.recipe == saved.recipe
    assert loaded.objectness is not None
    assert saved.objectness is not None
    assert not loaded.model.training
    with torch.no_grad():
        assert torch.equal(loaded.model(graph), saved.model.eval()(graph))
        assert torch.equal(loaded.objectness(graph), saved.objectness.eval()(graph))


def test_half_precision_rounds_weights_but_not_moments(tmp_path: Path) -> None:
    saved = checkpoint()
    saved.model.standardize_nodes.mean += 1e-5  # lost in float16
    path = saved.save(tmp_path / "checkpoint.safetensors", half_precision=True)
    assert path.stat().st_size < 0.65 * len(saved.to_bytes())
    loaded = Checkpoint.load(path)
    for name, parameter in saved.model.named_parameters():
        assert torch.equal(loaded.model.get_parameter(name), parameter.half().float()), name
    for name, buffer in saved.model.named_buffers():
        assert torch.equal(loaded.model.get_buffer(name), buffer), name
    assert {value.dtype for value in loaded.model.parameters()} == {torch.float32}
    assert loaded.to_bytes(half_precision=True) == path.read_bytes()


def test_equal_checkpoints_are_equal_files() -> None:
    assert checkpoint(a=1, b=2).to_bytes() == checkpoint(b=2, a=1).to_bytes()


def test_without_objectness(tmp_path: Path) -> None:
    saved = Checkpoint(SharedMLP(3, 2, hidden_channels=[8, 8]), None, {"model": MLP, "objectness": None})
    assert Checkpoint.load(saved.save(tmp_path / "c.safetensors")).objectness is None


def test_own_class_needs_trust(tmp_path: Path) -> None:
    target = f"{__name__}.OwnModel"
    recipe = {"model": {"_target_": target, "node_channels": 3, "edge_channels": 2}}
    path = Checkpoint(OwnModel(3, 2), None, recipe).save(tmp_path / "c.safetensors")
    package = __name__.partition(".")[0]
    with pytest.raises(CheckpointError, match=rf"names {target}, which is not in sgbd.*trust=\['{package}'\]"):
        Checkpoint.load(path)
    assert type(Checkpoint.load(path, trust=[package]).model).__name__ == "OwnModel"


@pytest.mark.parametrize(
    "target",
    [
        "os.system",
        "builtins.eval",
        "sgbd_evil.Model",
        "sgbd.checkpoint.importlib.import_module",
        "sgbd.checkpoint.Path",
        "sgbd.machine.atomic_file.os.system",
    ],
)
def test_foreign_targets_are_never_resolved_to_a_call(target: str, tmp_path: Path) -> None:
    path = write(tmp_path / "c.safetensors", header({"model": {"_target_": target, "command": "true"}}))
    with pytest.raises(CheckpointError, match="which is not in sgbd"):
        Checkpoint.load(path)
    nested = write(tmp_path / "n.safetensors", header({"model": {**MLP, "bias": {"_target_": target}}}))
    with pytest.raises(CheckpointError, match="which is not in sgbd"):
        Checkpoint.load(nested)


def test_own_functions_are_not_called_either(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    config = {"_target_": "sgbd.machine.atomic_file.write_whole", "path": str(victim), "content": "x"}
    for recipe in ({"model": config}, {"model": {**MLP, "bias": config}}):
        with pytest.raises(CheckpointError, match="must not call functions"):
            Checkpoint.load(write(tmp_path / "c.safetensors", header(recipe)))
    assert not victim.exists()


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (None, "names no class"),
        ({"hidden": 3}, "names no class"),
        (HEAD, "no EdgeClassifier"),
        ({**MLP, "_target_": "sgbd.models.NoSuchModel"}, "does not exist"),
        ({**MLP, "_target_": "sgbd.no_such_module.Model"}, "does not exist"),
        ({**MLP, "_target_": "sgbd"}, "does not exist"),
        ({**MLP, "colour": "red"}, "cannot be made with the recipe's arguments"),
    ],
)
def test_recipes_without_a_usable_model(config: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=message) as caught:
        Checkpoint.load(write(tmp_path / "c.safetensors", header({"model": config})))
    assert "c.safetensors" in str(caught.value)


def test_instantiate_makes_nested_objects_and_refers_to_functions() -> None:
    sampler = instantiate({"_target_": "sgbd.sampling.BalancedEdgeSampler", "pairs_per_graph": 3}, BalancedEdgeSampler)
    assert sampler.pairs_per_graph == 3
    partial = instantiate({"_target_": "sgbd.sampling.graphs_of_pairs", "_partial_": True}, object)
    assert partial(grid_graph(2, 2))[0] == 1  # type: ignore[operator]


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"does not exist.*python -m sgbd\.train"):
        Checkpoint.load(tmp_path / "none.safetensors")
    with pytest.raises(CheckpointError, match="is a folder"):
        Checkpoint.load(tmp_path)


@pytest.mark.parametrize("kept", [0, 5, 200, -1])
def test_truncated_file(kept: int, tmp_path: Path) -> None:
    path = checkpoint().save(tmp_path / "c.safetensors")
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(CheckpointError, match="cannot be read as a safetensors file"):
        Checkpoint.load(path)


def test_another_kind_of_file(tmp_path: Path) -> None:
    path = tmp_path / "weights.pt"
    torch.save({"a": torch.zeros(3)}, path)
    with pytest.raises(CheckpointError, match="cannot be read as a safetensors file"):
        Checkpoint.load(path)


def test_bare_weights(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="without a recipe"):
        Checkpoint.load(write(tmp_path / "c.safetensors", None))


def test_another_format_version(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="format version 99; this version of sgbd reads version 1"):
        Checkpoint.load(write(tmp_path / "c.safetensors", header({"model": MLP}, version=99)))


def test_weights_that_do_not_fit(tmp_path: Path) -> None:
    tensors = {f"model.{key}": value for key, value in SharedMLP(3, 2).state_dict().items()}
    with pytest.raises(CheckpointError, match="weights do not fit the recipe"):
        Checkpoint.load(write(tmp_path / "c.safetensors", header({"model": MLP}), tensors))


def test_a_checkpoint_of_another_recipe_names_the_differences() -> None:
    saved = checkpoint(features={"node": ["rgb", "depth"], "edge": []}, superpixels={"n_segments": 128})
    saved.require(features={"node": ("rgb", "depth"), "edge": []}, superpixels={"n_segments": 128})
    with pytest.raises(CheckpointError) as caught:
        saved.require(features={"node": ["rgb"], "edge": []}, superpixels={"n_segments": 256})
    assert "checkpoint of another recipe" in str(caught.value)
    assert "features.node is ['rgb', 'depth'] in the checkpoint and ['rgb'] here" in str(caught.value)
    assert "superpixels.n_segments is 128 in the checkpoint and 256 here" in str(caught.value)
    assert "features.edge" not in str(caught.value)


def test_a_recipe_must_say_how_to_make_the_modules(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"section 'model' is None.*SharedMLP"):
        Checkpoint(SharedMLP(3, 2), None, {}).save(tmp_path / "c")
    with pytest.raises(CheckpointError, match=r"'sgbd.models.SharedMLP', but the module to save is GatedGCN"):
        Checkpoint(GatedGCN(3, 2), None, {"model": MLP}).save(tmp_path / "c")
    with pytest.raises(CheckpointError, match="section 'objectness'"):
        Checkpoint(SharedMLP(3, 2), None, {"model": MLP, "objectness": HEAD}).save(tmp_path / "c")


@pytest.mark.parametrize("value", [object(), float("nan"), Path("x")])
def test_a_recipe_must_be_json(value: object, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="JSON values only"):
        checkpoint(note=value).save(tmp_path / "c")
    assert list(tmp_path.iterdir()) == []


def test_the_newest_checkpoint_is_found(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"no trained model in .*python -m sgbd\.train"):
        find_checkpoint(None, tmp_path)
    for age, name in ((10, "old"), (5, "new"), (20, "oldest")):
        path = tmp_path / name / "checkpoint.safetensors"
        path.parent.mkdir()
        path.write_bytes(b"")
        os.utime(path, (1_000_000 - age, 1_000_000 - age))
    assert find_checkpoint(None, tmp_path) == tmp_path / "new/checkpoint.safetensors"
    assert find_checkpoint(str(tmp_path / "old"), tmp_path) == tmp_path / "old/checkpoint.safetensors"
    assert find_checkpoint("else/where.safetensors", tmp_path) == Path("else/where.safetensors")
