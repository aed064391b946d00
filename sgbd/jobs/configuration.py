"""The location of the configuration, and the start and error handling of the command-line entry points."""

from __future__ import annotations

import errno
import functools
import os
import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import CompactHydraException, HydraException, InstantiationException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from sgbd.jobs.command_help import command_help
from sgbd.jobs.misspelled_keys import other_command, suggestions
from sgbd.jobs.unreadable_arguments import spellings
from sgbd.machine.processors import usable_processors
from sgbd.machine.workers import pythons_start_method

INTERRUPTED = 130
"""Exit status after Ctrl-C, as in shells (128 + SIGINT)."""

MULTIRUN = ("-m", "--multirun")
"""Hydra's option for a sweep."""

LISTS_OF_NAMES = ("trust", "splits", "sections")
"""Keys of commands that are lists of names; for a single name, the brackets can be left out."""


OmegaConf.register_new_resolver("command_help", lambda _root_: command_help(_root_), replace=True)


class ConfigurationError(ValueError):
    """Raised if a configuration cannot be run; the message says what was given, what is expected and what to do."""


class ExpectedError(CompactHydraException):
    """An error whose message is a complete explanation; Hydra prints it without a traceback."""


def config_folder() -> Path:
    """Return the folder of the shipped configuration: `sgbd/conf` of a wheel or `conf/` of a checkout.

    Raises:
        ConfigurationError: If the package was copied without its configuration.
    """
    package = Path(__file__).resolve().parent.parent
    # The wheel's folder first: beside an installed package, site-packages/conf would belong to another package.
    for folder in (package / "conf", package.parent / "conf"):
        if (folder / "train.yaml").is_file():
            return folder
    raise ConfigurationError(
        f"the configuration is missing: neither {package / 'conf'} nor {package.parent / 'conf'} holds train.yaml. "
        "Install the package with pip, or keep sgbd/ and conf/ of a checkout side by side."
    )


def count_workers(workers: int | None) -> int:
    """Return the number of worker processes: `workers`, or if it is None, one per CPU that this process may use.

    Raises:
        ConfigurationError: If `workers` is negative.
    """
    if workers is None:
        return len(usable_processors())
    if workers < 0:
        raise ConfigurationError(
            f"workers must be null (one a CPU), 0 (none, all in this process) or more; got {workers}"
        )
    return workers


def output_folder() -> Path:
    """Return the folder of the running Hydra job."""
    return Path(HydraConfig.get().runtime.output_dir)


def entry_point(config_name: str) -> Callable[[Callable[[DictConfig], Any]], Callable[[], None]]:
    """Turn a function of a configuration into a command: `hydra.main` with readable error messages.

    Errors that the user can fix are printed without a traceback (set HYDRA_FULL_ERROR=1 to see it). Other errors are
    bugs and keep their traceback. In both cases the exit status is 1; after Ctrl-C it is 130.

    Args:
        config_name: Name of the configuration to compose: a YAML file in `config_folder`, without its suffix.

    Returns:
        The decorator.
    """

    def decorate(task: Callable[[DictConfig], Any]) -> Callable[[], None]:
        begun = False

        @functools.wraps(task)
        def guarded(config: DictConfig) -> Any:
            nonlocal begun
            begun = True
            for key in LISTS_OF_NAMES:
                if isinstance(config.get(key), str):
                    config[key] = [config[key]]
            experiment = HydraConfig.get().runtime.choices.get("experiment")
            wrong = other_command(config_folder(), config_name, experiment) if experiment else None
            try:
                if wrong is not None:
                    raise ConfigurationError(wrong)
                with pythons_start_method():
                    return task(config)
            except KeyboardInterrupt:
                print(f"\nInterrupted. {_how_to_continue()}", file=sys.stderr)
                raise
            except Exception as error:
                message = explain(error)
                if message is None or os.environ.get("HYDRA_FULL_ERROR", "0") not in ("", "0"):
                    raise
                raise ExpectedError(message) from None

        launch = hydra.main(config_path=str(config_folder()), config_name=config_name, version_base="1.3")(guarded)

        @functools.wraps(task)
        def run() -> None:
            # Otherwise, Hydra rejects an -m between two overrides.
            sys.argv[1:] = sorted(sys.argv[1:], key=lambda argument: argument not in MULTIRUN)
            try:
                launch()
            except KeyboardInterrupt:
                sys.exit(INTERRUPTED)
            except SystemExit as end:
                # Hydra has rejected an argument. Its advice is to add the key, but the key may be misspelt.
                if end.code and not begun:
                    arguments = sys.argv[1:]
                    for advice in spellings(arguments) or suggestions(config_folder(), config_name, arguments):
                        print(advice, file=sys.stderr)
                raise

        return run

    return decorate


