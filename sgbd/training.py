"""Training an edge classifier, and an objectness head beside it, on prepared graphs."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import io
import json
import logging
import math
import pickle
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

from sgbd.batches import EpochBatches, batches_in_order, derived_seeds
from sgbd.checkpoint import CHECKPOINT_FILE, Checkpoint
from sgbd.graph_arrays import CUT, MERGE
from sgbd.losses import EdgeLoss
from sgbd.machine.atomic_file import write_whole
from sgbd.machine.one_ahead import one_ahead
from sgbd.machine.progress_bar import ProgressBar
from sgbd.machine.torch_threads import torch_threads
from sgbd.models import EdgeClassifier, ObjectnessHead, object_targets
from sgbd.models.standardize import ColumnMoments
from sgbd.sampling import EdgeSampler, edge_labels, graphs_of_pairs

log = logging.getLogger(__name__)

STATE_FILE = "state.pt"
HISTORY_FILE = "history.csv"

STATE_VERSION = 1
SURVEY_BATCH = 32
IDENTIFYING_SECTIONS = ("dataset", "superpixels", "graph", "features")
"""Sections of the recipe whose change makes another training of it."""

Optimizer = Callable[[Iterable[nn.Parameter]], torch.optim.Optimizer]
Scheduler = Callable[[torch.optim.Optimizer], torch.optim.lr_scheduler.LRScheduler]
Validate = Callable[[EdgeClassifier, ObjectnessHead | None], Mapping[str, float]]
MakeLogger = Callable[..., Logger]
Augmentation = Callable[[Data, torch.Generator], Data]


PLAIN_LOSS = EdgeLoss()
DEFAULT_OPTIMIZER: Optimizer = functools.partial(torch.optim.Adam, lr=1e-3, fused=True)


class TrainingError(RuntimeError):
    """A training that cannot start or go on; the message says why and what to do."""


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


class JointModel(nn.Module):
    """Edge classifier and objectness head as one module, so that both train in one pass on any device."""

    def __init__(self, model: EdgeClassifier, objectness: ObjectnessHead | None) -> None:
        super().__init__()
        self.model = model
        self.objectness = objectness

    def forward(self, batch: Data) -> tuple[Tensor, Tensor | None]:
        """Return merge logits of the batch's pairs and object logits of its nodes."""
        return self.model(batch), None if self.objectness is None else self.objectness(batch)


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
        model, objectness, recipe = untrained.model, untrained.objectness, untrained.recipe
        # Fails now, not after the first epoch, if the recipe cannot be written.
        untrained.to_bytes()
        if len(graphs) == 0:
            raise TrainingError(
                "there are no training graphs. Prepare some frames first (python -m sgbd.prepare), or look into the "
                "preparation's report if all were skipped."
            )
        identity = self._identity(model, objectness, graphs, sampler, recipe)
        state = _read_state(path, identity)
        if state is None:
            survey = survey_graphs(graphs, self.num_workers, self.progress)
            model.standardize_nodes.fit(survey.nodes)
            model.standardize_edges.fit(survey.edges)
            if objectness is not None:
                objectness.standardize_nodes.fit(survey.nodes)
            state = {
                "version": STATE_VERSION,
                "identity": identity,
                "epoch": 0,
                "usable": survey.usable,
                "history": [],
                "best": None,
                "finished": False,
            }
        else:
            log.info("going on after epoch %d of %d: %s", state["epoch"], self.epochs, path)
        if not state["finished"]:
            fabric = self._fabric([make(root_dir=folder) for make in loggers])
            try:
                run: Callable[..., None] = self._run
                fabric.launch(run, untrained, graphs, sampler, folder, validate, state)
            except KeyboardInterrupt:
                log.warning("training interrupted. %s", _how_to_go_on(path, self.epochs))
                raise
            state = _read_state(path, identity)
            assert state is not None
        model.load_state_dict(state["best"]["model"])
        model.eval()
        if objectness is not None:
            objectness.load_state_dict(state["best"]["objectness"])
            objectness.eval()
        return TrainingResult(
            pd.DataFrame(state["history"]),
            state["best"]["epoch"],
            state["best"]["score"],
            folder / CHECKPOINT_FILE,
            path,
        )

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
        """Train in one process of several, or the only one."""
        model, objectness = untrained.model, untrained.objectness
        if "joint" in state:
            JointModel(model, objectness).load_state_dict(state["joint"])
        module = JointModel(model, objectness)
        bare_optimizer = self.optimizer(module.parameters())
        scheduler = self.scheduler(bare_optimizer) if self.scheduler else None
        joint, optimizer = fabric.setup(module, bare_optimizer)
        if "optimizer" in state:
            optimizer.load_state_dict(state["optimizer"])
            if scheduler is not None:
                scheduler.load_state_dict(state["scheduler"])
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
                rate = float(bare_optimizer.param_groups[0]["lr"])
                losses = self._train_epoch(fabric, joint, optimizer, batches, sampler, epoch, bar)
                if scheduler is not None:
                    scheduler.step()
                stop = False
                if fabric.is_global_zero:
                    row = {"epoch": epoch, "lr": rate, **losses}
                    scores = self._validate(model, objectness, validate)
                    row["seconds"] = time.perf_counter() - start
                    row |= {f"val/{name}": value for name, value in scores.items()}
                    state["history"].append(row)
                    fabric.log_dict(row, step=epoch * len(batches))
                    for logger in fabric.loggers:
                        if hasattr(logger, "save"):
                            logger.save()
                    self._keep_best(untrained, scores, epoch, state, folder)
                    best = state["best"]
                    waited = epoch - best["epoch"]
                    stop = self.patience is not None and waited >= self.patience
                    summary = _summary(losses, scores.get(self.monitor), best)
                    bar.set_postfix_str(summary)
                    log.info("epoch %d of %d: %s", epoch, self.epochs, summary)
                    state |= {
                        "epoch": epoch,
                        "joint": _copied(module.state_dict()),
                        "optimizer": bare_optimizer.state_dict(),
                        "scheduler": None if scheduler is None else scheduler.state_dict(),
                        "finished": stop or epoch == self.epochs,
                    }
                    _write_state(folder / STATE_FILE, state)
                    table = pd.DataFrame(state["history"]).to_csv(index=False)
                    write_whole(folder / HISTORY_FILE, table.encode())
                if fabric.broadcast(stop):
                    log.info("stopped after epoch %d: no better score in %d epochs", epoch, self.patience)
                    break
        for logger in fabric.loggers:
            logger.finalize("success")

    def _train_epoch(
        self,
        fabric: Fabric,
        joint: nn.Module,
        optimizer: Any,
        batches: EpochBatches,
        sampler: EdgeSampler,
        epoch: int,
        bar: ProgressBar,
    ) -> dict[str, float]:
        seed, sampling_seed = derived_seeds(self.seed, epoch, fabric.global_rank)
        torch.manual_seed(seed)
        generator = torch.Generator().manual_seed(sampling_seed)
        joint.train()
        sums = torch.zeros(3, dtype=torch.float64)
        # Not float64: some devices have none.
        recent = torch.zeros(3, device=fabric.device)
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
            edge_loss, objectness_loss = self._losses(joint, fabric.to_device(drawn))
            loss = edge_loss + self.objectness_weight * objectness_loss
            optimizer.zero_grad()
            fabric.backward(loss)
            if self.gradient_clip_norm is not None:
                fabric.clip_gradients(joint, optimizer, max_norm=self.gradient_clip_norm, error_if_nonfinite=False)
            optimizer.step()
            recent += torch.stack([loss.detach(), edge_loss.detach(), objectness_loss.detach()])
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
        return dict(zip(("loss", "edge_loss", "objectness_loss"), means_of_epoch.tolist(), strict=True))

    def _losses(self, joint: nn.Module, data: Data) -> tuple[Tensor, Tensor]:
        """Return the edge loss over drawn pairs, and the mean cross-entropy over superpixels of known instance."""
        edge_logits, node_logits = joint(data)
        edge_loss = self.edge_loss(edge_logits, data.edge_label, getattr(data, "edge_label_weight", None))
        if node_logits is None:
            return edge_loss, edge_loss.new_zeros(())
        target = object_targets(data.node_instance)
        known = (target >= 0).float()
        total = binary_cross_entropy_with_logits(node_logits, target.clamp(min=0), weight=known, reduction="sum")
        return edge_loss, total / known.sum().clamp(min=1)

    def _validate(
        self, model: EdgeClassifier, objectness: ObjectnessHead | None, validate: Validate | None
    ) -> dict[str, float]:
        model.eval()
        if objectness is not None:
            objectness.eval()
        if validate is None:
            return {}
        with torch.no_grad():
            scores = {name: float(value) for name, value in validate(model, objectness).items()}
        if self.monitor not in scores:
            raise TrainingError(
                f"validation gives no {self.monitor!r}, by which the best epoch is chosen; "
                f"set trainer.monitor to one of {', '.join(scores) or '(it gives nothing)'}"
            )
        return scores

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

    def _identity(
        self,
        model: EdgeClassifier,
        objectness: ObjectnessHead | None,
        graphs: Sequence[Data],
        sampler: EdgeSampler,
        recipe: Mapping[str, Any],
    ) -> dict[str, str]:
        """Say what makes this training another one than the next, by name."""
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
    if survey.usable.numel() == 0:
        raise TrainingError(
            f"none of the {start} training graphs has a labelled pair of superpixels: every frame is one superpixel or "
            "lies wholly in ignored pixels. Look at the labels and at superpixels.*."
        )
    if survey.usable.numel() < start:
        log.warning(
            "%d of %d training graphs have no labelled pair and are left out", start - len(survey.usable), start
        )
    if merges == 0 or cuts == 0:
        log.warning(
            "all labelled pairs are of one class (%d merge, %d cut): there is nothing to tell apart", merges, cuts
        )
    return survey


