"""python -m sgbd.report: collect all results of a run or a sweep on one page."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from omegaconf import DictConfig

from sgbd.jobs.configuration import ConfigurationError, entry_point
from sgbd.machine.atomic_file import write_whole
from sgbd.reporting.page import render
from sgbd.reporting.runs import read_results

PAGE_FILE = "report.html"

TAKES_A_VALUE = (
    "--cfg",
    "-c",
    "--package",
    "-p",
    "--config-path",
    "-cp",
    "--config-name",
    "-cn",
    "--config-dir",
    "-cd",
)
"""Hydra's options whose value is the next argument."""


@entry_point("report")
def _report(config: DictConfig) -> None:
    """Read the results, write the page and print its path."""
    if config.frame_rows < 1 or config.megabytes < 0:
        raise ConfigurationError(
            f"frame_rows must be at least 1 and megabytes at least 0; got {config.frame_rows} and {config.megabytes}"
        )
    folder = Path(config.folder).expanduser()
    page = render(read_results(folder), frame_rows=config.frame_rows, megabytes=config.megabytes).encode()
    path = folder / PAGE_FILE if config.output is None else Path(config.output).expanduser()
    if path.is_dir():
        path = path / PAGE_FILE
    write_whole(path, page)
    print(f"Report, {len(page) / 1e6:.1f} MB, to be opened in a browser: {path}")


def with_folder(arguments: Sequence[str]) -> list[str]:
    """Convert a folder without a key among the command-line arguments to an override of `folder`.

    Args:
        arguments: The command-line arguments.

    Returns:
        The arguments for Hydra, with `outputs/train/x` replaced by `folder='outputs/train/x'`. A folder's name may look
        like an override to Hydra, as those of sweeps do (`features=all/seed=0`).
    """
    result = []
    for place, argument in enumerate(arguments):
        value_of_option = place > 0 and arguments[place - 1] in TAKES_A_VALUE
        if argument.startswith("-") or value_of_option or not _is_path(argument):
            result.append(argument)
        else:
            escaped = argument.replace("\\", "\\\\").replace("'", "\\'")
            result.append(f"folder='{escaped}'")
    return result


def _is_path(argument: str) -> bool:
    key, equals, _ = argument.partition("=")
    if not equals or Path(argument).exists():
        return True
    return not (key.isidentifier() or key.lstrip("+~").startswith("hydra"))


def main() -> None:
    """Run the command."""
    sys.argv[1:] = with_folder(sys.argv[1:])
    _report()


if __name__ == "__main__":
    main()