def explain(error: BaseException) -> str | None:
    """Return a message for the user about `error`, or None if the error is a bug and needs its traceback."""
    if isinstance(error, InstantiationException):
        cause = error.__cause__
        message = explain(cause) if cause is not None else None
        # Without a known cause: a wrong argument or `_target_`; Hydra's message names the key.
        return message or (_with_reason(error, cause) if isinstance(cause, ImportError) else str(error))
    if isinstance(error, MissingMandatoryValue):
        key = error.full_key or "a mandatory value"
        return f"{key} is not set. Give it on the command line: {key}=<value>"
    if isinstance(error, ValueError) and _raised_here(error):
        return str(error)
    if isinstance(error, OmegaConfBaseException | HydraException) or type(error).__module__.partition(".")[0] == "sgbd":
        # All error classes of the package have messages that tell the user what to do.
        return str(error)
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        where = f" while writing {error.filename}" if error.filename else ""
        return f"the disk is full{where}. Make room. {_how_to_continue()}"
    if isinstance(error, FileExistsError | NotADirectoryError):
        return (
            f"{error.filename}: a file lies where a folder is needed ({error.strerror}). Name another place, or move "
            "the file away."
        )
    if isinstance(error, OSError) and (error.filename or isinstance(error, FileNotFoundError | PermissionError)):
        # A read-only or failing file system among others.
        return str(error)
    return None


def _with_reason(error: BaseException, cause: ImportError) -> str:
    """Return the message of a failed import with its cause, which Hydra only shows in the traceback."""
    message = str(error).replace(", set env var HYDRA_FULL_ERROR=1 to see chained exception", "")
    return f"{message}\n{cause}\nModules are found in the current folder, on PYTHONPATH and among what is installed."


def _raised_here(error: BaseException) -> bool:
    """Return whether a module of the package raised the error itself, with a message of its own."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and str(trace.tb_frame.f_globals.get("__name__", "")).startswith("sgbd.")


def _how_to_continue() -> str:
    """Return a message that says how to resume an interrupted job."""
    kept = "What is finished is kept; "
    settings = HydraConfig.get() if HydraConfig.initialized() else None
    if settings is not None and settings.job.name == "predict":
        return "The results of the frames so far are kept; repeating the command segments all frames again."
    if settings is None or settings.mode != RunMode.RUN or settings.job.name != "train":
        return kept + "repeat the command to go on."
    own = [source.path for source in settings.runtime.config_sources if source.provider == "command-line"]
    folder = settings.runtime.output_dir
    if not re.fullmatch(r"[\w./:-]+", folder, re.ASCII):
        # Within the quotes of the shell, Hydra needs its own.
        folder = "'" + folder.replace("\\", "\\\\").replace("'", "\\'") + "'"
    options = [word for path in own for word in ("--config-dir", path)]
    arguments = shlex.join([*options, *settings.overrides.task, f"hydra.run.dir={folder}"])
    return f"{kept}go on with: python -m sgbd.{settings.job.name} {arguments}"
