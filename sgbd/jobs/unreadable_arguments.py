"""Suggested spellings of command-line arguments that Hydra cannot parse."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException


def spellings(arguments: Sequence[str]) -> list[str]:
    """Suggest how to write arguments that Hydra cannot parse.

    Args:
        arguments: The command-line arguments.

    Returns:
        A sentence for every argument that is not key=value, or whose value needs quotes. Options such as --config-dir
        and their values are ignored.
    """
    parser = OverridesParser.create()
    advice = []
    for argument in get_args_parser().parse_known_args(list(arguments))[0].overrides:
        try:
            parser.parse_override(argument)
        except HydraException:
            key, equals, value = argument.partition("=")
            if not equals and not argument.startswith("~"):
                advice.append(f"{argument} is no key=value; --help lists the keys.")
            elif equals:
                escaped = value.replace("'", "\\'")
                quoted = _shell_quoted(f"{key}='{escaped}'")
                advice.append(
                    "Values with letters or signs that mean something to Hydra, such as ,=()[]{}', need quotes within "
                    f"those of the shell: {quoted}"
                )
    return advice


def _shell_quoted(argument: str) -> str:
    """Quote an argument for a shell, with the more readable double quotes if nothing inside needs escaping."""
    return shlex.quote(argument) if set(argument) & set('"$`\\!') else f'"{argument}"'
