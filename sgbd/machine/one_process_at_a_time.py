"""Work in a folder that several processes may be asked for, and one may do."""

from __future__ import annotations

import contextlib
import errno
import logging
from collections.abc import Callable, Iterator
from pathlib import Path

from filelock import FileLock, Timeout

WITHOUT_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP)
"""How file systems that cannot lock files say so, some network shares among them."""


@contextlib.contextmanager
def one_process_at_a_time(
    lock_file: Path,
    log: logging.Logger,
    doing: str,
    wait: Callable[[Callable[[], bool]], None] | None = None,
) -> Iterator[None]:
    """Hold a lock between processes; while another one has it, say so and wait.

    The system releases the lock when its holder dies, however that happens. Where files cannot be locked, the work is
    done without, and a warning says so.

    Args:
        lock_file: File that stands for the work; its folder exists.
        log: Where the notice goes.
        doing: What the other process does, such as "prepares data/graphs/train".
        wait: Waits, and shows how far the other process is, until the function that it is given says that the lock is
            held; each call of that takes a second at the most. None waits without a word.

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
