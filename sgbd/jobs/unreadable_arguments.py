"""How arguments of the command line that Hydra's grammar does not know would have to be written."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException


def spellings(arguments: Sequence[str]) -> list[str]:
    """Say how to write arguments that cannot be read.

    Args:
        arguments: Of the command line.

    Returns:
        A sentence for every argument that is no key=value, or the value of which needs quotes. Options such as
        --config-dir are passed over, with their values.
    """
    parser = OverridesParser.create()
    told = []
    for argument in get_args_parser().parse_known_args(list(arguments))[0].overrides:
        try:
            parser.parse_override(argument)
        except HydraException:
            key, equals, value = argument.partition("=")
            if not equals and not argument.startswith("~"):
                told.append(f"{argument} is no key=value; --help lists the keys.")
            elif equals:
                escaped = value.replace("'", "\\'")
                quoted = _shell_quoted(f"{key}='{escaped}'")
                told.append(
                    "Values with letters or signs that mean something to Hydra, such as ,=()[]{}', need quotes within "
                    f"those of the shell: {quoted}"
                )
    return told


def _shell_quoted(argument: str) -> str:
    """Quote for a shell: with double quotes, which are easier to read, where they change nothing inside."""
    return shlex.quote(argument) if set(argument) & set('"$`\\!') else f'"{argument}"'
