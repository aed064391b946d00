"""The model to measure: a trained one, or the configured one with the weights it starts training from."""

from __future__ import annotations

import torch
from omegaconf import DictConfig

from sgbd.checkpoint import Checkpoint, find_checkpoint
from sgbd.jobs.configuration import ConfigurationError
from sgbd.jobs.untrained import trusted_packages, untrained_checkpoint
from sgbd.segmenter import Segmenter


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
        checkpoint = Checkpoint.load(find_checkpoint(config.checkpoint, config.output_dir), tuple(config.trust))
    else:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            checkpoint = untrained_checkpoint(config)
    if n is not None:
        superpixels = checkpoint.recipe["superpixels"]
        if "n_segments" not in superpixels:
            raise ConfigurationError(f"n cannot be set: {superpixels['_target_']} has no n_segments. Leave n at null.")
        checkpoint.recipe["superpixels"] = {**superpixels, "n_segments": n}
    return checkpoint


def configured_segmenter(config: DictConfig, n: int | None = None) -> Segmenter:
    """Return what segments frames with the checkpoint that a configuration means; arguments and errors as for
    `configured_checkpoint`.
    """
    checkpoint = configured_checkpoint(config, n)
    return Segmenter(checkpoint, threads=torch.get_num_threads(), trust=trusted_packages(config))
