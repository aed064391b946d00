"""The training loop learns, is reproducible, resumes after being killed, and reports errors."""

from __future__ import annotations

import copy
import functools
import logging
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import torch
from hydra.utils import instantiate
from lightning_fabric.loggers import CSVLogger, TensorBoardLogger
from omegaconf import OmegaConf
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch import Generator
from torch_geometric.data import Data

from sgbd.augmentation import GraphAugmentation
from sgbd.checkpoint import Checkpoint, CheckpointError
from sgbd.losses import EdgeLoss
from sgbd.machine import one_ahead
from sgbd.models import EdgeClassifier, GatedGCN, ObjectnessHead, SharedMLP, SymmetricGCN
from sgbd.sampling import AllEdges, BalancedEdgeSampler
from sgbd.training import Trainer, TrainingError, TrainingResult
from tests.graph_samples import grid_graph, path_graph

CONF = Path(__file__).parents[2] / "conf"
MLP = {"_target_": "sgbd.models.SharedMLP", "node_channels": 3, "edge_channels": 2, "hidden_channels": [16, 16]}
HEAD = {"_target_": "sgbd.models.ObjectnessHead", "node_channels": 3, "dropout": 0.2}
RECIPE: dict[str, Any] = {"model": MLP, "objectness": HEAD, "features": {"node": ["rgb"], "edge": None}}

GRAPHS = [grid_graph(4, 8, seed=seed) for seed in range(10)]
SCHEDULER = functools.partial(torch.optim.lr_scheduler.StepLR, step_size=1, gamma=0.5)


class Killed(BaseException):
    """Simulates the end of the process: nothing in the package may catch it."""


def accuracy(model: EdgeClassifier, objectness: ObjectnessHead | None) -> Mapping[str, float]:
    """Return the shares of correct edges and nodes on graphs that were not trained on."""
    assert not model.training
    graphs = [grid_graph(4, 8, seed=seed) for seed in range(50, 54)]
    right = torch.cat([(model(graph) > 0) == graph.edge_label.bool() for graph in graphs]).float().mean()
    return {"overlap_f": float(right), "other": 1.0}


def scripted(scores: list[float]) -> Callable[..., Mapping[str, float]]:
    """Return a validation function that yields the given scores, one per epoch."""
    given: Iterator[float] = iter(scores)
    return lambda model, objectness: {"overlap_f": next(given)}


class KillingSampler(BalancedEdgeSampler):
    """Kills the process at a given step."""

    def __init__(self, step: int, error: type[BaseException] = Killed) -> None:
        super().__init__(16)
        self.step, self.error = step, error

    def __repr__(self) -> str:
        return repr(BalancedEdgeSampler(16))

    def __call__(self, batch: Data, generator: Generator) -> Data:
        self.step -= 1
        if self.step < 0:
            raise self.error
        return super().__call__(batch, generator)


def modules() -> tuple[SharedMLP, ObjectnessHead]:
    torch.manual_seed(0)
    return SharedMLP(3, 2, hidden_channels=[16, 16], dropout=0.1), ObjectnessHead(3, dropout=0.2)


def run(folder: Path, trainer: Trainer | None = None, **options: Any) -> tuple[TrainingResult, dict[str, torch.Tensor]]:
    """Train small modules and return the result with all weights."""
    model, head = modules()
    trainer = trainer or Trainer(epochs=4, scheduler=SCHEDULER, progress=False)
    options = {"sampler": BalancedEdgeSampler(16), "recipe": RECIPE, "validate": accuracy, "graphs": GRAPHS} | options
    result = trainer.train(model, folder=folder, objectness=head, **options)
    return result, {**model.state_dict(), **{f"head.{key}": value for key, value in head.state_dict().items()}}


def last_weights(folder: Path) -> dict[str, torch.Tensor]:
    return torch.load(folder / "state.pt", weights_only=True)["joint"]


def assert_same(ours: Mapping[str, torch.Tensor], theirs: Mapping[str, torch.Tensor]) -> None:
    assert ours.keys() == theirs.keys()
    different = [key for key in ours if not torch.equal(ours[key], theirs[key])]
    assert different == []


