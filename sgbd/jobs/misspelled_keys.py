"""What may be meant by keys on the command line that a configuration does not have."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from hydra.errors import HydraException
from omegaconf import OmegaConf

_CHOICE = re.compile(r"\+?(?P<group>[A-Za-z_]\w*)=\w+")
_OVERRIDE = re.compile(r"(?P<key>[A-Za-z_][\w./]*)(@[\w.]+)?=")


def suggestions(folder: Path, config_name: str, arguments: Sequence[str]) -> list[str]:
    """Name the keys that are nearest to those which do not exist.

    Args:
        folder: Folder of the configuration.
        config_name: The configuration.
        arguments: Of the command line.

    Returns:
        A sentence for every unknown key that is like a known one. What is added (+key) or removed (~key), and keys of
        Hydra's own, are passed over.
    """
    choices = [argument for argument in arguments if _is_choice(folder, argument)]
    with initialize_config_dir(str(folder.resolve()), version_base="1.3"):
        try:
            config = compose(config_name, choices)
        except HydraException:  # a choice that does not exist, or comes from --config-dir
            config = compose(config_name)
    known = list(_keys(OmegaConf.to_container(config, resolve=False)))
    matches = (_OVERRIDE.match(argument) for argument in arguments)
    keys = [match["key"] for match in matches if match is not None]
    told = []
    for key in keys:
        if key in known or key.startswith("hydra"):
            continue
        nearest = difflib.get_close_matches(key, known, n=1, cutoff=0.7)
        told += [f"{key} is no key of this command; did you mean {nearest[0]}?" for _ in nearest]
    return told


def _is_choice(folder: Path, argument: str) -> bool:
    """Return whether an argument chooses one option of a group, which decides on the keys below it."""
    match = _CHOICE.fullmatch(argument)
    return match is not None and (folder / match["group"]).is_dir()


def _keys(values: Any, before: str = "") -> Iterator[str]:
    """Yield the full name of every key, those of groups among them."""
    if isinstance(values, Mapping):
        for key, value in values.items():
            yield f"{before}{key}"
            yield from _keys(value, f"{before}{key}.")
