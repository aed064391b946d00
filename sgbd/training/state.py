"""The state file from which an interrupted training resumes."""

from __future__ import annotations

import io
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from sgbd.machine.atomic_file import write_whole
from sgbd.training.error import TrainingError

STATE_FILE = "state.pt"
STATE_VERSION = 1
"""Version of the file format; trainings resume only from files of this version."""


def write_state(path: Path, state: dict[str, Any]) -> None:
    """Write a state, whose keys include `version` and `identity`, atomically."""
    content = io.BytesIO()
    torch.save(state, content)
    write_whole(path, content.getvalue())


def read_state(path: Path, identity: Mapping[str, str]) -> dict[str, Any] | None:
    """Read the state of a training.

    Args:
        path: The file.
        identity: Everything, by name, that determines the result of the current training.

    Returns:
        The state, on the CPU; None if there is no file.

    Raises:
        TrainingError: If the file is damaged, has another version, or belongs to a training with another identity.
    """
    if not path.exists():
        return None
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        version, theirs = state["version"], state["identity"]
    except (RuntimeError, EOFError, pickle.UnpicklingError, LookupError, TypeError) as error:
        raise TrainingError(
            f"{path} cannot be read: it is damaged, or not the state of a training. Delete it to train from the start."
        ) from error
    if version != STATE_VERSION:
        raise TrainingError(
            f"{path} is of format version {version}, this version of sgbd goes on from version {STATE_VERSION}. Delete "
            "it to train from the start."
        )
    different = sorted(key for key in {*theirs, *identity} if theirs.get(key) != identity.get(key))
    if different:
        changes = "; ".join(f"{key} was {theirs.get(key)}, now {identity.get(key)}" for key in different)
        raise TrainingError(
            f"{path} is of another training: {changes}. Go on with the old settings, choose another folder, or delete "
            "the file to train from the start."
        )
    return state


def how_to_go_on(path: Path, epochs: int) -> str:
    """Return a message for the user who interrupted a training: what is kept, and how to resume."""
    if not path.exists():
        return "No epoch was finished, so it will begin anew."
    done = torch.load(path, map_location="cpu", weights_only=True)["epoch"]
    return f"{done} of {epochs} epochs are finished and kept in {path}; train into this folder again to go on."
