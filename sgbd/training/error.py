"""The error of a training that cannot start or continue."""

from __future__ import annotations


class TrainingError(RuntimeError):
    """A training cannot start or continue; the message says why and what to do."""
