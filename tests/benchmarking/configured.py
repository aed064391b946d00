"""Configurations of a very short benchmark: small frames, one repetition."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from sgbd.jobs.configuration import config_folder

SMALL = (
    "size=[64,48]",
    "n=16",
    "frame_count=2",
    "progress=false",
    "workers=0",
    "repeats=3",
    "reference_repeats=2",
    "memory_frames=4",
    "start_repeats=1",
    "prepare_frames=3",
    "train_graphs=5",
    "evaluate_repeats=1",
    "trainer.epochs=2",
)


@contextmanager
def small_benchmark(*overrides: str) -> Iterator[DictConfig]:
    """Yield the configuration while Hydra is initialised, as in a command."""
    with initialize_config_dir(str(config_folder()), version_base="1.3", job_name="benchmark"):
        yield compose("benchmark", [*SMALL, *overrides])
