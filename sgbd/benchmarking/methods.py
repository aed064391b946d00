"""Create methods by name for timing whole frames side by side."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hydra import compose
from hydra.core.global_hydra import GlobalHydra
from omegaconf import DictConfig

from sgbd.benchmarking.checkpoints import configured_segmenter
from sgbd.benchmarking.frames import RawFrame
from sgbd.benchmarking.reference import Reference, scikit_image_superpixels
from sgbd.jobs.configuration import ConfigurationError
from sgbd.jobs.untrained import GROUPS

Method = Callable[[RawFrame], Any]

OURS, REFERENCE, SCIKIT_IMAGE = "ours", "reference", "scikit_image"


def make_method(name: str, config: DictConfig, n: int) -> Method:
    """Return a method by its name.

    Args:
        name: `ours` for the configured segmenter; `reference` for the re-implemented published algorithm;
            `scikit_image` for only its two SLIC calls; or a changed option of `ours`, given as `<group>/<option>`, such
            as `superpixels/slic_reference`, or as the option alone, such as `slic_reference` or `gated_gcn`, if only
            one group has it.
        config: Configuration of the benchmark.
        n: Number of superpixels requested for colour and for depth.

    Returns:
        A function of a frame.

    Raises:
        ConfigurationError: If there is no such method; the message lists the choices.
    """
    if name == REFERENCE:
        reference = Reference.untrained(n)
        return lambda raw: reference(raw.frame())
    if name == SCIKIT_IMAGE:
        return lambda raw: scikit_image_superpixels(raw.frame(), n)
    if name == OURS:
        chosen = configured_segmenter(config, n)
    else:
        changed = with_option(config, name)
        chosen = configured_segmenter(changed, n, changed.superpixels)
    return lambda raw: chosen.segment(raw.rgb, raw.depth, raw.intrinsics)


def with_option(config: DictConfig, name: str) -> DictConfig:
    """Return the configuration with the option of one group changed.

    Args:
        config: Configuration of the benchmark; Hydra must be initialised.
        name: `<group>/<option>`, or an option that only one group has.

    Returns:
        A changed copy.

    Raises:
        ConfigurationError: If there is no such option, or a checkpoint determines that group, as it does all but the
            superpixels.
    """
    loader = GlobalHydra.instance().config_loader()
    group, slash, option = name.partition("/")
    if not slash:
        owners = [owner for owner in GROUPS if name in loader.get_group_options(owner)]
        group, option = (owners[0], name) if len(owners) == 1 else (name, "")
    choices = loader.get_group_options(group) if group in GROUPS else []
    if option not in choices:
        known = (
            f"{group}/<option> with one of {', '.join(choices)}"
            if choices
            else f"<group>/<option> of {', '.join(GROUPS)}"
        )
        raise ConfigurationError(
            f"there is no method {name!r} to compare; choose {OURS}, {REFERENCE}, {SCIKIT_IMAGE}, or {known}"
        )
    if config.checkpoint is not None and group != "superpixels":
        raise ConfigurationError(f"{name} cannot take the place of what the checkpoint holds; leave checkpoint at null")
    changed = config.copy()
    changed[group] = compose("benchmark", [f"{group}={option}"])[group]
    return changed
