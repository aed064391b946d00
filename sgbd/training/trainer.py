"""The training loop for an edge classifier and an optional objectness head on prepared graphs.

`Trainer.train` checks its input, surveys the graphs and starts Fabric, which runs `_run` in every process.
`_train_epoch` trains one epoch. `_finish_epoch` follows in the first process only: it writes the best checkpoint, the
table of epochs, and the state from which training resumes.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
import logging
import math
import re
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
from sgbd.training.matmul_precision import PRECISIONS, matmul_precision
from sgbd.training.state import STATE_FILE, STATE_VERSION, how_to_go_on, read_state, write_state
from sgbd.training.survey import survey_graphs

log = logging.getLogger(__name__)

HISTORY_FILE = "history.csv"

LOSSES = ("loss", "edge_loss", "objectness_loss")
"""The minimised loss and its two parts, as named in the history."""

IDENTIFYING_SECTIONS = ("dataset", "superpixels", "graph", "features")
"""Recipe sections that identify a training: a state with other values cannot be resumed."""

Optimizer = Callable[[Iterable[nn.Parameter]], torch.optim.Optimizer]
Scheduler = Callable[[torch.optim.Optimizer], torch.optim.lr_scheduler.LRScheduler]
Validate = Callable[[EdgeClassifier, ObjectnessHead | None], Mapping[str, float]]
MakeLogger = Callable[..., Logger]
Augmentation = Callable[[Data, torch.Generator], Data]

PLAIN_LOSS = EdgeLoss()
DEFAULT_OPTIMIZER: Optimizer = functools.partial(torch.optim.Adam, lr=1e-3, fused=True)


@dataclass(frozen=True)
class TrainingResult:
    """The result of a training.

    Attributes:
        history: One row per epoch: epoch, lr, loss, edge_loss, objectness_loss (means over the epoch's batches),
            seconds, and the validation scores as val/<name>.
        best_epoch: Epoch of the best weights, counted from 1.
        best_score: Validation score of that epoch; None without validation.
        checkpoint: File of the best weights and their recipe.
        state: File from which training resumes.
    """

    history: pd.DataFrame
    best_epoch: int
    best_score: float | None
    checkpoint: Path
    state: Path


class JointModel(nn.Module):
    """Edge classifier and objectness head as one module, so that both are trained in one forward pass."""

    def __init__(self, model: EdgeClassifier, objectness: ObjectnessHead | None) -> None:
        super().__init__()
        self.model = model
        self.objectness = objectness

    def forward(self, batch: Data) -> tuple[Tensor, Tensor | None]:
        """Return merge logits of the batch's pairs and object logits of its nodes."""
        return self.model(batch), None if self.objectness is None else self.objectness(batch)


class _Learner:
    """The networks, optimiser and scheduler of one process; a training resumes from their state.

    Attributes:
        module: The networks.
        joint: The networks wrapped by Fabric, on the device and synchronised with other processes.
        optimizer: The optimiser wrapped by Fabric.
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
        """The learning rate of the first parameter group."""
        return float(self._optimizer.param_groups[0]["lr"])

    def end_epoch(self) -> None:
        """Step the scheduler."""
        if self._scheduler is not None:
            self._scheduler.step()

    def state(self) -> dict[str, Any]:
        """Return the state from which the constructor resumes; the weights are copied to the CPU."""
        return {
            "joint": _copied(self.module.state_dict()),
            "optimizer": self._optimizer.state_dict(),
            "scheduler": None if self._scheduler is None else self._scheduler.state_dict(),
        }


@dataclass(frozen=True)
class Trainer:
    """The settings of a training, and an explicit training loop on Lightning Fabric for CPUs and GPUs.

    All random numbers of an epoch (order of graphs, drawn pairs, dropout) come from generators seeded by `seed`, the
    epoch and the process. Thus a seed determines the weights, whatever `num_workers` is, and a training that is killed
    and resumed after its last finished epoch ends with bit-identical weights (on a GPU, as far as PyTorch's operations
    are deterministic there). While a step is computed, a thread draws the pairs of the next batch. Samplers and
    augmentations must therefore draw random numbers only from the epoch's generator.

    Attributes:
        epochs: Number of passes over the training graphs.
        batch_size: Graphs per batch of each process.
        seed: Seed of all randomness in training; the caller initialises the weights.
        optimizer: Maps parameters to an optimiser, for example `functools.partial(torch.optim.Adam, lr=1e-3)`.
        scheduler: Maps the optimiser to a scheduler, stepped after each epoch (without a score); None for a constant
            learning rate.
        edge_loss: Maps merge logits, labels and weights of the drawn pairs to their loss.
        augmentation: Augments each batch with the epoch's generator; None for no augmentation.
        objectness_weight: Weight of the objectness loss relative to the edge loss.
        gradient_clip_norm: Maximum norm of the gradient; None for no clipping.
        patience: Stop after this many epochs without a better score; None to train all epochs.
        monitor: Name of the validation score that determines the best epoch; larger is better.
        num_workers: Number of processes that read graphs ahead; 0 reads in the training process.
        threads: CPU threads for each tensor operation in each process. The matrices of a batch are so small that a
            second thread gains little on an idle machine, and costs an order of magnitude on a busy one.
        accelerator: `cpu`, `gpu`, `auto` or another accelerator of Fabric.
        devices: Number of devices, with one process each.
        strategy: Fabric's name of the distribution strategy. `auto` is `ddp_spawn` for several devices, which requires
            that all arguments of `train` can be pickled. `ddp_fork` starts faster on CPUs. With either, only the
            training runs in several processes, not the calling program.
        precision: Fabric's name of the precision, such as `32-true` or `bf16-mixed`.
        matmul_precision: PyTorch's name of the precision of float32 matrix products in training steps: `highest`,
            `high` or `medium`. Processors with matrix units (tensor cores, AMX) round the factors at lower precisions.
            Others compute as precisely at `medium`, but by another library (oneDNN), which takes half as long on AMD's
            processors with AVX-512. It keeps compiled loops for a thousand sizes of matrices: up to some 500 MiB if
            the products have as many rows as a batch has nodes or edges, as in message passing.
        log_every: Number of steps between two log entries of the loss.
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
    matmul_precision: str = "medium"
    log_every: int = 10
    progress: bool = True

    def __post_init__(self) -> None:
        """Validate the settings.

        Raises:
            ValueError: If one is invalid.
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
        if self.matmul_precision not in PRECISIONS:
            raise ValueError(
                f"trainer.matmul_precision must be one of {', '.join(PRECISIONS)}; got {self.matmul_precision!r}"
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
        """Train, or resume an interrupted training.

        Writes to `folder` the best weights with their recipe (`checkpoint.safetensors`), the state from which training
        resumes (`state.pt`, after every epoch) and the table of epochs (`history.csv`). If `folder` contains the state
        of this training, it resumes after the last finished epoch; a finished training is not repeated.

        Args:
            model: Edge model with its initial weights. On return, it has the best weights and is in evaluation mode.
            graphs: Training graphs: a `SuperpixelGraphDataset`, a list of `Data`, or another sequence.
            sampler: Selects the pairs to train on.
            folder: Output folder.
            recipe: Recipe for the checkpoint; see `Checkpoint`. The scores of the best epoch are added as `scores`.
            objectness: Objectness head to train together with the model; modified like the model.
            first_stage: For a second stage, the checkpoint that made the nodes of the graphs; stored in the checkpoint.
            validate: Returns the scores of model and head after each epoch. Called in the first process only, with both
                in evaluation mode. Without it, the last epoch counts as the best.
            loggers: Functions that make Fabric loggers, called with `root_dir=folder`.

        Returns:
            History, best epoch and files.

        Raises:
            TrainingError: If there is nothing to train on, features or loss are not finite, the monitored score is
                missing, or the state in `folder` belongs to another training.
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
        # If the recipe cannot be written, fail now and not after the first epoch.
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
            # If other processes trained, they leave only the file.
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
        """Fit the feature standardisation to the training graphs, and return the state before epoch 1."""
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
        """Return Fabric with the configured devices; raise if the machine or this build of PyTorch lacks them."""
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
        """Train in one of the processes; the first one updates and writes `state` after every epoch."""
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
                with matmul_precision(self.matmul_precision):
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
        """Train on every batch once, and return the epoch's mean losses over all processes, by name."""
        seed, sampling_seed = derived_seeds(self.seed, epoch, fabric.global_rank)
        torch.manual_seed(seed)
        generator = torch.Generator().manual_seed(sampling_seed)
        learner.joint.train()
        sums = torch.zeros(len(LOSSES), dtype=torch.float64)
        # Not float64, which some devices lack.
        recent = torch.zeros(len(LOSSES), device=fabric.device)
        steps = since = 0
        # Created here, not in the thread that consumes it, because this may fork processes.
        iterator = iter(batches.epoch(epoch))

        def next_batch() -> Data | None:
            """Read a batch and draw its pairs, on the CPU, so that they are the same for every device."""
            batch = next(iterator, None)
            if batch is None:
                return None
            drawn = _checked(sampler(batch, generator), "sampler")
            return drawn if self.augmentation is None else _checked(self.augmentation(drawn, generator), "augmentation")

        for drawn in one_ahead(next_batch):
            recent += self._step(fabric, learner, drawn)
            steps, since = steps + 1, since + 1
            bar.update()
            if since == self.log_every or steps == len(batches):
                # Reading a number waits for the device, so this is done only every `log_every` steps.
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
        """Take one optimiser step on a batch, and return its losses, float32 [3], in the order of `LOSSES`."""
        # The batch is on the CPU already; moving it there would look at every tensor for a twentieth of the step.
        batch = drawn if fabric.device.type == "cpu" else fabric.to_device(drawn)
        edge_loss, objectness_loss = self._losses(learner.joint, batch)
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
        """Return the edge loss of the drawn pairs, and the mean cross-entropy over superpixels of known instance."""
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
        """Put the networks in evaluation mode, and return their scores by name; none without validation."""
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
        """Write the state, the history and, if it is the best so far, the checkpoint; return whether to stop early.

        Args:
            learner: The networks after the epoch.
            checkpoint: The same networks with their recipe.
            scores: The validation scores.
            state: The state of the previous epoch, but with the history up to this epoch; it is updated.
            folder: Output folder.
            bar: The progress bar, which shows a summary.
        """
        row = state["history"][-1]
        epoch = row["epoch"]
        self._keep_best(checkpoint, scores, epoch, state, folder)
        stop = self.patience is not None and epoch - state["best"]["epoch"] >= self.patience
        summary = _summary(row["loss"], scores.get(self.monitor), state["best"])
        bar.set_postfix_str(summary)
        log.info("epoch %d of %d: %s", epoch, self.epochs, summary)
        state |= {"epoch": epoch, **learner.state(), "finished": stop or epoch == self.epochs}
        # The state comes last: an epoch that it counts is not repeated, so nothing written after it would be either.
        write_whole(folder / HISTORY_FILE, pd.DataFrame(state["history"]).to_csv(index=False).encode())
        write_state(folder / STATE_FILE, state)
        return stop

    def _keep_best(
        self,
        checkpoint: Checkpoint,
        scores: dict[str, float],
        epoch: int,
        state: dict[str, Any],
        folder: Path,
    ) -> None:
        """Write the checkpoint if this epoch is better than all earlier ones; ties keep the earlier epoch."""
        score, best = scores.get(self.monitor), state["best"]
        # NaN, which validation gives if there is nothing to score, is worse than any number.
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
        """Return everything that determines a training's result, by name: only if all of it agrees may it resume."""
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
            if isinstance(scheduler, torch.optim.lr_scheduler.ReduceLROnPlateau):
                raise TrainingError(
                    "ReduceLROnPlateau needs a score at every step, but schedulers are stepped without one: choose "
                    "another trainer.scheduler. trainer.patience stops a training that no longer improves."
                )
            settings = {
                key: value
                for key, value in scheduler.state_dict().items()
                if not key.startswith("_") and isinstance(value, int | float | str | list)
            }
            identity["scheduler"] = f"{type(scheduler).__name__} {settings}"
        fixed = ["epochs", "batch_size", "seed", "objectness_weight", "gradient_clip_norm", "patience", "monitor"]
        fixed += ["devices", "precision", "matmul_precision"]
        identity |= {name: str(getattr(self, name)) for name in fixed}
        return identity | {
            section: json.dumps(recipe[section], sort_keys=True)
            for section in IDENTIFYING_SECTIONS
            if section in recipe
        }


def _checked(drawn: Data | None, part: str) -> Data:
    """Return what a sampler or an augmentation made of a batch; raise if there is nothing to train on in it."""
    if drawn is None:  # would end the epoch
        raise TrainingError(f"the {part} must return the batch to train on; it returned None")
    if drawn.edge_label.numel() == 0:  # would make the loss NaN
        raise TrainingError(f"the {part} left no pair to train on in a batch that has labelled pairs")
    return drawn


def _described(part: object) -> str:
    """Describe a component in the same way in every process, that is, without Python's memory address."""
    if inspect.isroutine(part):
        return f"{part.__module__}.{part.__qualname__}"
    if type(part).__repr__ is object.__repr__:
        return type(part).__qualname__
    # A function in a partial, which is how a configuration gives a loss of one's own, shows its address.
    return re.sub(" at 0x[0-9A-Fa-f]+", "", repr(part))


def _rank(score: float | None) -> float:
    return -math.inf if score is None or math.isnan(score) else score


def _copied(state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {key: value.detach().cpu().clone() for key, value in state.items()}


def _log_row(fabric: Fabric, row: Mapping[str, float], step: int) -> None:
    """Send an epoch's numbers to all loggers, and make them write at once."""
    fabric.log_dict(row, step=step)
    for logger in fabric.loggers:
        logger.save()


def _summary(loss: float, score: float | None, best: Mapping[str, Any]) -> str:
    text = f"loss {loss:.3f}"
    return (
        text if score is None else f"{text}, validation {score:.4f}, best {best['score']:.4f} (epoch {best['epoch']})"
    )