def test_learns_what_the_features_give_away(tmp_path: Path) -> None:
    result, _ = run(
        tmp_path, Trainer(epochs=12, progress=False, optimizer=functools.partial(torch.optim.Adam, lr=1e-2))
    )
    assert result.best_score is not None
    assert result.best_score > 0.95
    losses = result.history.loss
    assert losses.iloc[-1] < 0.5 * losses.iloc[0]
    assert result.history.objectness_loss.iloc[-1] < result.history.objectness_loss.iloc[0]


def test_the_log_has_a_line_for_every_epoch(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, logger="sgbd.training"):
        history = run(tmp_path, Trainer(epochs=2, progress=False))[0].history
    scores = history["val/overlap_f"]
    assert len(caplog.messages) == 2
    for index, line in enumerate(caplog.messages):
        assert line.startswith(f"epoch {index + 1} of 2: loss {history.loss[index]:.3f}, ")
        assert f", validation {scores[index]:.4f}, best {scores[: index + 1].max():.4f} (epoch " in line


def test_the_loss_is_the_mean_over_drawn_pairs_and_known_superpixels(tmp_path: Path) -> None:
    torch.manual_seed(0)
    graph = path_graph([1.0, 0.0, 0.0])
    graph.node_instance = torch.tensor([2, 0, -1, 1])
    model, head = SharedMLP(3, 2, hidden_channels=[4]), ObjectnessHead(3, hidden_channels=[4])
    for module in (model, head):
        for value in module.parameters():
            value.data.zero_()
    model.mlp.lins[-1].bias.data.fill_(1.0)
    head.mlp.lins[-1].bias.data.fill_(2.0)
    trainer = Trainer(epochs=1, progress=False, objectness_weight=0.5)
    recipe = {"model": {**MLP, "hidden_channels": [4]}, "objectness": {**HEAD, "hidden_channels": [4]}}
    result = trainer.train(
        model, [graph], sampler=BalancedEdgeSampler(8, 0.25), folder=tmp_path, recipe=recipe, objectness=head
    )
    row = result.history.iloc[0]

    def cost(logit: float, label: float) -> float:
        return math.log(1 + math.exp(-logit if label else logit))

    assert row.edge_loss == pytest.approx((2 * cost(1, 1) + 6 * cost(1, 0)) / 8, rel=1e-6)
    assert row.objectness_loss == pytest.approx((cost(2, 1) + 2 * cost(2, 0)) / 3, rel=1e-6)
    assert row.loss == pytest.approx(row.edge_loss + 0.5 * row.objectness_loss, rel=1e-6)


def test_a_model_with_logits_of_another_shape_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    score = SharedMLP.score
    monkeypatch.setattr(SharedMLP, "score", lambda *given: score(*given).unsqueeze(1))
    with pytest.raises(TrainingError, match=r"one merge logit for each of 64 pairs, .* \[64\]; got \[64, 1\]$"):
        run(tmp_path, Trainer(epochs=1, progress=False))


def constant_model(logit: float) -> SharedMLP:
    model = SharedMLP(3, 2, hidden_channels=[4])
    for value in model.parameters():
        value.data.zero_()
    model.mlp.lins[-1].bias.data.fill_(logit)
    return model


def test_the_sampled_weights_reach_the_loss(tmp_path: Path) -> None:
    graph = path_graph([1.0, 0.0, -1.0, 0.0])
    graph.border_length = torch.tensor([8.0, 2.0, 50.0, 6.0])
    result = Trainer(epochs=1, progress=False).train(
        constant_model(1.0),
        [graph],
        sampler=AllEdges(border_exponent=1.0),
        folder=tmp_path,
        recipe={"model": {**MLP, "hidden_channels": [4]}},
    )
    merge, cut = math.log(1 + math.exp(-1)), math.log(1 + math.exp(1))
    assert result.history.edge_loss[0] == pytest.approx((8 * merge + (2 + 6) * cut) / 16, rel=1e-6)


