"""Work in a folder that only one process at a time may do, though several may try."""

from __future__ import annotations

import contextlib
import errno
import logging
from collections.abc import Callable, Iterator
from pathlib import Path

from filelock import FileLock, Timeout

WITHOUT_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP)
"""Error codes of file systems that cannot lock files, such as some network shares."""


@contextlib.contextmanager
def one_process_at_a_time(
    lock_file: Path,
    log: logging.Logger,
    doing: str,
    wait: Callable[[Callable[[], bool]], None] | None = None,
) -> Iterator[None]:
    """Hold a lock between processes; while another process holds it, log this and wait.

    The system releases the lock when its holder dies, for whatever reason. If files cannot be locked, the work is done
    without a lock, after a warning.

    Args:
        lock_file: File that represents the work; its folder exists.
        log: Logger for the notice.
        doing: What the other process does, such as "prepares data/graphs/train".
        wait: Waits until the function that it is given returns that the lock is held, and may show the progress of the
            other process meanwhile; each call of that function takes at most a second. None waits silently.

    Raises:
        OSError: If the lock file cannot be written.
    """
    lock = FileLock(lock_file)

    def is_held() -> bool:
        with contextlib.suppress(Timeout):
            lock.acquire(timeout=1)
        return lock.is_locked

    try:
        lock.acquire(blocking=False)
    except Timeout:
        log.info("another process %s: waiting until it is done", doing)
        if wait is None:
            lock.acquire()
        else:
            wait(is_held)
    except OSError as error:
        if error.errno not in WITHOUT_LOCKS:
            raise
        log.warning(
            "files in %s cannot be locked (%s): see to it that no other process works there now",
            lock_file.parent,
            error.strerror,
        )
    try:
        yield
    finally:
        lock.release()
