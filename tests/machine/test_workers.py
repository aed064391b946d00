import contextlib
import itertools
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

import joblib
import pytest

from sgbd.machine import workers as module
from sgbd.machine.workers import WorkerError, map_in_order


def square(index: int) -> int:
    time.sleep(0.01 * (index % 3))  # so that later ones finish first
    return index * index


def environment(index: int) -> tuple[int, str | None, object]:
    return os.getpid(), os.environ.get("OMP_NUM_THREADS"), signal.getsignal(signal.SIGINT)


def fail_at_seven(index: int) -> int:
    if index == 7:
        raise KeyError("seven")
    return index


def die_at_seven(index: int) -> int:
    if index == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return index


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_results_come_in_order(workers: int) -> None:
    indices = list(range(40, 0, -1))
    assert list(map_in_order(square, indices, workers)) == [index * index for index in indices]


@pytest.mark.parametrize("chunk", [1, 7])
def test_results_come_in_order_whatever_is_handed_over_at_a_time(chunk: int) -> None:
    assert list(map_in_order(square, range(20), 2, chunk)) == [index * index for index in range(20)]


def test_no_indices() -> None:
    assert list(map_in_order(square, [], 2)) == []


def test_workers_run_on_one_thread_and_leave_interruption_to_the_parent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "5")
    handler = signal.getsignal(signal.SIGINT)
    results = set(map_in_order(environment, range(30), 2))
    assert {threads for _, threads, _ in results} == {"1"}
    assert {interrupt for _, _, interrupt in results} == {signal.SIG_IGN}
    assert os.getpid() not in {pid for pid, _, _ in results}
    assert os.environ["OMP_NUM_THREADS"] == "5"
    assert signal.getsignal(signal.SIGINT) is handler


@pytest.mark.parametrize("workers", [0, 2])
def test_an_exception_comes_through_after_the_results_before_it(workers: int) -> None:
    results = map_in_order(fail_at_seven, range(100), workers)
    # No result of a failing chunk is returned; with 100 indices and two workers, a chunk has 8 indices.
    assert list(itertools.islice(results, 7 if workers == 0 else 0)) == list(range(7 if workers == 0 else 0))
    with pytest.raises(KeyError, match="seven"):
        next(results)


def test_a_killed_worker_is_an_error_that_says_so() -> None:
    with pytest.raises(WorkerError, match="a worker process died"):
        list(map_in_order(die_at_seven, range(20), 1))


def test_a_pool_with_a_killed_worker_ends_however_often(tmp_path: Path) -> None:
    for _ in range(5):
        with pytest.raises(WorkerError, match="a worker process died"):
            list(map_in_order(die_at_seven, range(200), 3))


def test_closing_stops_early() -> None:
    results = map_in_order(square, range(100_000), 2)
    assert next(results) == 0
    start = time.monotonic()
    results.close()
    assert time.monotonic() - start < 300, "the workers went on with the other 99,999"


@pytest.mark.parametrize(
    ("function", "workers", "message"), [(lambda index: index, 1, "top level of a module"), (square, -1, "got -1")]
)
def test_bad_arguments(function: Callable[[int], int], workers: int, message: str) -> None:
    with pytest.raises(WorkerError, match=message):
        map_in_order(function, range(3), workers)


def test_a_daemonic_process_is_told_that_it_can_start_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)  # type: ignore[attr-defined]
    with pytest.raises(WorkerError, match=r"daemonic process.*Use workers=0"):
        map_in_order(square, range(3), 1)
    assert list(map_in_order(square, range(3), 0)) == [0, 1, 4]


class PoolWithoutProcesses:
    """Records whether two threads start processes at the same time."""

    both = threading.Barrier(2)
    together = False

    def __init__(self, *arguments: object, **options: object) -> None:
        pass

    def submit(self, function: object, chunk: range) -> Future[list[int]]:
        with contextlib.suppress(threading.BrokenBarrierError):
            self.both.wait(timeout=0.5)
            PoolWithoutProcesses.together = True
        future: Future[list[int]] = Future()
        future.set_result(list(chunk))
        return future

    def shutdown(self, **options: object) -> None:
        pass


def test_threads_start_processes_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Because the state that processes inherit is changed during the start and restored afterwards."""
    monkeypatch.setattr(module, "ProcessPoolExecutor", PoolWithoutProcesses)
    monkeypatch.setenv("OMP_NUM_THREADS", "5")
    # Set here, as the main module of a process of pytest-xdist has none.
    monkeypatch.setattr(sys.modules["__main__"], "__file__", "main.py", raising=False)
    threads = [threading.Thread(target=lambda: list(map_in_order(abs, range(1), 1))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not PoolWithoutProcesses.together
    assert os.environ["OMP_NUM_THREADS"] == "5"
    assert sys.modules["__main__"].__file__ == "main.py"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")
def test_a_copy_of_a_process_that_had_workers_can_have_some_too() -> None:
    assert list(map_in_order(square, range(3), 1)) == [0, 1, 4]
    child = os.fork()
    if child == 0:
        with contextlib.suppress(BaseException):
            os._exit(0 if list(map_in_order(square, range(3), 1)) == [0, 1, 4] else 1)
        os._exit(2)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert list(map_in_order(square, range(3), 1)) == [0, 1, 4]


def _run(folder: Path, script: str) -> subprocess.CompletedProcess[str]:
    (folder / "script.py").write_text(script)
    return subprocess.run(
        [sys.executable, folder / "script.py"], capture_output=True, text=True, timeout=300, check=False
    )


@pytest.mark.skipif(sys.platform == "win32", reason="runs a script as a POSIX process")
def test_a_script_without_guard_gets_advice_instead_of_hanging(tmp_path: Path) -> None:
    done = _run(
        tmp_path,
        "from sgbd.machine.workers import map_in_order\n"
        "def twice(index): return 2 * index\n"
        "print(list(map_in_order(twice, range(3), 1)))\n",
    )
    assert done.returncode != 0
    assert "if __name__ == '__main__':" in done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="runs a script as a POSIX process")
def test_workers_import_the_main_script_only_for_what_is_defined_in_it(tmp_path: Path) -> None:
    # Without a main guard: importing the script again would start workers again.
    done = _run(
        tmp_path, "from sgbd.machine.workers import map_in_order\nprint(list(map_in_order(abs, range(3), 1)))\n"
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "[0, 1, 2]\n"
    done = _run(
        tmp_path,
        "from sgbd.machine.workers import map_in_order\n"
        "def twice(index): return 2 * index\n"
        "if __name__ == '__main__': print(list(map_in_order(twice, range(3), 1)), __file__.endswith('script.py'))\n",
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "[0, 2, 4] True\n"


def squares_in_workers(count: int) -> tuple[list[int], str]:
    squares = list(map_in_order(square, range(count), 2))
    return squares, multiprocessing.get_start_method()


def test_processes_of_joblib_can_have_workers() -> None:
    """As jobs of Hydra's joblib launcher do when they prepare frames."""
    results = joblib.Parallel(n_jobs=2, backend="loky")(joblib.delayed(squares_in_workers)(count) for count in (3, 4))
    assert results == [([0, 1, 4], "loky"), ([0, 1, 4, 9], "loky")]
