"""Work in a folder that several processes may be asked for, and one may do."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout


@contextlib.contextmanager
def one_process_at_a_time(lock_file: Path, log: logging.Logger, doing: str) -> Iterator[None]:
    """Hold a lock between processes; while another one has it, say so and wait.

    The system releases the lock when its holder dies, however that happens.

    Args:
        lock_file: File that stands for the work; its folder exists.
        log: Where the notice goes.
        doing: What the other process does, such as "prepares data/graphs/train".
    """
    lock = FileLock(lock_file)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        log.info("another process %s: waiting until it is done", doing)
        lock.acquire()
    try:
        yield
    finally:
        lock.release()
