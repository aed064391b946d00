"""Suggestions for unknown keys on the command line."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

_CHOICE = re.compile(r"\+?(?P<group>[A-Za-z_]\w*)=\w+")
_OVERRIDE = re.compile(r"(?P<key>[A-Za-z_][\w./]*)(@[\w.]+)?=")


def suggestions(folder: Path, config_name: str, arguments: Sequence[str]) -> list[str]:
    """Suggest the most similar known keys for unknown ones.

    Args:
        folder: Folder of the configuration.
        config_name: Name of the configuration.
        arguments: The command-line arguments.

    Returns:
        A sentence for every unknown key that resembles a known one; or a single sentence if an experiment was made for
        another command. Added keys (+key), removed keys (~key) and keys of Hydra are ignored.
    """
    for argument in arguments:
        key, _, experiment = argument.partition("=")
        wrong = other_command(folder, config_name, experiment) if key == "+experiment" else None
        if wrong is not None:
            return [wrong]
    choices = [argument for argument in arguments if _is_choice(folder, argument)]
    with initialize_config_dir(str(folder.resolve()), version_base="1.3"):
        try:
            config = compose(config_name, choices)
        except HydraException:  # a choice that does not exist, or comes from --config-dir
            config = compose(config_name)
    known = list(_keys(OmegaConf.to_container(config, resolve=False)))
    matches = (_OVERRIDE.match(argument) for argument in arguments)
    keys = [match["key"] for match in matches if match is not None]
    advice = []
    for key in keys:
        if key in known or key.startswith("hydra"):
            continue
        nearest = difflib.get_close_matches(key, known, n=1, cutoff=0.7)
        advice += [f"{key} is no key of this command; did you mean {nearest[0]}?" for _ in nearest]
    return advice


def other_command(folder: Path, config_name: str, experiment: str) -> str | None:
    """Check whether an experiment was made for another command, that is, sets keys that this command does not have.

    Hydra lets an experiment add any key, so the command would silently ignore such keys.

    Args:
        folder: Folder of the configuration.
        config_name: Name of the command's configuration.
        experiment: Name of the chosen experiment.

    Returns:
        A message; None if the command has all keys, or `folder` does not contain the experiment.
    """
    file = folder / "experiment" / f"{experiment}.yaml"
    if not file.is_file():
        return None
    asked = _top_keys(file)
    lacking = asked - _top_keys(folder / f"{config_name}.yaml")
    if not lacking:
        return None
    commands = {other.stem: _top_keys(other) for other in folder.glob("*.yaml")}
    # A key that no command has is the experiment's own.
    known = set().union(*commands.values())
    asked, lacking = asked & known, lacking & known
    if not lacking:
        return None
    right = sorted(f"python -m sgbd.{name}" for name, keys in commands.items() if asked <= keys)
    return (
        f"experiment={experiment} sets {', '.join(sorted(lacking))}, which python -m sgbd.{config_name} does not have. "
        f"It is an experiment of {' or '.join(right) or 'another command'}."
    )


def _top_keys(file: Path) -> set[str]:
    """Return the top-level keys of a configuration, including its groups and the keys that it sweeps."""
    config = OmegaConf.load(file)
    assert isinstance(config, DictConfig)
    groups = {str(group) for entry in config.get("defaults", []) if isinstance(entry, DictConfig) for group in entry}
    groups = {group.removeprefix("override").strip(" /") for group in groups}
    swept = OmegaConf.select(config, "hydra.sweeper.params") or {}
    keys = {str(key).partition(".")[0] for key in (*config, *swept)}
    return {key for key in keys | groups if key not in ("defaults", "hydra") and not key.startswith("hydra/")}


def _is_choice(folder: Path, argument: str) -> bool:
    """Return whether an argument chooses one option of a group, which determines the keys of the group."""
    match = _CHOICE.fullmatch(argument)
    return match is not None and (folder / match["group"]).is_dir()


def _keys(values: Any, before: str = "") -> Iterator[str]:
    """Yield the full names of all keys, including groups."""
    if isinstance(values, Mapping):
        for key, value in values.items():
            yield f"{before}{key}"
            yield from _keys(value, f"{before}{key}.")
