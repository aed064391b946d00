"""The model to measure: a trained one, or the configured one with the weights it starts training from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from sgbd.checkpoint import Checkpoint
from sgbd.configuration import ConfigurationError
from sgbd.features import edge_columns, node_columns
from sgbd.recipe import describe
from sgbd.segmenter import Segmenter
from sgbd.training import CHECKPOINT_FILE

GROUPS = ("superpixels", "graph", "model", "objectness", "partition", "objects")


def configured_checkpoint(config: DictConfig, n: int | None = None) -> Checkpoint:
    """Return the checkpoint that a configuration means.

    Args:
        config: With `checkpoint`, a file or folder of a training, or null; then with the groups of conf/train.yaml that
            say what a model is.
        n: Takes the place of the superpixels' `n_segments`.

    Returns:
        The trained model with its recipe, or an untrained one: how long a model takes does not depend on its weights.

    Raises:
        ConfigurationError: If the superpixels take no `n_segments`.
        CheckpointError: If the file cannot be read.
    """
    if config.checkpoint is not None:
        path = Path(config.checkpoint).expanduser()
        checkpoint = Checkpoint.load(path / CHECKPOINT_FILE if path.is_dir() else path, tuple(config.trust))
    else:
        checkpoint = _untrained(config)
    if n is not None:
        superpixels = checkpoint.recipe["superpixels"]
        if "n_segments" not in superpixels:
            raise ConfigurationError(f"n cannot be set: {superpixels['_target_']} has no n_segments. Leave n at null.")
        checkpoint.recipe["superpixels"] = {**superpixels, "n_segments": n}
    return checkpoint


def segmenter(checkpoint: Checkpoint, config: DictConfig) -> Segmenter:
    """Return what segments frames with a checkpoint of `configured_checkpoint`."""
    return Segmenter(checkpoint, threads=torch.get_num_threads(), trust=trusted_packages(config))


def trusted_packages(config: DictConfig) -> Sequence[str]:
    """Return the packages whose classes the configuration names: whoever wrote it trusts them."""
    named = {config[group]._target_.partition(".")[0] for group in GROUPS if config[group] is not None}
    return tuple(sorted({*config.trust, *named}))


def _untrained(config: DictConfig) -> Checkpoint:
    features = _plain(config.features)
    channels = {
        "node_channels": len(node_columns(features["node"])),
        "edge_channels": len(edge_columns(features["edge"])),
    }
    recipe: dict[str, Any] = {
        "superpixels": describe(instantiate(config.superpixels), "superpixels"),
        "graph": describe(instantiate(config.graph), "graph"),
        "features": features,
        "model": {**_plain(config.model), **channels},
        "objectness": None,
        "partition": _plain(config.partition),
        "objects": _plain(config.objects),
    }
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        model, objectness = instantiate(config.model, **channels), None
        if config.objectness is not None:
            recipe["objectness"] = {**_plain(config.objectness), "node_channels": channels["node_channels"]}
            objectness = instantiate(recipe["objectness"])
    return Checkpoint(model.eval(), objectness and objectness.eval(), recipe)


def _plain(config: DictConfig) -> dict[str, Any]:
    values = OmegaConf.to_container(config, resolve=True)
    assert isinstance(values, dict)
    return {str(key): value for key, value in values.items()}
