"""Map a function of an index over many indices in worker processes: in order, in bounded memory, stopping cleanly."""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import pickle
import pickletools
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.context import BaseContext
from typing import Any, TypeVar

from sgbd.machine.processors import usable_processors
from sgbd.machine.side_by_side import limit_threads

Result = TypeVar("Result")

THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Environment variables set to 1 for workers: the processes already fill the cores, and more threads would compete."""

CHUNKS_IN_FLIGHT = 3
"""Number of chunks submitted per worker: enough to keep it busy, few enough that results don't pile up."""


_starting = threading.RLock()
"""Held while processes are started: what they inherit then is state of the whole process, not of one thread."""
_server_is_not_ours = False
"""Whether this process is a fork of one that had a fork server, which serves only the original process."""


def _note_fork() -> None:
    """In a forked child, note whether the parent had a fork server, and release the lock."""
    global _server_is_not_ours
    forkserver = sys.modules.get("multiprocessing.forkserver")
    _server_is_not_ours = forkserver is not None and forkserver._forkserver._forkserver_pid is not None
    _starting.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_starting.acquire, after_in_parent=_starting.release, after_in_child=_note_fork)


class WorkerError(RuntimeError):
    """Worker processes cannot start, or died: killed, or out of memory."""


def map_in_order(
    function: Callable[[int], Result], indices: Sequence[int], workers: int, chunk_size: int | None = None
) -> Generator[Result, None, None]:
    """Generate ``function(index)`` for every index, in the order of `indices`, whatever the number of workers.

    Workers are not forked from this process, so they inherit none of its threads and locks; each runs on one thread.
    Only a few results are held at a time. If the caller stops early (an exception, Ctrl-C, closing the generator), the
    workers finish their current index and end before this function returns. If this process is killed, they end by
    themselves.

    Args:
        function: Called in the workers; it must be picklable unless `workers` is 0.
        indices: The indices to call it with.
        workers: Number of processes; 0 runs in this process.
        chunk_size: Indices sent to a worker at a time. None for up to 8, which suits short calls, where sending costs.
            For calls that take seconds use 1, so that progress shows and no worker idles at the end.

    Yields:
        One result per index.

    Raises:
        WorkerError: If a worker died, if `function` cannot be sent to one, if `workers` is negative, if this process
            may not start others, or if a worker calls this function while it imports the main script, which then lacks
            its ``__main__`` guard.
        Exception: Whatever `function` raises.
    """
    if workers < 0:
        raise WorkerError(f"workers must be 0 (this process) or a number of processes; got {workers}")
    if workers == 0 or len(indices) == 0:
        return (function(index) for index in indices)
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise WorkerError(
            "worker processes import the main script, in which their work is defined, and this script starts worker "
            "processes when it is imported. Put its calls under \"if __name__ == '__main__':\", or use workers=0."
        )
    if multiprocessing.current_process().daemon:
        raise WorkerError(
            "this is a daemonic process, such as those of multiprocessing.Pool and of PyTorch's DataLoader, which may "
            "start no others. Use workers=0 in it."
        )
    try:
        message = pickle.dumps(function)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise WorkerError(
            f"this cannot be sent to worker processes: {error}. Define its functions and classes at the top level of a "
            "module, or use workers=0."
        ) from error
    return _map_in_processes(message, indices, min(workers, len(indices)), chunk_size)