def test_the_configured_loss_is_what_is_minimised(tmp_path: Path) -> None:
    result = Trainer(epochs=1, progress=False, edge_loss=EdgeLoss(gamma=2.0, balanced=True)).train(
        constant_model(1.0),
        [path_graph([1.0, 0.0, 0.0, 0.0])],
        sampler=AllEdges(),
        folder=tmp_path,
        recipe={"model": {**MLP, "hidden_channels": [4]}},
    )
    right = 1 / (1 + math.exp(-1))
    merge, cut = -((1 - right) ** 2) * math.log(right), -(right**2) * math.log(1 - right)
    assert result.history.edge_loss[0] == pytest.approx((merge + cut) / 2, rel=1e-6)


class Turned:
    """Flips the sign of all node features and counts the calls."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, batch: Data, generator: Generator) -> Data:
        self.calls += 1
        changed = batch.clone()
        changed.x = -batch.x
        return changed


def shuffled(batch: Data, generator: Generator) -> Data:
    """Change a batch with the random generator of the epoch."""
    changed = batch.clone()
    changed.x = batch.x + torch.randn(batch.x.shape, generator=generator)
    return changed


def test_every_batch_is_augmented_and_validation_is_not(tmp_path: Path) -> None:
    turned = Turned()
    trainer = Trainer(epochs=2, progress=False, augmentation=turned)
    result, _ = run(tmp_path / "turned", trainer)
    assert turned.calls == 2 * 3
    # Only the sign of the features differs, so a different loss shows that the model gets the flipped ones.
    plain, _ = run(tmp_path / "plain", Trainer(epochs=2, progress=False))
    assert result.history.loss[0] != plain.history.loss[0]
    resumed, _ = run(tmp_path / "turned", Trainer(epochs=2, progress=False, augmentation=Turned()))
    pd.testing.assert_frame_equal(resumed.history, result.history)


def test_a_killed_augmented_training_ends_with_the_weights_of_an_unbroken_one(tmp_path: Path) -> None:
    trainer = Trainer(epochs=2, progress=False, augmentation=shuffled, edge_loss=EdgeLoss(1.0))
    _, weights = run(tmp_path / "unbroken", trainer)
    with pytest.raises(Killed):
        run(tmp_path / "killed", trainer, sampler=KillingSampler(4))
    assert_same(run(tmp_path / "killed", trainer)[1], weights)


def test_a_seed_repeats_itself_and_another_does_not(tmp_path: Path) -> None:
    _, first = run(tmp_path / "a")
    torch.rand(7)
    _, again = run(tmp_path / "b")
    _, other = run(tmp_path / "c", Trainer(epochs=4, scheduler=SCHEDULER, progress=False, seed=1))
    assert_same(first, again)
    assert any(not torch.equal(first[key], other[key]) for key in first)


def test_reading_ahead_changes_nothing(tmp_path: Path) -> None:
    for workers in (0, 2):
        run(tmp_path / str(workers), Trainer(epochs=2, progress=False, num_workers=workers))
    assert_same(last_weights(tmp_path / "0"), last_weights(tmp_path / "2"))


@pytest.mark.parametrize("workers", [0, 2])
def test_drawing_pairs_ahead_in_a_thread_changes_nothing(
    workers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trainer = Trainer(epochs=2, batch_size=2, num_workers=workers, progress=False, augmentation=shuffled)
    results = []
    for threads in (1, 2):
        monkeypatch.setattr(one_ahead, "thread_count", functools.partial(int, threads))
        result, weights = run(tmp_path / str(threads), trainer)
        results.append((result.history.drop(columns="seconds"), weights))
    pd.testing.assert_frame_equal(results[0][0], results[1][0], check_exact=True)
    assert_same(results[0][1], results[1][1])


@pytest.mark.parametrize("step", [0, 2, 4, 10])
def test_a_killed_training_ends_with_the_weights_of_an_unbroken_one(step: int, tmp_path: Path) -> None:
    """Ten graphs give three steps per epoch: kill before any step, and in the first, second and last epoch."""
    unbroken, weights = run(tmp_path / "unbroken")
    with pytest.raises(Killed):
        run(tmp_path / "killed", sampler=KillingSampler(step))
    resumed, resumed_weights = run(tmp_path / "killed")
    assert_same(resumed_weights, weights)
    assert_same(last_weights(tmp_path / "killed"), last_weights(tmp_path / "unbroken"))
    pd.testing.assert_frame_equal(
        resumed.history.drop(columns="seconds"), unbroken.history.drop(columns="seconds"), check_exact=True
    )
    assert resumed.checkpoint.read_bytes() == unbroken.checkpoint.read_bytes()


def test_resuming_trains_the_missing_epochs_only(tmp_path: Path) -> None:
    with pytest.raises(Killed):
        run(tmp_path, sampler=KillingSampler(8))
    counting = KillingSampler(10**6)
    run(tmp_path, sampler=counting)
    assert 10**6 - counting.step == 2 * 3


def test_a_finished_training_is_not_repeated(tmp_path: Path) -> None:
    first, weights = run(tmp_path)
    again, again_weights = run(tmp_path, sampler=KillingSampler(0))
    assert_same(weights, again_weights)
    pd.testing.assert_frame_equal(again.history, first.history)
    assert (again.best_epoch, again.best_score) == (first.best_epoch, first.best_score)


def test_ctrl_c_says_how_to_go_on(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, sampler=KillingSampler(7, KeyboardInterrupt))
    assert f"2 of 4 epochs are finished and kept in {tmp_path / 'state.pt'}" in caplog.text
    result, _ = run(tmp_path)
    assert result.history.epoch.tolist() == [1, 2, 3, 4]


def test_the_state_of_another_training_is_refused(tmp_path: Path) -> None:
    run(tmp_path, Trainer(epochs=1, progress=False))
    with pytest.raises(TrainingError, match=r"another training: batch_size was 4, now 2; seed was 0, now 3\."):
        run(tmp_path, Trainer(epochs=1, progress=False, seed=3, batch_size=2))
    with pytest.raises(TrainingError, match=r"sampler was BalancedEdgeSampler\(pairs_per_graph=16"):
        run(tmp_path, Trainer(epochs=1, progress=False), sampler=BalancedEdgeSampler(8))
    with pytest.raises(TrainingError, match=r"edge_loss was EdgeLoss\(gamma=0\.0, balanced=False\), now EdgeLoss"):
        run(tmp_path, Trainer(epochs=1, progress=False, edge_loss=EdgeLoss(2.0)))
    with pytest.raises(TrainingError, match=r"augmentation was None, now GraphAugmentation\(mirror=1\.0, gain=0\.12"):
        run(tmp_path, Trainer(epochs=1, progress=False, augmentation=GraphAugmentation(mirror=1.0)))
    with pytest.raises(TrainingError, match=r"augmentation was None, now tests\.training\.test_trainer\.shuffled\."):
        run(tmp_path, Trainer(epochs=1, progress=False, augmentation=shuffled))
    with pytest.raises(TrainingError, match=r"sampler was .* now AllEdges\(border_exponent=0\.5\)"):
        run(tmp_path, Trainer(epochs=1, progress=False), sampler=AllEdges(0.5))
    with pytest.raises(TrainingError, match="features was"):
        run(tmp_path, Trainer(epochs=1, progress=False), recipe={**RECIPE, "features": {"node": None, "edge": None}})


def test_a_loss_given_as_a_partial_does_not_change_the_training_in_another_process(tmp_path: Path) -> None:
    def loss_of_a_process() -> Callable[..., torch.Tensor]:
        """Return the same function at another address, as a new process does."""

        def scaled_loss(logits: torch.Tensor, labels: torch.Tensor, weight: object = None, *, by: int) -> torch.Tensor:
            return by * EdgeLoss()(logits, labels)

        return scaled_loss

    def trainer(by: int) -> Trainer:
        loss: Any = functools.partial(loss_of_a_process(), by=by)
        return Trainer(epochs=2, progress=False, edge_loss=loss)

    first, second = trainer(by=2), trainer(by=2)
    with pytest.raises(Killed):
        run(tmp_path, first, sampler=KillingSampler(4))
    result, _ = run(tmp_path, second)
    assert result.history.epoch.tolist() == [1, 2]
    with pytest.raises(TrainingError, match=r"edge_loss was functools\.partial\(.*by=2\), now .*by=3\)"):
        run(tmp_path, trainer(by=3))


@pytest.mark.parametrize("content", [b"", b"not a state", b"PK\x03\x04 cut off"])
def test_a_damaged_state_is_named(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "state.pt").write_bytes(content)
    with pytest.raises(TrainingError, match=r"state\.pt cannot be read.*Delete it"):
        run(tmp_path)


def test_the_best_epoch_is_kept_and_of_equal_ones_the_first(tmp_path: Path) -> None:
    trainer = Trainer(epochs=5, progress=False)
    result, weights = run(tmp_path / "all", trainer, validate=scripted([math.nan, 0.2, 0.7, 0.7, 0.4]))
    assert (result.best_epoch, result.best_score) == (3, 0.7)
    _, third = run(tmp_path / "three", Trainer(epochs=3, progress=False), validate=scripted([0.0, 0.0, 0.1]))
    assert_same(weights, third)
    loaded = Checkpoint.load(result.checkpoint)
    assert loaded.recipe == {**RECIPE, "scores": {"epoch": 3, "overlap_f": 0.7}}
    assert_same(loaded.model.state_dict(), {key: weights[key] for key in loaded.model.state_dict()})


def test_patience(tmp_path: Path) -> None:
    trainer = Trainer(epochs=9, progress=False, patience=2)
    result, _ = run(tmp_path, trainer, validate=scripted([0.1, 0.5, 0.4, 0.5, 0.9]))
    assert result.history.epoch.tolist() == [1, 2, 3, 4]
    assert result.best_epoch == 2
    again, _ = run(tmp_path, trainer, validate=scripted([]))
    assert len(again.history) == 4


def test_without_validation_the_last_epoch_is_the_best(tmp_path: Path) -> None:
    result, weights = run(tmp_path, validate=None)
    assert (result.best_epoch, result.best_score) == (4, None)
    state = last_weights(tmp_path)
    assert all(torch.equal(state[f"model.{key}"], weights[key]) for key in SharedMLP(3, 2, [16, 16]).state_dict())


def test_the_schedule_is_stepped_once_an_epoch(tmp_path: Path) -> None:
    result, _ = run(tmp_path)
    assert result.history.lr.tolist() == [1e-3, 5e-4, 2.5e-4, 1.25e-4]


def test_a_scheduler_that_needs_a_score_is_refused_before_training(tmp_path: Path) -> None:
    plateau = functools.partial(torch.optim.lr_scheduler.ReduceLROnPlateau, patience=1)
    with pytest.raises(TrainingError, match=r"ReduceLROnPlateau needs a score .* trainer\.scheduler"):
        run(tmp_path, Trainer(epochs=2, scheduler=plateau, progress=False))
    assert not (tmp_path / "checkpoint.safetensors").exists()


def test_clipping_limits_the_gradient(tmp_path: Path) -> None:
    sgd = functools.partial(torch.optim.SGD, lr=1.0)
    model, _ = modules()
    before = torch.cat([value.detach().flatten().clone() for value in model.parameters()])
    trainer = Trainer(epochs=1, batch_size=10, progress=False, optimizer=sgd, gradient_clip_norm=0.01)
    recipe = {**RECIPE, "objectness": None}
    trainer.train(model, GRAPHS, sampler=BalancedEdgeSampler(16), folder=tmp_path, recipe=recipe)
    moved = torch.cat([value.detach().flatten() for value in model.parameters()]) - before
    assert float(moved.norm()) == pytest.approx(0.01, rel=1e-3)


def test_inputs_are_standardised_by_the_training_graphs(tmp_path: Path) -> None:
    _, weights = run(tmp_path, Trainer(epochs=1, progress=False))
    x = torch.cat([graph.x for graph in GRAPHS]).double()
    torch.testing.assert_close(weights["standardize_nodes.mean"].double(), x.mean(0), rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(weights["standardize_nodes.scale"].double(), x.std(0, correction=0), rtol=1e-6, atol=0)
    assert torch.equal(weights["head.standardize_nodes.mean"], weights["standardize_nodes.mean"])


def test_the_number_of_threads_is_given_back(tmp_path: Path) -> None:
    before = torch.get_num_threads()
    seen = []

    def validate(model: EdgeClassifier, objectness: ObjectnessHead | None) -> Mapping[str, float]:
        seen.append(torch.get_num_threads())
        return {"overlap_f": 0.0}

    run(tmp_path, Trainer(epochs=1, progress=False, threads=before + 1), validate=validate)
    assert seen == [before + 1]
    assert torch.get_num_threads() == before


def test_graphs_without_labelled_pairs_are_not_trained_on(tmp_path: Path) -> None:
    unknown = path_graph([-1.0, -1.0])
    trainer = Trainer(epochs=1, batch_size=1, progress=False)
    _, without = run(tmp_path / "without", trainer, graphs=[GRAPHS[0], GRAPHS[1]])
    _, left_out = run(tmp_path / "left_out", trainer, graphs=[GRAPHS[0], unknown, GRAPHS[1]])
    # The number of batches is the same; weights differ slightly because all graphs are used for standardisation.
    steps = "mlp.norms.0.module.num_batches_tracked"
    assert left_out[steps] == without[steps] == 2


def test_nothing_to_train_on(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match=r"no training graphs.*sgbd\.prepare"):
        run(tmp_path, graphs=[])


def test_a_loss_that_explodes_is_named_and_finished_epochs_stay(tmp_path: Path) -> None:
    class Exploding(EdgeClassifier):
        """Works in the first epoch only."""

        def __init__(self) -> None:
            super().__init__(3, 2)
            self.weight = torch.nn.Parameter(torch.zeros(3))
            self.calls = 0

        def score(self, source: torch.Tensor, target: torch.Tensor, edge: torch.Tensor) -> torch.Tensor:
            self.calls += 1
            return (source + target) @ self.weight * (math.inf if self.calls > 4 else 1.0)

    trainer = Trainer(epochs=3, progress=False)
    recipe = {"model": {"_target_": "tests.training.test_trainer.Exploding"}}
    with pytest.raises(TrainingError, match=r"loss became nan in epoch 2, step 1 to 3.*trainer\.optimizer\.lr"):
        trainer.train(Exploding(), GRAPHS, sampler=BalancedEdgeSampler(16), folder=tmp_path, recipe=recipe)
    assert torch.load(tmp_path / "state.pt", weights_only=True)["epoch"] == 1


def test_a_sampler_or_augmentation_without_a_result_is_told(tmp_path: Path) -> None:
    def nothing(batch: Data, generator: Generator) -> Any:
        return None

    def no_pairs(batch: Data, generator: Generator) -> Data:
        drawn = copy.copy(batch)
        drawn.edge_label, drawn.edge_label_index = batch.edge_label[:0], batch.edge_label_index[:, :0]
        return drawn

    with pytest.raises(TrainingError, match="the sampler must return the batch to train on; it returned None"):
        run(tmp_path, sampler=nothing)
    with pytest.raises(TrainingError, match="the sampler left no pair to train on"):
        run(tmp_path, sampler=no_pairs)
    with pytest.raises(TrainingError, match="the augmentation must return the batch"):
        run(tmp_path, Trainer(epochs=1, progress=False, augmentation=nothing))


def test_validation_without_the_monitored_score(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match=r"no 'boundary_f'.*one of overlap_f, other"):
        run(tmp_path, Trainer(epochs=1, progress=False, monitor="boundary_f"))


def test_a_recipe_that_cannot_be_written_fails_before_training(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="section 'model'"):
        run(tmp_path, recipe={}, sampler=KillingSampler(0))


@pytest.mark.parametrize(
    "options",
    [
        {"epochs": 0},
        {"batch_size": 2.5},
        {"seed": -1},
        {"num_workers": -1},
        {"threads": 2, "strategy": "ddp_fork"},
        {"patience": 0},
        {"gradient_clip_norm": 0.0},
        {"objectness_weight": -1.0},
        {"objectness_weight": math.nan},
    ],
)
def test_impossible_settings_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=f"trainer.{next(iter(options))} must"):
        Trainer(**options)


def test_a_strategy_that_starts_the_program_anew_is_refused() -> None:
    with pytest.raises(ValueError, match="starts the whole program anew.*ddp_spawn"):
        Trainer(devices=2, strategy="ddp")


def test_logs_and_history_files(tmp_path: Path) -> None:
    loggers = [instantiate(OmegaConf.load(CONF / "logger" / f"{name}.yaml"))[name] for name in ("csv", "tensorboard")]
    assert [make.func for make in loggers] == [CSVLogger, TensorBoardLogger]
    trainer = Trainer(epochs=2, progress=False, log_every=2)
    result, _ = run(tmp_path, trainer, loggers=loggers)
    metrics = pd.read_csv(tmp_path / "csv" / "version_0" / "metrics.csv")
    assert metrics["val/overlap_f"].dropna().tolist() == pytest.approx(result.history["val/overlap_f"].tolist())
    assert metrics.loc[metrics["step/loss"].notna(), "step"].tolist() == [2, 3, 5, 6]
    events = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    assert [event.step for event in events.Scalars("loss")] == [3, 6]
    assert [event.value for event in events.Scalars("loss")] == pytest.approx(result.history.loss.tolist())
    written = pd.read_csv(tmp_path / "history.csv")
    pd.testing.assert_frame_equal(written, result.history)


@pytest.mark.parametrize("name", ["default", "adamw_cosine"])
def test_shipped_trainers_train(name: str, tmp_path: Path) -> None:
    config = OmegaConf.create({"seed": 3, "trainer": OmegaConf.load(CONF / "trainer" / f"{name}.yaml")})
    config.trainer.epochs = 2
    config.trainer.progress = False
    trainer = instantiate(config.trainer)
    assert isinstance(trainer, Trainer)
    assert trainer.seed == 3
    assert set(config.trainer) - {"_target_"} == set(Trainer.__dataclass_fields__)
    result, _ = run(tmp_path, trainer)
    assert len(result.history) == 2


@pytest.mark.parametrize("kind", [GatedGCN, SymmetricGCN])
def test_message_passing_trains_too(kind: type[GatedGCN | SymmetricGCN], tmp_path: Path) -> None:
    torch.manual_seed(0)
    sizes = {"node_channels": 3, "edge_channels": 2, "hidden_channels": 16, "num_layers": 2}
    model = kind(**sizes)
    recipe = {"model": {"_target_": f"sgbd.models.{kind.__name__}", **sizes}}
    trainer = Trainer(epochs=8, progress=False, optimizer=functools.partial(torch.optim.AdamW, lr=1e-2))
    result = trainer.train(
        model, GRAPHS, sampler=BalancedEdgeSampler(16), folder=tmp_path, recipe=recipe, validate=accuracy
    )
    assert result.best_score is not None
    assert result.best_score > 0.9
    loaded = Checkpoint.load(result.checkpoint).model
    with torch.no_grad():
        assert torch.equal(loaded(GRAPHS[0]), model(GRAPHS[0]))


def test_a_model_of_the_users_own_is_trained_and_read_again(tmp_path: Path) -> None:
    config = {"_target_": "tests.test_checkpoint.OwnModel", "node_channels": 3, "edge_channels": 2}
    model = instantiate(config)
    trainer = Trainer(epochs=2, progress=False)
    result = trainer.train(
        model, GRAPHS, sampler=BalancedEdgeSampler(16), folder=tmp_path, recipe={"model": config}, validate=accuracy
    )
    loaded = Checkpoint.load(result.checkpoint, trust=["tests"]).model
    assert_same(loaded.state_dict(), model.state_dict())


def test_two_processes_train_one_model(tmp_path: Path) -> None:
    """Gradients are averaged over processes, and the caller's model receives the result."""
    trainer = Trainer(epochs=3, batch_size=2, devices=2, strategy="ddp_fork", progress=False)
    result, weights = run(tmp_path, trainer)
    assert result.history.epoch.tolist() == [1, 2, 3]
    assert result.history.loss.iloc[-1] < result.history.loss.iloc[0]
    loaded = Checkpoint.load(result.checkpoint).model.state_dict()
    assert_same({key: weights[key] for key in loaded}, loaded)
