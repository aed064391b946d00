"""Notices about a dataset, said once: every split, and every step of a run, opens the dataset anew."""

from __future__ import annotations

import logging

_SAID: set[tuple[str, str]] = set()


def info_once(logger: logging.Logger, message: str, *values: object) -> None:
    """Log a message at level INFO, unless this process has logged the very same text before.

    Args:
        logger: Where to.
        message: As in `logging.Logger.info`.
        values: Put into the message.
    """
    text = message % values
    if (logger.name, text) not in _SAID and logger.isEnabledFor(logging.INFO):
        _SAID.add((logger.name, text))
        logger.info("%s", text)
