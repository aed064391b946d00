"""The training loop: an edge classifier, and an objectness head beside it, on prepared graphs.

`Trainer.train` checks its input, surveys the graphs and hands the loop to Fabric, which runs `_run` in every process.
An epoch is `_train_epoch`. What follows it, in the first process only, is `_finish_epoch`: the best checkpoint, the
state to go on from, and the table of epochs.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
import logging
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import torch
from lightning_fabric import Fabric
from lightning_fabric.loggers import Logger
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits
from torch_geometric.data import Data

from sgbd.batches import EpochBatches, derived_seeds
from sgbd.checkpoint import CHECKPOINT_FILE, Checkpoint
from sgbd.losses import EdgeLoss
from sgbd.machine.atomic_file import write_whole
from sgbd.machine.one_ahead import one_ahead
from sgbd.machine.progress_bar import ProgressBar
from sgbd.machine.torch_threads import torch_threads
from sgbd.models import EdgeClassifier, ObjectnessHead, object_targets
from sgbd.sampling import EdgeSampler
from sgbd.training.error import TrainingError
from sgbd.training.state import STATE_FILE, STATE_VERSION, how_to_go_on, read_state, write_state
from sgbd.training.survey import survey_graphs

log = logging.getLogger(__name__)

HISTORY_FILE = "history.csv"

LOSSES = ("loss", "edge_loss", "objectness_loss")
"""The loss that is minimised and its two parts, as the history names them."""

IDENTIFYING_SECTIONS = ("dataset", "superpixels", "graph", "features")
"""Sections of the recipe whose change makes another training of it."""

Optimizer = Callable[[Iterable[nn.Parameter]], torch.optim.Optimizer]
Scheduler = Callable[[torch.optim.Optimizer], torch.optim.lr_scheduler.LRScheduler]
Validate = Callable[[EdgeClassifier, ObjectnessHead | None], Mapping[str, float]]
MakeLogger = Callable[..., Logger]
Augmentation = Callable[[Data, torch.Generator], Data]

PLAIN_LOSS = EdgeLoss()
DEFAULT_OPTIMIZER: Optimizer = functools.partial(torch.optim.Adam, lr=1e-3, fused=True)


@dataclass(frozen=True)
class TrainingResult:
    """What came out of a training.

    Attributes:
        history: One row an epoch: epoch, lr, loss, edge_loss, objectness_loss (means over the epoch's batches),
            seconds, and what validation measured as val/<name>.
        best_epoch: Epoch of the weights that were kept, counted from 1.
        best_score: Validation score of that epoch; None without validation.
        checkpoint: File of the kept weights and their recipe.
        state: File to go on from.
    """

    history: pd.DataFrame
    best_epoch: int
    best_score: float | None
    checkpoint: Path
    state: Path


class JointModel(nn.Module):
    """Edge classifier and objectness head as one module, so that both train in one pass on any device."""

    def __init__(self, model: EdgeClassifier, objectness: ObjectnessHead | None) -> None:
        super().__init__()
        self.model = model
        self.objectness = objectness

    def forward(self, batch: Data) -> tuple[Tensor, Tensor | None]:
        """Return merge logits of the batch's pairs and object logits of its nodes."""
        return self.model(batch), None if self.objectness is None else self.objectness(batch)


class _Learner:
    """The networks of one process and what changes them; its state is what a training goes on from.

    Attributes:
        module: The networks themselves.
        joint: The same as Fabric runs them, on the device and in step with other processes.
        optimizer: As Fabric runs it.
    """

    def __init__(self, trainer: Trainer, fabric: Fabric, checkpoint: Checkpoint, state: Mapping[str, Any]) -> None:
        self.module = JointModel(checkpoint.model, checkpoint.objectness)
        if "joint" in state:
            self.module.load_state_dict(state["joint"])
        self._optimizer = trainer.optimizer(self.module.parameters())
        self._scheduler = trainer.scheduler(self._optimizer) if trainer.scheduler else None
        self.joint, self.optimizer = fabric.setup(self.module, self._optimizer)
        if "optimizer" in state:
            self.optimizer.load_state_dict(state["optimizer"])
            if self._scheduler is not None:
                self._scheduler.load_state_dict(state["scheduler"])

    @property
    def rate(self) -> float:
        """The learning rate, of the first group of parameters."""
        return float(self._optimizer.param_groups[0]["lr"])

    def end_epoch(self) -> None:
        """Step the scheduler."""
        if self._scheduler is not None:
            self._scheduler.step()

    def state(self) -> dict[str, Any]:
        """Return what the constructor needs to go on from here, copied to the CPU."""
        return {
            "joint": _copied(self.module.state_dict()),
            "optimizer": self._optimizer.state_dict(),
            "scheduler": None if self._scheduler is None else self._scheduler.state_dict(),
        }


@dataclass(frozen=True)
class Trainer:
    """How to train: an explicit loop on Lightning Fabric, the same on a CPU, a GPU or several.

    Whatever is random in an epoch (order of the graphs, drawn pairs, dropout) comes from generators seeded by `seed`,
    the epoch and the process. So the same seed gives the same weights, however many `num_workers` read graphs, and a
    training that was killed and goes on from its last finished epoch ends with the weights of an unbroken one, to the
    last bit. (On a GPU, as far as PyTorch's operations are deterministic there.) While a step computes, a thread draws
    the next batch's pairs; it takes random numbers from the epoch's generator only, as samplers and augmentations must.

    Attributes:
        epochs: Passes over the training graphs.
        batch_size: Graphs in a batch, of each process.
        seed: Fixes all randomness of training; initial weights are the caller's.
        optimizer: Parameters to optimiser, for example `functools.partial(torch.optim.Adam, lr=1e-3)`.
        scheduler: Optimiser to schedule, stepped after each epoch; None for a constant rate.
        edge_loss: Merge logits, labels and weights of the drawn pairs to their loss.
        augmentation: Changes each batch with the epoch's generator; None for graphs as they are.
        objectness_weight: Weight of the objectness loss beside the edge loss.
        gradient_clip_norm: Largest norm of the gradient; None for no limit.
        patience: Stop after this many epochs without a better score; None for never.
        monitor: Which of the validation's numbers decides on the best epoch; larger is better.
        num_workers: Processes that read graphs ahead; 0 reads in the training process.
        threads: CPU threads of each process's tensor operations. The matrices of a batch are so small that a second
            thread gains little on an idle machine, and costs an order of magnitude on a busy one.
        accelerator: `cpu`, `gpu`, `auto` or another of Fabric's.
        devices: Number of devices, one process each.
        strategy: Fabric's name of how they work together; `auto` is `ddp_spawn` for several devices, and all that is
            given to `train` must be picklable. `ddp_fork` starts faster on CPUs. Either way only the training itself
            runs in several processes, and the caller's program in one.
        precision: Fabric's name of the precision, such as `32-true` or `bf16-mixed`.
        log_every: Steps between two entries of the loss in the logs.
        progress: Whether to show a progress bar.
    """

    epochs: int = 10
    batch_size: int = 4
    seed: int = 0
    optimizer: Optimizer = DEFAULT_OPTIMIZER
    scheduler: Scheduler | None = None
    edge_loss: EdgeLoss = PLAIN_LOSS
    augmentation: Augmentation | None = None
    objectness_weight: float = 1.0
    gradient_clip_norm: float | None = None
    patience: int | None = None
    monitor: str = "overlap_f"
    num_workers: int = 0
    threads: int = 1
    accelerator: str = "cpu"
    devices: int = 1
    strategy: str = "auto"
    precision: str = "32-true"
    log_every: int = 10
    progress: bool = True

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ValueError: If one is impossible.
        """
        bounds = {"epochs": 1, "batch_size": 1, "devices": 1, "threads": 1, "log_every": 1, "num_workers": 0, "seed": 0}
        for name, least in bounds.items():
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise ValueError(f"trainer.{name} must be an integer of at least {least}; got {value!r}")
        if self.devices > 1 and self.strategy == "ddp":
            raise ValueError(
                "trainer.strategy=ddp starts the whole program anew in every process, with its preparation and its "
                "evaluation. Use ddp_spawn (or ddp_fork on CPUs): only the training runs in several processes."
            )
        if "fork" in self.strategy and self.threads > 1:
            raise ValueError(
                f"trainer.threads must be 1 with trainer.strategy={self.strategy}; got {self.threads}. The pool of "
                "OpenMP's threads does not survive a fork, and the processes would wait for it forever."
            )
        if self.patience is not None and self.patience < 1:
            raise ValueError(f"trainer.patience must be at least 1, or null to train all epochs; got {self.patience!r}")
        if self.gradient_clip_norm is not None and not self.gradient_clip_norm > 0:
            raise ValueError(f"trainer.gradient_clip_norm must be positive or null; got {self.gradient_clip_norm!r}")
        if not 0 <= self.objectness_weight < math.inf:
            raise ValueError(f"trainer.objectness_weight must be 0 or more; got {self.objectness_weight!r}")

    def train(
        self,
        model: EdgeClassifier,
        graphs: Sequence[Data],
        *,
        sampler: EdgeSampler,
        folder: str | Path,
        recipe: Mapping[str, Any],
        objectness: ObjectnessHead | None = None,
        first_stage: Checkpoint | None = None,
        validate: Validate | None = None,
        loggers: Iterable[MakeLogger] = (),
    ) -> TrainingResult:
        """Train, or go on with a training that was interrupted.

        Files in `folder`: the best weights with their recipe (`checkpoint.safetensors`), everything needed to go on
        (`state.pt`, written after every epoch) and the table of epochs (`history.csv`). If the state of this very
        training is there, it goes on after its last finished epoch; if it was finished, nothing is trained.

        Args:
            model: Edge model with its initial weights; afterwards it holds the best ones, in evaluation mode.
            graphs: Training graphs: a `SuperpixelGraphDataset`, a list of `Data`, or the like.
            sampler: What picks the pairs to train on.
            folder: Where to write.
            recipe: What the checkpoint tells beside the weights; see `Checkpoint`. The scores of the best epoch are
                added as `scores`.
            objectness: Objectness head to train beside the model, changed like it.
            first_stage: What made the graphs' nodes, if this is a second stage; the checkpoint takes it along.
            validate: Gives the scores of model and head after each epoch; called in the first process only, with both
                in evaluation mode. Without it the last epoch is the best.
            loggers: Make loggers of Fabric's kind, called with `root_dir=folder`.

        Returns:
            History, best epoch and files.

        Raises:
            TrainingError: If there is nothing to train on, features are not finite, the loss is not finite, the
                monitored score is missing, or the state in `folder` is of another training.
            KeyboardInterrupt: On Ctrl-C; finished epochs are kept.
        """
        with torch_threads(self.threads):
            untrained = Checkpoint(model, objectness, dict(recipe), first_stage)
            return self._train(untrained, graphs, sampler, Path(folder), validate, loggers)

    def _train(
        self,
        untrained: Checkpoint,
        graphs: Sequence[Data],
        sampler: EdgeSampler,
        folder: Path,
        validate: Validate | None,
        loggers: Iterable[MakeLogger],
    ) -> TrainingResult:
        path = folder / STATE_FILE
        # Fails now, not after the first epoch, if the recipe cannot be written.
        untrained.to_bytes()
        if len(graphs) == 0:
            raise TrainingError(
                "there are no training graphs. Prepare some frames first (python -m sgbd.prepare), or look into the "
                "preparation's report if all were skipped."
            )
        identity = self._identity(untrained, graphs, sampler)
        state = read_state(path, identity)
        if state is None:
            state = self._first_state(untrained, graphs, identity)
        else:
            log.info("going on after epoch %d of %d: %s", state["epoch"], self.epochs, path)
        if not state["finished"]:
            fabric = self._fabric([make(root_dir=folder) for make in loggers])
            try:
                run: Callable[..., None] = self._run
                fabric.launch(run, untrained, graphs, sampler, folder, validate, state)
            except KeyboardInterrupt:
                log.warning("training interrupted. %s", how_to_go_on(path, self.epochs))
                raise
            # Other processes may have trained; the file is what they leave.
            state = read_state(path, identity)
            assert state is not None
        best = state["best"]
        untrained.model.load_state_dict(best["model"])
        untrained.model.eval()
        if untrained.objectness is not None:
            untrained.objectness.load_state_dict(best["objectness"])
            untrained.objectness.eval()
        return TrainingResult(
            pd.DataFrame(state["history"]), best["epoch"], best["score"], folder / CHECKPOINT_FILE, path
        )

    def _first_state(
        self, untrained: Checkpoint, graphs: Sequence[Data], identity: Mapping[str, str]
    ) -> dict[str, Any]:
        """Fit the standardisation of the features to the training graphs, and return the state before epoch 1."""
        survey = survey_graphs(graphs, self.num_workers, self.progress)
        untrained.model.standardize_nodes.fit(survey.nodes)
        untrained.model.standardize_edges.fit(survey.edges)
        if untrained.objectness is not None:
            untrained.objectness.standardize_nodes.fit(survey.nodes)
        return {
            "version": STATE_VERSION,
            "identity": identity,
            "epoch": 0,
            "usable": survey.usable,
            "history": [],
            "best": None,
            "finished": False,
        }

    def _fabric(self, loggers: list[Logger]) -> Fabric:
        """Return Fabric on the configured devices; it fails where the machine or this build of PyTorch lacks them."""
        try:
            return Fabric(
                accelerator=self.accelerator,
                devices=self.devices,
                strategy="ddp_spawn" if self.strategy == "auto" and self.devices > 1 else self.strategy,
                precision=self.precision,  # type: ignore[arg-type]
                loggers=loggers,
            )
        except (RuntimeError, ValueError) as error:
            raise TrainingError(
                f"cannot train with trainer.accelerator={self.accelerator}, trainer.devices={self.devices}, "
                f"trainer.strategy={self.strategy}, trainer.precision={self.precision}: {error} "
                "trainer.accelerator=auto takes what there is."
            ) from error

    def _run(
        self,
        fabric: Fabric,
        untrained: Checkpoint,
        graphs: Sequence[Data],
        sampler: EdgeSampler,
        folder: Path,
        validate: Validate | None,
        state: dict[str, Any],
    ) -> None:
        """Train in one process of several, or the only one; `state` is changed and written after every epoch."""
        learner = _Learner(self, fabric, untrained, state)
        batches = EpochBatches(
            graphs,
            state["usable"],
            self.batch_size,
            self.seed,
            self.num_workers,
            fabric.global_rank,
            fabric.world_size,
            pin_memory=fabric.device.type == "cuda",
        )
        bar = ProgressBar(
            total=self.epochs * len(batches),
            initial=state["epoch"] * len(batches),
            desc="training",
            unit="batch",
            disable=not (self.progress and fabric.is_global_zero),
        )
        with bar, torch_threads(self.threads):
            for epoch in range(state["epoch"] + 1, self.epochs + 1):
                start = time.perf_counter()
                row = {"epoch": epoch, "lr": learner.rate}
                row |= self._train_epoch(fabric, learner, batches, sampler, epoch, bar)
                learner.end_epoch()
                stop = False
                if fabric.is_global_zero:
                    scores = self._validate(untrained, validate)
                    row["seconds"] = time.perf_counter() - start
                    row |= {f"val/{name}": value for name, value in scores.items()}
                    _log_row(fabric, row, step=epoch * len(batches))
                    state["history"].append(row)
                    stop = self._finish_epoch(learner, untrained, scores, state, folder, bar)
                if fabric.broadcast(stop):
                    log.info("stopped after epoch %d: no better score in %d epochs", epoch, self.patience)
                    break
        for logger in fabric.loggers:
            logger.finalize("success")

    def _train_epoch(
        self,
        fabric: Fabric,
        learner: _Learner,
        batches: EpochBatches,
        sampler: EdgeSampler,
        epoch: int,
        bar: ProgressBar,
    ) -> dict[str, float]:
        """Take a step for each batch, and return the epoch's mean losses over all processes by their names."""
        seed, sampling_seed = derived_seeds(self.seed, epoch, fabric.global_rank)
        torch.manual_seed(seed)
        generator = torch.Generator().manual_seed(sampling_seed)
        learner.joint.train()
        sums = torch.zeros(len(LOSSES), dtype=torch.float64)
        # Not float64: some devices have none.
        recent = torch.zeros(len(LOSSES), device=fabric.device)
        steps = since = 0
        # Begun here and not in the thread that goes on with it: this may fork processes.
        iterator = iter(batches.epoch(epoch))

        def next_batch() -> Data | None:
            """Read a batch and draw its pairs, on the CPU: they are the same on every device."""
            batch = next(iterator, None)
            if batch is None:
                return None
            drawn = sampler(batch, generator)
            return drawn if self.augmentation is None else self.augmentation(drawn, generator)

        for drawn in one_ahead(next_batch):
            recent += self._step(fabric, learner, drawn)
            steps, since = steps + 1, since + 1
            bar.update()
            if since == self.log_every or steps == len(batches):
                # Reading a number waits for the device, so it is done now and then only.
                means = (recent / since).tolist()
                if not all(map(math.isfinite, means)):
                    raise TrainingError(
                        f"the training loss became {means[0]} in epoch {epoch}, step {steps - since + 1} to {steps}. "
                        "Lower trainer.optimizer.lr, or set trainer.gradient_clip_norm=1. "
                        "The epochs before are kept."
                    )
                step = (epoch - 1) * len(batches) + steps
                fabric.log_dict({"step/loss": means[0], "step/edge_loss": means[1]}, step=step)
                sums += recent.cpu()
                recent.zero_()
                since = 0
        means_of_epoch: Any = fabric.all_reduce((sums / steps).float().to(fabric.device), reduce_op="mean")
        return dict(zip(LOSSES, means_of_epoch.tolist(), strict=True))

    def _step(self, fabric: Fabric, learner: _Learner, drawn: Data) -> Tensor:
        """Change the weights by the gradient of one batch; returns its losses, float32, in the order of `LOSSES`."""
        edge_loss, objectness_loss = self._losses(learner.joint, fabric.to_device(drawn))
        loss = edge_loss + self.objectness_weight * objectness_loss
        learner.optimizer.zero_grad()
        fabric.backward(loss)
        if self.gradient_clip_norm is not None:
            fabric.clip_gradients(
                learner.joint, learner.optimizer, max_norm=self.gradient_clip_norm, error_if_nonfinite=False
            )
        learner.optimizer.step()
        return torch.stack([loss.detach(), edge_loss.detach(), objectness_loss.detach()])

    def _losses(self, joint: nn.Module, data: Data) -> tuple[Tensor, Tensor]:
        """Return the edge loss over drawn pairs, and the mean cross-entropy over superpixels of known instance."""
        edge_logits, node_logits = joint(data)
        if edge_logits.shape != data.edge_label.shape:
            raise TrainingError(
                f"the model must give one merge logit for each of {data.edge_label.numel()} pairs, a tensor of shape "
                f"{list(data.edge_label.shape)}; got {list(edge_logits.shape)}"
            )
        edge_loss = self.edge_loss(edge_logits, data.edge_label, getattr(data, "edge_label_weight", None))
        if node_logits is None:
            return edge_loss, edge_loss.new_zeros(())
        target = object_targets(data.node_instance)
        known = (target >= 0).float()
        total = binary_cross_entropy_with_logits(node_logits, target.clamp(min=0), weight=known, reduction="sum")
        return edge_loss, total / known.sum().clamp(min=1)

    def _validate(self, networks: Checkpoint, validate: Validate | None) -> dict[str, float]:
        """Put the networks in evaluation mode, and return their scores by name: none without validation."""
        networks.model.eval()
        if networks.objectness is not None:
            networks.objectness.eval()
        if validate is None:
            return {}
        with torch.no_grad():
            scores = {name: float(value) for name, value in validate(networks.model, networks.objectness).items()}
        if self.monitor not in scores:
            raise TrainingError(
                f"validation gives no {self.monitor!r}, by which the best epoch is chosen; "
                f"set trainer.monitor to one of {', '.join(scores) or '(it gives nothing)'}"
            )
        return scores

    def _finish_epoch(
        self,
        learner: _Learner,
        checkpoint: Checkpoint,
        scores: dict[str, float],
        state: dict[str, Any],
        folder: Path,
        bar: ProgressBar,
    ) -> bool:
        """Write the checkpoint if it is the best so far, the state and the history; says whether to stop early.

        Args:
            learner: The networks after the epoch.
            checkpoint: The same networks with their recipe.
            scores: What validation gave.
            state: The last epoch's state, with the history up to this epoch; brought up to date.
            folder: Where to write.
            bar: Shows a summary.
        """
        row = state["history"][-1]
        epoch = row["epoch"]
        self._keep_best(checkpoint, scores, epoch, state, folder)
        stop = self.patience is not None and epoch - state["best"]["epoch"] >= self.patience
        summary = _summary(row["loss"], scores.get(self.monitor), state["best"])
        bar.set_postfix_str(summary)
        log.info("epoch %d of %d: %s", epoch, self.epochs, summary)
        state |= {"epoch": epoch, **learner.state(), "finished": stop or epoch == self.epochs}
        write_state(folder / STATE_FILE, state)
        write_whole(folder / HISTORY_FILE, pd.DataFrame(state["history"]).to_csv(index=False).encode())
        return stop

    def _keep_best(
        self,
        checkpoint: Checkpoint,
        scores: dict[str, float],
        epoch: int,
        state: dict[str, Any],
        folder: Path,
    ) -> None:
        """Write the checkpoint if this epoch is better than all before; of equal ones the first stays."""
        score, best = scores.get(self.monitor), state["best"]
        # Not a number, where validation has nothing to count, is worse than any number.
        if best is not None and score is not None and not _rank(score) > _rank(best["score"]):
            return
        state["best"] = {
            "epoch": epoch,
            "score": score,
            "model": _copied(checkpoint.model.state_dict()),
            "objectness": None if checkpoint.objectness is None else _copied(checkpoint.objectness.state_dict()),
        }
        finite = {name: value for name, value in scores.items() if math.isfinite(value)}
        recipe = {**checkpoint.recipe, "scores": {"epoch": epoch, **finite}}
        dataclasses.replace(checkpoint, recipe=recipe).save(folder / CHECKPOINT_FILE)

    def _identity(self, untrained: Checkpoint, graphs: Sequence[Data], sampler: EdgeSampler) -> dict[str, str]:
        """Describe all that decides on a training's result, by name: only one that agrees in it may be gone on with."""
        model, objectness, recipe = untrained.model, untrained.objectness, untrained.recipe
        optimizer = self.optimizer(JointModel(model, objectness).parameters())
        options = {key: value for key, value in optimizer.param_groups[0].items() if key != "params"}
        identity = {
            "model": repr(model),
            "objectness": repr(objectness),
            "sampler": _described(sampler),
            "edge_loss": _described(self.edge_loss),
            "augmentation": _described(self.augmentation),
            "optimizer": f"{type(optimizer).__name__} {options}",
            "number of training graphs": str(len(graphs)),
        }
        if self.scheduler is not None:
            scheduler = self.scheduler(optimizer)
            settings = {
                key: value
                for key, value in scheduler.state_dict().items()
                if not key.startswith("_") and isinstance(value, int | float | str | list)
            }
            identity["scheduler"] = f"{type(scheduler).__name__} {settings}"
        fixed = ["epochs", "batch_size", "seed", "objectness_weight", "gradient_clip_norm", "patience", "monitor"]
        fixed += ["devices", "precision"]
        identity |= {name: str(getattr(self, name)) for name in fixed}
        return identity | {
            section: json.dumps(recipe[section], sort_keys=True)
            for section in IDENTIFYING_SECTIONS
            if section in recipe
        }


def _described(part: object) -> str:
    """Return what tells a part from others in another process too: without the address that Python shows."""
    if inspect.isroutine(part):
        return f"{part.__module__}.{part.__qualname__}"
    return type(part).__qualname__ if type(part).__repr__ is object.__repr__ else repr(part)


def _rank(score: float | None) -> float:
    return -math.inf if score is None or math.isnan(score) else score


def _copied(state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {key: value.detach().cpu().clone() for key, value in state.items()}


def _log_row(fabric: Fabric, row: Mapping[str, float], step: int) -> None:
    """Give an epoch's numbers to all loggers, and have them written at once."""
    fabric.log_dict(row, step=step)
    for logger in fabric.loggers:
        if hasattr(logger, "save"):
            logger.save()


def _summary(loss: float, score: float | None, best: Mapping[str, Any]) -> str:
    text = f"loss {loss:.3f}"
    return (
        text if score is None else f"{text}, validation {score:.4f}, best {best['score']:.4f} (epoch {best['epoch']})"
    )
