"""The error of a training that cannot start or continue."""

from __future__ import annotations


class TrainingError(RuntimeError):
    """Raised if a training cannot start or continue; the message says why and what to do."""
