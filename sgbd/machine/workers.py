"""A function of an index, run over many indices in worker processes: in order, in bounded memory, with a clean stop."""

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
"""Set to 1 for workers: the processes already fill the cores, and more threads only fight each other."""

CHUNKS_IN_FLIGHT = 3
"""Chunks a worker may be ahead of the slowest one: enough to keep it busy, few enough to hold no pile of results."""


_starting = threading.RLock()
"""Held while processes are started: what they inherit meanwhile belongs to this whole process, not to a thread."""
_server_is_not_ours = False
"""Whether this process is a copy of one that had a server of processes, which serves that one only."""


def _note_fork() -> None:
    global _server_is_not_ours
    forkserver = sys.modules.get("multiprocessing.forkserver")
    _server_is_not_ours = forkserver is not None and forkserver._forkserver._forkserver_pid is not None
    _starting.release()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_starting.acquire, after_in_parent=_starting.release, after_in_child=_note_fork)


class WorkerError(RuntimeError):
    """Worker processes that cannot start, or that died: killed, or out of memory."""


def map_in_order(
    function: Callable[[int], Result], indices: Sequence[int], workers: int, chunk_size: int | None = None
) -> Generator[Result, None, None]:
    """Generate ``function(index)`` for every index, in the order of `indices`, whatever the number of workers.

    Workers are no copies of this process, so that no thread or lock of it is copied into them; each runs on one thread.
    Only a few results are held at a time. When the caller stops early (an exception, Ctrl-C, closing
    the generator), the workers finish the index at hand and end before this returns; when this process is killed, they
    end by themselves.

    Args:
        function: Called in the workers; it must be picklable unless `workers` is 0.
        indices: What to call it with.
        workers: Processes to use; 0 runs in this process.
        chunk_size: Indices handed to a worker at a time. None for up to 8: good for short work, where handing over
            costs; work of seconds wants 1, so that progress shows and no worker idles at the end.

    Yields:
        The results, one an index.

    Raises:
        WorkerError: If a worker died, if `function` cannot be sent to one, if `workers` is negative, if this process
            may not start others, or if a worker itself calls this while it imports the main script, which then lacks
            its guard.
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
    size = chunk_size or max(1, min(8, len(indices) // (4 * workers)))
    chunks = [indices[start : start + size] for start in range(0, len(indices), size)]
    modules = _modules_of(message)
    context = _start_method(modules)
    # Without a lock, which a worker that is killed could take with it.
    stop = context.RawValue(ctypes.c_bool, False)
    pool = ProcessPoolExecutor(workers, context, initializer=_start_worker, initargs=(message, stop, workers))
    # All processes start with the first task. One that is started while the pool ends because another died is waited
    # for without end (CPython 3.11 to 3.13).
    pool._safe_to_dynamically_spawn_children = False  # type: ignore[attr-defined]
    in_flight: deque[Future[list[Any]]] = deque()
    try:
        for chunk in chunks:
            # A task may start processes.
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
    """Return the modules that a pickled object names, `__main__` among them if its code is in the main script."""
    texts = dict.fromkeys(value for _, value, _ in pickletools.genops(message) if isinstance(value, str))
    return [text for text in texts if text in sys.modules]


def _start_method(modules: list[str]) -> BaseContext:
    """Return how to start processes: as copies of a server that has imported `modules`, or anew where none can be had.

    Imports take longer than some frames do, so a server that does them once for all workers of this process pays. It
    runs no threads, so to copy it is safe, which to copy this process would not be.
    """
    if _server_is_not_ours or "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    main = getattr(sys.modules["__main__"], "__spec__", None)
    if main is not None and "__main__" in modules:
        # Workers import the main module; what that imports is then there already.
        modules = [*modules, main.name]
    context.set_forkserver_preload([module for module in modules if module != "__main__"])
    return context


@contextlib.contextmanager
def pythons_start_method() -> Iterator[None]:
    """Let processes be started in a way of Python's own here.

    In a process of joblib, as jobs of Hydra's joblib launcher are, the usual way is joblib's. Processes that are
    started in another way would take it over and end, as it is unknown to them; PyTorch's readers of data fail with it.
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
    """Let processes that are started here inherit one thread each, and deafness to Ctrl-C, which is this process's.

    They import the main module only if they need it: that of a training holds PyTorch and much else that takes seconds
    and hundreds of MiB in each of them.
    """
    settings = dict.fromkeys(THREAD_COUNTS, "1")
    main = sys.modules["__main__"]
    spec = getattr(main, "__spec__", None)
    if spec is not None:
        # The server has imported the main module, and Python would warn in each worker that it is imported once more.
        settings["PYTHONWARNINGS"] = f"ignore:'{spec.name}' found in sys.modules:RuntimeWarning"
    before = {name: os.environ.get(name) for name in settings}
    os.environ.update(settings)
    # These two are where processes look for the main module that they import.
    hidden: dict[str, Any] = {name: vars(main)[name] for name in ("__spec__", "__file__") if name in vars(main)}
    if need_main:
        hidden = {}
    vars(main).update(dict.fromkeys(hidden))
    # Blocked rather than ignored, an interruption in between still reaches this process afterwards.
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
    global _function, _stop
    limit_threads(len(usable_processors()) // workers)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _function, _stop = pickle.loads(message), stop


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run_chunk(indices: Sequence[int]) -> list[Any]:
    results = []
    for index in indices:
        if _stop.value:
            break
        results.append(_function(index))
    return results
