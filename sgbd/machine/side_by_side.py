"""Jobs side by side in threads: compiled loops and matrix products, which release the interpreter lock."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

from sgbd.machine.processors import usable_processors

Result = TypeVar("Result")

MOST_THREADS = 2
"""Threads at the most unless the user asks for more: there is little to share beyond them."""

_most_threads = MOST_THREADS

_pools: dict[int, ThreadPoolExecutor] = {}
_lock = threading.Lock()
if hasattr(os, "register_at_fork"):
    # Threads do not survive a fork: a child starts its own. That the lock is held meanwhile keeps it whole.
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=lambda: _forget())


def thread_count(asked: int | None = None) -> int:
    """Return how many threads to work in; if the user asks for no number, one for each processor, at most 2."""
    return asked or min(_most_threads, len(usable_processors()))


def limit_threads(most: int) -> None:
    """Let this process work in fewer threads: it is one of several that share the processors.

    Args:
        most: Threads at the most where the user asks for no number.
    """
    global _most_threads
    _most_threads = max(1, min(MOST_THREADS, most))


def bands(rows: int, count: int) -> list[tuple[int, int]]:
    """Cut rows into a band for each thread: its first row, and the row after its last."""
    return list(pairwise([rows * k // count for k in range(count + 1)]))


def side_by_side(jobs: Sequence[Callable[[], Result]], threads: int) -> list[Result]:
    """Do jobs, in this thread and helping ones.

    The helpers wait for the next call when they are done, as starting a thread takes as long as a small job. A job that
    none of them has begun when this thread comes to it is done here, so that callers in several threads, and jobs that
    call this in turn, cannot wait for each other for ever.

    Args:
        jobs: Functions without arguments that are independent of each other.
        threads: How many may run at a time, this one included.

    Returns:
        Their results, in the order of the jobs.
    """
    if threads == 1 or len(jobs) < 2:
        return [job() for job in jobs]
    futures: list[Future[Result]] = [Future() for _ in jobs[1:]]
    try:
        # Where no thread can be started, as there are as many as the system allows or the main thread has ended, all
        # that is left is done here.
        with contextlib.suppress(RuntimeError):
            pool = _helpers(min(threads, len(jobs)) - 1)
            for job, future in zip(jobs[1:], futures, strict=True):
                pool.submit(_do, job, future)
        results: list[Result | Future[Result]] = [jobs[0]()]
        for job, future in zip(jobs[1:], futures, strict=True):
            results.append(job() if future.cancel() else future)
    finally:
        # After an error, too, nobody works on in arrays that the caller takes for its own again.
        for future in futures:
            if not future.cancel():
                future.exception()
    return [result.result() if isinstance(result, Future) else result for result in results]


def _do(job: Callable[[], Result], future: Future[Result]) -> None:
    """Do a job that nobody has begun or cancelled."""
    if future.set_running_or_notify_cancel():
        try:
            future.set_result(job())
        except BaseException as error:
            future.set_exception(error)


def _helpers(count: int) -> ThreadPoolExecutor:
    with _lock:
        if count not in _pools:
            _pools[count] = ThreadPoolExecutor(count, "sgbd")
        return _pools[count]


def _forget() -> None:
    _pools.clear()
    _lock.release()
