"""Parallel jobs in threads: compiled loops and matrix products, which release the interpreter lock."""

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
"""Maximum number of threads unless the user asks for more: there is little work to share beyond this."""

_most_threads = MOST_THREADS

_pools: dict[int, ThreadPoolExecutor] = {}
_lock = threading.Lock()
if hasattr(os, "register_at_fork"):
    # Threads do not survive a fork, so a child process starts its own. Holding the lock while forking keeps the pools
    # consistent.
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=lambda: _forget())


def thread_count(asked: int | None = None) -> int:
    """Return the number of threads to use: `asked` if given, otherwise one per usable processor, at most 2."""
    return asked or min(_most_threads, len(usable_processors()))


def limit_threads(most: int) -> None:
    """Lower the number of threads of this process, because several processes share the processors.

    Args:
        most: Maximum number of threads if the user asks for no number.
    """
    global _most_threads
    _most_threads = max(1, min(MOST_THREADS, most))


def bands(rows: int, count: int) -> list[tuple[int, int]]:
    """Divide rows into one band per thread: its first row, and the row after its last."""
    return list(pairwise([rows * k // count for k in range(count + 1)]))


def side_by_side(jobs: Sequence[Callable[[], Result]], threads: int) -> list[Result]:
    """Run jobs in parallel, in this thread and in helper threads.

    Helper threads stay alive for the next call, because starting a thread takes as long as a small job. This thread
    runs every job that no helper has started when its turn comes. So neither concurrent callers nor jobs that call this
    function themselves can wait for each other forever.

    Args:
        jobs: Functions without arguments that are independent of each other.
        threads: Maximum number of threads that run at the same time, including this one.

    Returns:
        Their results, in the order of the jobs.
    """
    if threads == 1 or len(jobs) < 2:
        return [job() for job in jobs]
    futures: list[Future[Result]] = [Future() for _ in jobs[1:]]
    try:
        # If no thread can be started, because the system's limit is reached or the main thread has ended, this thread
        # runs all remaining jobs.
        with contextlib.suppress(RuntimeError):
            pool = _helpers(min(threads, len(jobs)) - 1)
            for job, future in zip(jobs[1:], futures, strict=True):
                pool.submit(_do, job, future)
        results: list[Result | Future[Result]] = [jobs[0]()]
        for job, future in zip(jobs[1:], futures, strict=True):
            results.append(job() if future.cancel() else future)
    finally:
        # Wait for the helpers, also after an error: the caller may reuse the arrays that they write to.
        for future in futures:
            if not future.cancel():
                future.exception()
    return [result.result() if isinstance(result, Future) else result for result in results]


def _do(job: Callable[[], Result], future: Future[Result]) -> None:
    """Run a job unless it was cancelled, and store its result or error in the future."""
    if future.set_running_or_notify_cancel():
        try:
            future.set_result(job())
        except BaseException as error:
            future.set_exception(error)


def _helpers(count: int) -> ThreadPoolExecutor:
    """Return the pool of this many helper threads, created on first use."""
    with _lock:
        if count not in _pools:
            _pools[count] = ThreadPoolExecutor(count, "sgbd")
        return _pools[count]


def _forget() -> None:
    """Drop the pools in a forked child, whose threads do not exist, and release the lock."""
    _pools.clear()
    _lock.release()
