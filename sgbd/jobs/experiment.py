"""One configured experiment: prepare, train, evaluate, draw."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from lightning_fabric import seed_everything
from omegaconf import DictConfig

from sgbd import __version__
from sgbd.batches import FIELDS
from sgbd.checkpoint import Checkpoint
from sgbd.data import SuperpixelGraphDataset
from sgbd.evaluation import Evaluation, Evaluator, with_truth
from sgbd.features import edge_columns, node_columns
from sgbd.jobs.configuration import ConfigurationError, count_workers
from sgbd.jobs.own_classes import require_call, require_kind
from sgbd.jobs.pipeline import frame_source, open_graphs, prepare_splits, splits_of
from sgbd.jobs.untrained import configured_block, configured_graph, trusted_packages, untrained_checkpoint
from sgbd.machine.atomic_file import write_whole
from sgbd.models import EdgeClassifier, ObjectnessHead
from sgbd.node_block import split_groups
from sgbd.partition import Partitioner
from sgbd.reporting.plot import history_figure
from sgbd.reporting.results import draw_examples, example_frames, write_evaluation, write_figure
from sgbd.sampling import EdgeSampler
from sgbd.segmentation import ObjectRule
from sgbd.segmenter import Segmenter
from sgbd.training import Trainer, TrainingResult
from sgbd.tuning import TUNING_FILE

log = logging.getLogger(__name__)


class Validation:
    """Scores the validation graphs after an epoch. A class instead of a closure, so it can be pickled.

    Args:
        graphs: The validation graphs.
        evaluate: The evaluator.
    """

    def __init__(self, graphs: SuperpixelGraphDataset, evaluate: Evaluator) -> None:
        self.graphs = graphs
        self.evaluate = evaluate

    def __call__(self, model: EdgeClassifier, objectness: ObjectnessHead | None) -> Mapping[str, float]:
        """Return the scores; those of the protocol `all` have no prefix."""
        scores = self.evaluate(self.graphs, model, objectness).scores
        return {name.removeprefix("all/"): value for name, value in scores.items()}


def run_experiment(config: DictConfig, folder: Path) -> dict[str, Any]:
    """Prepare, train and evaluate as configured.

    Args:
        config: A configuration with the keys of conf/train.yaml.
        folder: Output folder for checkpoint, curves, scores and pictures.

    Returns:
        The content of `result.json`: scores, number of parameters, best epoch and its validation score, and the file
        name of the checkpoint.

    Raises:
        ConfigurationError: If the dataset has no training split, or no validation split for tuning.
    """
    workers = count_workers(config.workers)
    _check(config)
    splits = _usable_splits(config, workers)
    # Made before the frames are prepared, so that an invalid model is reported at once.
    seed_everything(config.seed, verbose=False)
    initial = untrained_checkpoint(config)
    # All splits are prepared before training, so that a dataset that cannot be scored is reported now.
    graphs = _graphs_by_split(config, splits, initial.recipe["features"])
    trained = _train(config, initial, graphs, folder)
    write_figure(history_figure(trained.history, f"best epoch {trained.best_epoch}"), folder / "curves.png")
    if config.tuning is not None:
        _tune(config, graphs["val"], trained.checkpoint, folder)
    scores = _test(config, graphs["test"], trained, folder, workers).scores if "test" in graphs else {}
    return {
        "checkpoint": trained.checkpoint.name,
        "parameters": sum(parameter.numel() for parameter in initial.model.parameters()),
        "best_epoch": trained.best_epoch,
        "validation_score": trained.best_score,
        "scores": scores,
    }


def _check(config: DictConfig) -> None:
    """Reject an invalid configuration now, before hours are spent on frames and graphs."""
    if not isinstance(config.seed, int) or config.seed < 0:
        raise ConfigurationError(f"seed must be an integer of at least 0; got {config.seed!r}")
    if not isinstance(config.pictures, int) or config.pictures < 0:
        raise ConfigurationError(f"pictures must be an integer of at least 0; got {config.pictures!r}")
    for key, columns in (("node", node_columns), ("edge", edge_columns)):
        groups = config.features[key]
        if isinstance(groups, str):
            raise ConfigurationError(f"features.{key} must be a list of groups: features.{key}=[{groups}]")
        # The groups of node blocks are checked when the model is made.
        columns(split_groups(groups)[0] if key == "node" else groups)
    # Networks can only be made when the graphs are known, but their classes can be checked now.
    for key, kind in (("model", EdgeClassifier), ("objectness", ObjectnessHead)):
        if config[key] is not None:
            require_kind(instantiate({"_target_": config[key]._target_, "_partial_": True}).func, kind, key)
    for key, protocol in (("partition", Partitioner), ("sampler", EdgeSampler)):
        require_call(instantiate(config[key]), protocol, key)
    require_kind(instantiate(config.objects), ObjectRule, "objects")
    for group in (config.trainer, config.superpixels):
        instantiate(group)
    configured_graph(config)
    if config.tuning is not None:
        instantiate(config.tuning)


def _usable_splits(config: DictConfig, workers: int) -> tuple[str, ...]:
    """Return the splits of the dataset; raise if those needed for training and tuning are missing."""
    splits = splits_of(frame_source(config.dataset, workers))
    if "train" not in splits:
        # Opening the split reports a missing folder.
        len(frame_source(config.dataset, workers, splits[0]))
        raise ConfigurationError(
            f"the dataset has no training frames, only {', '.join(splits)}. Choose another dataset, or score a trained "
            "model on this one: python -m sgbd.evaluate"
        )
    if config.tuning is not None and "val" not in splits:
        raise ConfigurationError(
            "the dataset has no validation frames to choose thresholds on; keep the configured ones with tuning=none"
        )
    for split, consequence in (
        ("val", "the dataset has no validation frames: the last epoch's weights are kept"),
        ("test", "the dataset has no test frames: nothing will be evaluated"),
    ):
        if split not in splits:
            log.warning(consequence)
    return splits


def _graphs_by_split(
    config: DictConfig, splits: Sequence[str], features: Mapping[str, Any]
) -> dict[str, SuperpixelGraphDataset]:
    """Prepare all splits and open the graphs with ground truth; training graphs with only the fields training reads."""
    block = configured_block(config)
    cache = prepare_splits(config, splits, block)
    graphs = {}
    for split in splits:
        fields = ("name", *FIELDS) if split == "train" else None
        opened = open_graphs(cache, split, features, block, in_memory=config.in_memory, fields=fields)
        graphs[split] = with_truth(opened, config.on_error)
    return graphs


def _train(
    config: DictConfig, initial: Checkpoint, graphs: Mapping[str, SuperpixelGraphDataset], folder: Path
) -> TrainingResult:
    """Train; if there are validation frames, score them after every epoch."""
    trainer: Trainer = instantiate(config.trainer)
    validate = None
    if "val" in graphs:
        evaluator = Evaluator(instantiate(config.partition), instantiate(config.objects), boundaries=False)
        validate = Validation(graphs["val"], evaluator)
    return trainer.train(
        initial.model,
        graphs["train"],
        sampler=instantiate(config.sampler),
        folder=folder,
        recipe={
            **initial.recipe,
            "dataset": graphs["train"].recipe["dataset"],
            "seed": config.seed,
            "versions": {"sgbd": __version__, **{name: version(name) for name in ("torch", "torch-geometric")}},
        },
        objectness=initial.objectness,
        first_stage=initial.first_stage,
        validate=validate,
        # With logger=[], the configuration has no such key.
        loggers=[instantiate(logger) for logger in (config.get("logger") or {}).values()],
    )


def _tune(config: DictConfig, validation: SuperpixelGraphDataset, path: Path, folder: Path) -> None:
    """Tune thresholds on the validation frames, and write them into the checkpoint."""
    trust = trusted_packages(config)
    checkpoint = Checkpoint.load(path, trust)
    # Start from the configuration: in a resumed job, the checkpoint may already have tuned thresholds.
    recipe = untrained_checkpoint(config).recipe
    tuned = instantiate(config.tuning)(
        validation, checkpoint.model, checkpoint.objectness, recipe["partition"], recipe["objects"], trust
    )
    checkpoint.recipe |= tuned.sections
    write_whole(folder / TUNING_FILE, tuned.table.to_csv(index=False).encode())
    checkpoint.save(path)


def _test(
    config: DictConfig, dataset: SuperpixelGraphDataset, trained: TrainingResult, folder: Path, workers: int
) -> Evaluation:
    """Load the checkpoint of the best epoch from its file, and score it on the test frames."""
    segmenter = Segmenter.load(trained.checkpoint, trust=trusted_packages(config))
    evaluate = Evaluator(segmenter.partition, segmenter.rule, calibration=segmenter.calibration)
    evaluation = evaluate(dataset, segmenter.model, segmenter.objectness, progress=True)
    write_evaluation(evaluation, folder)
    source = frame_source(config.dataset, workers, "test")
    draw_examples(example_frames(evaluation, config.pictures), evaluation, source, segmenter, folder)
    return evaluation
