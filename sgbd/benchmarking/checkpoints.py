"""Provide the model to measure: a trained checkpoint, or the configured model with its initial weights."""

from __future__ import annotations

import torch
from hydra.utils import instantiate
from omegaconf import DictConfig

from sgbd.checkpoint import Checkpoint, find_checkpoint
from sgbd.jobs.configuration import ConfigurationError
from sgbd.jobs.untrained import trusted_packages, untrained_checkpoint
from sgbd.recipe import describe
from sgbd.segmenter import Segmenter


def configured_checkpoint(
    config: DictConfig, n: int | None = None, superpixels: DictConfig | None = None
) -> Checkpoint:
    """Return the checkpoint selected by a configuration.

    Args:
        config: Contains `checkpoint`, the file or folder of a training; if null, also the groups of conf/train.yaml
            that define a model.
        n: Overrides `n_segments` of the superpixels.
        superpixels: Replaces the superpixels, even those of a trained model.

    Returns:
        The trained model with its recipe, or an untrained one, since run time does not depend on the weights.

    Raises:
        ConfigurationError: If `n` is given, but the superpixels have no option `n_segments`.
        CheckpointError: If the file cannot be read.
    """
    if config.checkpoint is not None:
        checkpoint = Checkpoint.load(find_checkpoint(config.checkpoint, config.output_dir), tuple(config.trust))
    else:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            checkpoint = untrained_checkpoint(config)
    if superpixels is not None:
        checkpoint.recipe["superpixels"] = describe(instantiate(superpixels), "superpixels")
    if n is not None:
        number_of_superpixels(checkpoint)
        checkpoint.recipe["superpixels"] = {**checkpoint.recipe["superpixels"], "n_segments": n}
    return checkpoint


def number_of_superpixels(checkpoint: Checkpoint) -> int:
    """Return the number of superpixels that a checkpoint requests.

    Raises:
        ConfigurationError: If its superpixels have no option `n_segments`.
    """
    superpixels = checkpoint.recipe["superpixels"]
    if "n_segments" not in superpixels:
        raise ConfigurationError(
            f"{superpixels['_target_']} has no n_segments, by which the benchmark asks for n superpixels; give the "
            "class this argument"
        )
    return int(superpixels["n_segments"])


def configured_segmenter(config: DictConfig, n: int | None = None, superpixels: DictConfig | None = None) -> Segmenter:
    """Return a segmenter with the selected checkpoint; arguments and errors as for `configured_checkpoint`."""
    checkpoint = configured_checkpoint(config, n, superpixels)
    trust = trusted_packages(config)
    return Segmenter(checkpoint, threads=torch.get_num_threads(), trust=trust, reduce=config.reduce)