def _not_finite(graphs: Sequence[Data], field: str, start: int) -> str:
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


def _described(part: object) -> str:
    """Return what tells a part from others in another process too: without the address that Python shows."""
    if inspect.isroutine(part):
        return f"{part.__module__}.{part.__qualname__}"
    return type(part).__qualname__ if type(part).__repr__ is object.__repr__ else repr(part)


def _rank(score: float | None) -> float:
    return -math.inf if score is None or math.isnan(score) else score


def _copied(state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {key: value.detach().cpu().clone() for key, value in state.items()}


def _summary(losses: Mapping[str, float], score: float | None, best: Mapping[str, Any]) -> str:
    text = f"loss {losses['loss']:.3f}"
    return (
        text if score is None else f"{text}, validation {score:.4f}, best {best['score']:.4f} (epoch {best['epoch']})"
    )


def _write_state(path: Path, state: dict[str, Any]) -> None:
    content = io.BytesIO()
    torch.save(state, content)
    write_whole(path, content.getvalue())


def _read_state(path: Path, identity: Mapping[str, str]) -> dict[str, Any] | None:
    if not path.exists():
        return None
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        version, theirs = state["version"], state["identity"]
    except (RuntimeError, EOFError, pickle.UnpicklingError, LookupError, TypeError) as error:
        raise TrainingError(
            f"{path} cannot be read: it is damaged, or not the state of a training. Delete it to train from the start."
        ) from error
    if version != STATE_VERSION:
        raise TrainingError(
            f"{path} is of format version {version}, this version of sgbd goes on from version {STATE_VERSION}. Delete "
            "it to train from the start."
        )
    different = sorted(key for key in {*theirs, *identity} if theirs.get(key) != identity.get(key))
    if different:
        changes = "; ".join(f"{key} was {theirs.get(key)}, now {identity.get(key)}" for key in different)
        raise TrainingError(
            f"{path} is of another training: {changes}. Go on with the old settings, choose another folder, or delete "
            "the file to train from the start."
        )
    return state


def _how_to_go_on(path: Path, epochs: int) -> str:
    if not path.exists():
        return "No epoch was finished, so it will begin anew."
    done = torch.load(path, map_location="cpu", weights_only=True)["epoch"]
    return f"{done} of {epochs} epochs are finished and kept in {path}; train into this folder again to go on."
