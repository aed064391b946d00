"""One experiment: prepare, train, evaluate, draw, as a configuration says."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from lightning_fabric import seed_everything
from omegaconf import DictConfig, OmegaConf

from sgbd.batches import FIELDS
from sgbd.checkpoint import Checkpoint
from sgbd.configuration import ConfigurationError, count_workers
from sgbd.data import SuperpixelGraphDataset
from sgbd.evaluation import Evaluation, Evaluator, with_truth
from sgbd.features import EDGE_GROUPS, NODE_GROUPS
from sgbd.models import EdgeClassifier, ObjectnessHead
from sgbd.pipeline import frame_source, prepare_splits, splits_of
from sgbd.plot import curves_figure
from sgbd.recipe import describe
from sgbd.results import draw_examples, example_frames, write_evaluation, write_figure
from sgbd.segmenter import Segmenter
from sgbd.training import Trainer, TrainingResult

log = logging.getLogger(__name__)


class Validation:
    """Scores of the validation graphs after an epoch. A class, not a closure: training processes are sent it.

    Args:
        graphs: The validation graphs.
        evaluate: What scores them.
    """

    def __init__(self, graphs: SuperpixelGraphDataset, evaluate: Evaluator) -> None:
        self.graphs = graphs
        self.evaluate = evaluate

    def __call__(self, model: EdgeClassifier, objectness: ObjectnessHead | None) -> Mapping[str, float]:
        """Return the scores, those over all objects without a prefix."""
        scores = self.evaluate(self.graphs, model, objectness).scores
        return {name.removeprefix("all/"): value for name, value in scores.items()}


def run_experiment(config: DictConfig, folder: Path) -> dict[str, Any]:
    """Prepare, train and evaluate as configured.

    Args:
        config: A configuration with the keys of conf/train.yaml.
        folder: Where checkpoint, curves, scores and pictures go.

    Returns:
        What `result.json` holds: scores, parameters, best epoch and the checkpoint's file name.

    Raises:
        ConfigurationError: If the dataset has no training split.
    """
    workers = count_workers(config.workers)
    splits = splits_of(frame_source(config.dataset, workers))
    if "train" not in splits:
        # A folder that is not there says so itself.
        len(frame_source(config.dataset, workers, splits[0]))
        raise ConfigurationError(
            f"the dataset has no training frames, only {', '.join(splits)}. Choose another dataset, or score a trained "
            "model on this one: python -m sgbd.evaluate"
        )
    cache = prepare_splits(config, splits)
    features = {"node": _groups(config.features.node, NODE_GROUPS), "edge": _groups(config.features.edge, EDGE_GROUPS)}

    def graphs(split: str, fields: Collection[str] | None = None) -> SuperpixelGraphDataset:
        dataset = SuperpixelGraphDataset(cache, split, features["node"], features["edge"], config.in_memory, fields)
        return with_truth(dataset, config.on_error)

    training = graphs("train", ("name", *FIELDS))
    seed_everything(config.seed, verbose=False)
    channels = {"node_channels": training.node_channels, "edge_channels": training.edge_channels}
    model: EdgeClassifier = instantiate(config.model, **channels)
    objectness: ObjectnessHead | None = None
    if config.objectness is not None:
        objectness = instantiate(config.objectness, node_channels=training.node_channels)
    partition, rule = instantiate(config.partition), instantiate(config.objects)
    trainer: Trainer = instantiate(config.trainer)

    validate = None
    if "val" in splits:
        validate = Validation(graphs("val"), Evaluator(partition, rule, boundaries=False))
    else:
        log.warning("the dataset has no validation frames: the last epoch's weights are kept")

    # Before the training: a dataset that cannot be scored is told of now.
    testing = graphs("test") if "test" in splits else None
    if testing is None:
        log.warning("the dataset has no test frames: nothing will be evaluated")

    trained = trainer.train(
        model,
        training,
        sampler=instantiate(config.sampler),
        folder=folder,
        recipe={
            "superpixels": describe(instantiate(config.superpixels), "superpixels"),
            "graph": describe(instantiate(config.graph), "graph"),
            "features": features,
            "model": {**_plain(config.model), **channels},
            "objectness": (
                None if objectness is None else {**_plain(config.objectness), "node_channels": training.node_channels}
            ),
            "partition": _plain(config.partition),
            "objects": _plain(config.objects),
            "dataset": training.recipe["dataset"],
            "seed": config.seed,
            "versions": {package: version(package) for package in ("sgbd", "torch", "torch-geometric")},
        },
        objectness=objectness,
        validate=validate,
        loggers=[instantiate(logger) for logger in config.logger.values()],
    )
    _draw_curves(trained, folder)
    outcome = {
        "checkpoint": trained.checkpoint.name,
        "parameters": sum(parameter.numel() for parameter in model.parameters()),
        "best_epoch": trained.best_epoch,
        "validation_score": trained.best_score,
    }
    if testing is None:
        return {**outcome, "scores": {}}
    evaluation = _test(config, testing, trained, folder, workers)
    return {**outcome, "scores": evaluation.scores}


def _test(
    config: DictConfig, dataset: SuperpixelGraphDataset, trained: TrainingResult, folder: Path, workers: int
) -> Evaluation:
    """Score the best epoch's checkpoint, as read from its file, on the test frames."""
    segmenter = Segmenter(Checkpoint.load(trained.checkpoint, trust=_packages(config)), trust=_packages(config))
    evaluate = Evaluator(segmenter.partition, segmenter.rule)
    evaluation = evaluate(dataset, segmenter.model, segmenter.objectness, progress=True)
    write_evaluation(evaluation, folder)
    source = frame_source(config.dataset, workers, "test")
    draw_examples(example_frames(evaluation, config.pictures), evaluation, source, segmenter, folder)
    return evaluation


def _draw_curves(trained: TrainingResult, folder: Path) -> None:
    shown = ("loss", "edge_loss", "objectness_loss", "val/overlap_f", "val/unaided/overlap_f", "val/oracle/overlap_f")
    history = trained.history
    curves = {
        name: list(zip(history["epoch"], history[name], strict=True)) for name in shown if name in history.columns
    }
    write_figure(curves_figure(curves, f"best epoch {trained.best_epoch}"), folder / "curves.png")


def _groups(chosen: Collection[str] | None, table: Mapping[str, Any]) -> list[str]:
    """Spell out which groups null stands for, so that a checkpoint keeps its meaning when groups are added."""
    return list(table if chosen is None else chosen)


def _plain(config: DictConfig) -> dict[str, Any]:
    values = OmegaConf.to_container(config, resolve=True)
    assert isinstance(values, dict)
    return {str(key): value for key, value in values.items()}


def _packages(config: DictConfig) -> tuple[str, ...]:
    """Packages whose classes the configuration names: whoever wrote it trusts them."""
    groups = (config.superpixels, config.graph, config.model, config.objectness, config.partition)
    return tuple({group._target_.partition(".")[0] for group in groups if group is not None})
