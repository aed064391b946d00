"""Log messages about a dataset only once, although each split and each step of a run opens the dataset again."""

from __future__ import annotations

import logging

_SAID: set[tuple[str, str]] = set()


def info_once(logger: logging.Logger, message: str, *values: object) -> None:
    """Log a message at level INFO, unless this process has already logged the same text.

    Args:
        logger: The logger.
        message: Format string, as in `logging.Logger.info`.
        values: Arguments of the format string.
    """
    text = message % values
    if (logger.name, text) not in _SAID and logger.isEnabledFor(logging.INFO):
        _SAID.add((logger.name, text))
        logger.info("%s", text)