def _map_in_processes(
    message: bytes, indices: Sequence[int], workers: int, chunk_size: int | None
) -> Generator[Any, None, None]:
    """Generate the results of a pickled function for all indices in worker processes; see `map_in_order`."""
    size = chunk_size or max(1, min(8, len(indices) // (4 * workers)))
    chunks = [indices[start : start + size] for start in range(0, len(indices), size)]
    modules = _modules_of(message)
    context = _start_method(modules)
    # Without a lock, because a killed worker might never release it.
    stop = context.RawValue(ctypes.c_bool, False)
    pool = ProcessPoolExecutor(workers, context, initializer=_start_worker, initargs=(message, stop, workers))
    # Start all processes with the first task: CPython 3.11 to 3.13 wait forever for a process that is started while
    # the pool ends because another one died.
    pool._safe_to_dynamically_spawn_children = False  # type: ignore[attr-defined]
    in_flight: deque[Future[list[Any]]] = deque()
    try:
        for chunk in chunks:
            # Submitting a task may start processes.
            with _starting, pythons_start_method(), _conditions_for_workers("__main__" in modules):
                in_flight.append(pool.submit(_run_chunk, chunk))
            if len(in_flight) > CHUNKS_IN_FLIGHT * workers:
                yield from in_flight.popleft().result()
        while in_flight:
            yield from in_flight.popleft().result()
    except BrokenProcessPool as error:
        raise WorkerError(
            "a worker process died: it was killed, ran out of memory, or could not start (its own message, if it left "
            "one, stands above). Use fewer workers, or workers=0 to see what happens."
        ) from error
    finally:
        stop.value = True
        pool.shutdown(wait=True, cancel_futures=True)


def _modules_of(message: bytes) -> list[str]:
    """Return the modules that a pickled object names, including `__main__` if its code is in the main script."""
    texts = dict.fromkeys(value for _, value, _ in pickletools.genops(message) if isinstance(value, str))
    return [text for text in texts if text in sys.modules]


def _start_method(modules: list[str]) -> BaseContext:
    """Return how to start processes: forked from a server that has imported `modules`, or spawned without one.

    Imports can take longer than processing a frame, so a server that imports once for all workers pays off. The server
    runs no threads, so forking it is safe, unlike forking this process.
    """
    if _server_is_not_ours or "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    main = getattr(sys.modules["__main__"], "__spec__", None)
    if main is not None and "__main__" in modules:
        # Workers import the main module; with the server its imports are already loaded.
        modules = [*modules, main.name]
    context.set_forkserver_preload([module for module in modules if module != "__main__"])
    return context


@contextlib.contextmanager
def pythons_start_method() -> Iterator[None]:
    """Use one of Python's own start methods for processes inside the context.

    In a process of joblib, such as a job of Hydra's joblib launcher, the default start method is joblib's. Processes
    started in another way would inherit it and end, because they do not know it; PyTorch's data-loading workers fail
    with it.
    """
    usual = multiprocessing.get_start_method(allow_none=True)
    foreign = usual is not None and usual not in multiprocessing.get_all_start_methods()
    if foreign:
        multiprocessing.set_start_method(None, force=True)
    try:
        yield
    finally:
        if foreign:
            multiprocessing.set_start_method(usual, force=True)


@contextlib.contextmanager
def _conditions_for_workers(need_main: bool) -> Iterator[None]:
    """Let processes that start inside the context inherit one thread each and a blocked Ctrl-C.

    Only this process handles Ctrl-C. The others import the main module only if they need it: that of a training imports
    PyTorch and much more, which takes seconds and hundreds of MiB in each process.
    """
    settings = dict.fromkeys(THREAD_COUNTS, "1")
    main = sys.modules["__main__"]
    spec = getattr(main, "__spec__", None)
    if spec is not None:
        # The server has already imported the main module; Python would warn about the second import in each worker.
        settings["PYTHONWARNINGS"] = f"ignore:'{spec.name}' found in sys.modules:RuntimeWarning"
    before = {name: os.environ.get(name) for name in settings}
    os.environ.update(settings)
    # Processes find the main module to import through these two attributes.
    hidden: dict[str, Any] = {name: vars(main)[name] for name in ("__spec__", "__file__") if name in vars(main)}
    if need_main:
        hidden = {}
    vars(main).update(dict.fromkeys(hidden))
    # Block the signal rather than ignore it, so that a Ctrl-C in between still reaches this process afterwards.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if hasattr(signal, "pthread_sigmask") else None
    try:
        yield
    finally:
        if mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        vars(main).update(hidden)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


_function: Callable[[int], Any]
_stop: ctypes.c_bool


def _start_worker(message: bytes, stop: ctypes.c_bool, workers: int) -> None:
    """Initialise a worker: limit its threads, ignore Ctrl-C, end with the parent, and unpickle the function."""
    global _function, _stop
    limit_threads(len(usable_processors()) // workers)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _function, _stop = pickle.loads(message), stop


def _end_with_parent() -> None:
    """Wait until the parent process ends, then end this one."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run_chunk(indices: Sequence[int]) -> list[Any]:
    """Call the function for each index, until the caller stops."""
    results = []
    for index in indices:
        if _stop.value:
            break
        results.append(_function(index))
    return results
