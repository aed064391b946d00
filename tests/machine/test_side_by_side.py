import os
import subprocess
import sys
import threading
from functools import partial

import pytest

from sgbd.machine import side_by_side as module
from sgbd.machine.processors import usable_processors
from sgbd.machine.side_by_side import MOST_THREADS, bands, limit_threads, side_by_side, thread_count


def test_bands_cover_all_rows_once() -> None:
    assert bands(10, 3) == [(0, 3), (3, 6), (6, 10)]
    assert bands(1, 2) == [(0, 0), (0, 1)]
    assert bands(0, 2) == [(0, 0), (0, 0)]


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_results_come_in_the_order_of_the_jobs(threads: int) -> None:
    assert side_by_side([lambda k=k: k * k for k in range(20)], threads) == [k * k for k in range(20)]
    assert side_by_side([], threads) == []


def test_two_jobs_run_at_a_time() -> None:
    met = threading.Barrier(2, timeout=30)
    assert sorted(side_by_side([met.wait, met.wait], 2)) == [0, 1]


def test_no_more_jobs_run_at_a_time_than_allowed() -> None:
    lock, running, most = threading.Lock(), 0, 0

    def job() -> None:
        nonlocal running, most
        with lock:
            running += 1
            most = max(most, running)
        threading.Event().wait(0.002)
        with lock:
            running -= 1

    side_by_side([job] * 20, 3)
    assert most <= 3


def test_jobs_may_call_it_in_turn() -> None:
    def job() -> list[int]:
        return side_by_side([lambda: 1, lambda: 2, lambda: 3], 2)

    assert side_by_side([job] * 6, 2) == [[1, 2, 3]] * 6


def test_an_error_is_raised_when_no_job_runs_any_more() -> None:
    begun, ended = threading.Event(), threading.Event()

    def slow() -> None:
        begun.set()
        threading.Event().wait(0.05)
        ended.set()

    def fails() -> None:
        begun.wait(30)
        raise KeyError("lost")

    with pytest.raises(KeyError, match="lost"):
        side_by_side([fails, slow], 2)
    assert ended.is_set()
    with pytest.raises(KeyError, match="lost"):
        side_by_side([int, fails], 2)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*:DeprecationWarning")
def test_a_forked_process_starts_threads_of_its_own() -> None:
    side_by_side([int, int], 2)
    child = os.fork()
    if child == 0:
        os._exit(0 if side_by_side([lambda: 1, lambda: 2], 2) == [1, 2] else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_where_no_thread_can_be_started_all_is_done_here_and_once(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[int] = []

    def start(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(module, "_pools", {})
    with monkeypatch.context() as limited:
        limited.setattr(threading.Thread, "start", start)
        side_by_side([partial(done.append, number) for number in range(4)], 2)
    assert done == [0, 1, 2, 3]
    # Work that could not be started then is not started later.
    side_by_side([partial(done.append, 4), partial(done.append, 5)], 2)
    assert sorted(done) == [0, 1, 2, 3, 4, 5]


@pytest.mark.skipif(sys.platform == "win32", reason="runs a script as a POSIX process")
def test_a_thread_works_on_when_the_main_thread_has_ended() -> None:
    script = """
import threading
from sgbd.machine.side_by_side import side_by_side
def work():
    threading.main_thread().join()
    print(side_by_side([lambda: 1, lambda: 2, lambda: 3], 2))
print(side_by_side([lambda: 4, lambda: 5], 2))
threading.Thread(target=work).start()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert (done.stdout, done.stderr) == ("[4, 5]\n[1, 2, 3]\n", "")


def test_threads_are_as_many_as_processors_and_two_at_the_most() -> None:
    assert thread_count() == min(MOST_THREADS, len(usable_processors()))
    assert thread_count(7) == 7


def test_a_process_among_others_works_in_fewer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_most_threads", MOST_THREADS)
    limit_threads(0)
    assert thread_count() == 1
    assert thread_count(2) == 2
    limit_threads(100)
    assert thread_count() == min(MOST_THREADS, len(usable_processors()))
