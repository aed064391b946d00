"""A job in its folder: run once, resumed after an interruption, and never overwritten."""

from __future__ import annotations

import hashlib
import json
import logging
import math
import os
import re
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf, open_dict

from sgbd import __version__
from sgbd.jobs.configuration import ConfigurationError
from sgbd.machine.atomic_file import write_whole
from sgbd.machine.one_process_at_a_time import one_process_at_a_time

log = logging.getLogger(__name__)

RESULT_FILE = "result.json"
JOB_FILE = "job.json"
LOCK_FILE = ".job.lock"
ASIDE = "earlier-"

PLACES = ("data_dir", "cache_dir", "output_dir")
"""Keys that set the locations of files; the result does not depend on them."""
IMMATERIAL = ("name", "workers", "logger", "in_memory", "pictures")
"""Further keys on which the result does not depend."""

IMMATERIAL_IN_TRAINER = ("num_workers", "log_every", "progress")

LONGEST_NAME = 150
"""Maximum length of a job's folder name, characters; file systems allow 255 bytes."""


def config_hash(config: DictConfig) -> str:
    """Return a digest of the package version and of everything in a job's configuration that affects its result.

    Args:
        config: A job's configuration, without the node `hydra`.

    Returns:
        64 hexadecimal digits.
    """
    material = config.copy()
    with open_dict(material):
        for key in IMMATERIAL:
            material.pop(key, None)
        for key in IMMATERIAL_IN_TRAINER:
            if isinstance(material.get("trainer"), DictConfig):
                material.trainer.pop(key, None)
        for key in PLACES:
            if key in material:
                # Replaced instead of removed, because other values are interpolated from these.
                material[key] = f"<{key}>"
    values = OmegaConf.to_container(material, resolve=True, enum_to_str=True)
    return digest([__version__, values])


def job_folder(override_dirname: str, name: str = "", experiment: str | None = None) -> str:
    """Return a folder name for a job of a sweep, made from its overrides.

    Args:
        override_dirname: Hydra's `hydra.job.override_dirname`, such as `features=rgb,model=mlp`.
        name: Name of the outputs, and of the folder above.
        experiment: The chosen experiment, if any. It is part of the folder's name unless it is the name of the outputs.

    Returns:
        One path component: separators become `_`, and names that are too long are cut. If the name was changed, it ends
        in a digest, so that the folders of two jobs differ. `base` if there are no overrides.
    """
    chosen = [] if experiment in (None, name) else [f"experiment={experiment}"]
    whole = ",".join([*chosen, *filter(None, [override_dirname])]) or "base"
    readable = re.sub(r"[/\\:\s]+", "_", whole).lstrip(".")
    if readable != whole or len(readable) > LONGEST_NAME:
        readable = f"{readable[: LONGEST_NAME - 11]}-{digest(whole)[:10]}"
    return readable


OmegaConf.register_new_resolver("job_folder", job_folder, replace=True)


def run_once(folder: Path, config: DictConfig, job: Callable[[DictConfig, Path], Mapping[str, Any]]) -> dict[str, Any]:
    """Run a job in its folder, or return its result if it has already finished there with the same configuration.

    - An interrupted job finds its own files in the folder and can resume from them.
    - Files of a job with another configuration are first moved to a subfolder `earlier-1`, `earlier-2`, …
    - If two processes use the same folder, the second one waits and then returns the result of the first.

    `result.json` is written last, and atomically.

    Args:
        folder: The job's own folder; created if needed.
        config: The job's configuration. A copy is written to `config.yaml`.
        job: A function of the configuration and the folder. It returns JSON values, with fractions from 0 to 1 under
            the key `scores`.

    Returns:
        The values returned by the job, with `config_hash` and `seconds`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with one_process_at_a_time(folder / LOCK_FILE, log, f"runs the job in {folder}"):
        identity = config_hash(config)
        previous = read_json(folder / JOB_FILE)
        if previous is not None and previous["config_hash"] != identity:
            move_aside(folder, keep=previous["found"])
            previous = None
        result = read_json(folder / RESULT_FILE) if previous is not None else None
        if result is not None:
            log.info("This job has finished before with the same configuration: %s", folder / RESULT_FILE)
            return result
        if previous is None:
            found = sorted(path.name for path in folder.iterdir() if path.name != LOCK_FILE)
            write_json(folder / JOB_FILE, {"config_hash": identity, "found": found})
        else:
            log.info("Going on with the interrupted job in %s", folder)
        OmegaConf.save(config, folder / "config.yaml")
        started = time.perf_counter()
        result = {"config_hash": identity, **job(config, folder)}
        result["seconds"] = time.perf_counter() - started
        write_json(folder / RESULT_FILE, result)
        return result


def move_aside(folder: Path, keep: Sequence[str] = (), only: Sequence[str] | None = None) -> None:
    """Move the contents of a folder to its next free subfolder `earlier-<n>`.

    Args:
        folder: The folder.
        keep: Names of files that stay.
        only: Names of files to move, if they exist; None for all.
    """
    names = sorted(path.name for path in folder.iterdir()) if only is None else list(only)
    names = [
        name
        for name in names
        if name not in keep and name != LOCK_FILE and not name.startswith(ASIDE) and (folder / name).exists()
    ]
    taken = [int(path.name[len(ASIDE) :]) for path in folder.glob(f"{ASIDE}*") if path.name[len(ASIDE) :].isdigit()]
    target = folder / f"{ASIDE}{max(taken, default=0) + 1}"
    target.mkdir()
    for name in names:
        (folder / name).rename(target / name)
    log.info("%s holds the result of another configuration; moved to %s", folder, target)


def digest(value: Any) -> str:
    """Return a digest of a JSON value: 64 hexadecimal digits, independent of the order of keys."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()


def read_json(path: Path) -> dict[str, Any] | None:
    """Return the mapping in a JSON file, or None if there is no such file.

    Raises:
        ConfigurationError: If the file is damaged.
    """
    try:
        value = json.loads(path.read_text())
    except FileNotFoundError:
        return None
    except json.JSONDecodeError as error:
        raise ConfigurationError(f"{path} is damaged ({error}); remove it and repeat the command") from None
    assert isinstance(value, dict)
    return value


def write_json(path: Path, value: Mapping[str, Any]) -> None:
    """Write a mapping as a JSON file, atomically; numbers that are not finite become null."""
    write_whole(path, (json.dumps(_plain(value), indent=2, allow_nan=False) + "\n").encode())


def _plain(value: Any) -> Any:
    """Convert a value to plain JSON types; NumPy numbers become Python numbers, non-finite numbers None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "item") and not isinstance(value, str):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, os.PathLike) else value
