"""The extent of a benchmark: numbers of repetitions, frames and graphs."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from omegaconf import DictConfig

from sgbd.jobs.configuration import ConfigurationError


@dataclass(frozen=True)
class Extent:
    """Numbers of repetitions, frames and graphs to measure.

    Attributes:
        repeats: Number of timed repetitions of a frame.
        reference_repeats: The same for the reference, which takes about a second per frame.
        memory_frames: Number of frames over which memory is measured.
        start_repeats: Number of fresh processes with a warm compilation cache.
        prepare_frames: Number of frames to prepare.
        train_graphs: Number of graphs per training epoch.
        evaluate_repeats: Number of evaluation passes.
    """

    repeats: int = 40
    reference_repeats: int = 6
    memory_frames: int = 200
    start_repeats: int = 3
    prepare_frames: int = 64
    train_graphs: int = 400
    evaluate_repeats: int = 3

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ConfigurationError: If one is below 1.
        """
        for name, value in vars(self).items():
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise ConfigurationError(f"{name} must be a number from 1; got {value!r}")


SHORT = Extent(
    repeats=10,
    reference_repeats=2,
    memory_frames=30,
    start_repeats=1,
    prepare_frames=16,
    train_graphs=40,
    evaluate_repeats=1,
)


def configured_extent(config: DictConfig) -> Extent:
    """Return the configured extent; null values are taken from the full or the short extent.

    Args:
        config: Configuration with the keys of conf/benchmark.yaml.

    Raises:
        ConfigurationError: If a number is below 1.
    """
    given = {field.name: config[field.name] for field in dataclasses.fields(Extent)}
    return dataclasses.replace(
        SHORT if config.short else Extent(), **{name: value for name, value in given.items() if value is not None}
    )
