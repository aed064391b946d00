"""While one process works, a second one waits; on file systems without locks both log a warning."""

from __future__ import annotations

import errno
import logging
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock

from sgbd.machine.one_process_at_a_time import WITHOUT_LOCKS, one_process_at_a_time

log = logging.getLogger(__name__)


def test_another_one_waits_and_can_look_meanwhile(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    other = FileLock(tmp_path / "lock")
    other.acquire()
    looks: list[bool] = []

    def wait(is_held: Callable[[], bool]) -> None:
        looks.append(is_held())
        other.release()
        looks.append(is_held())

    with one_process_at_a_time(tmp_path / "lock", log, "works", wait):
        assert looks == [False, True]
        assert caplog.messages == ["another process works: waiting until it is done"]
        assert not _is_free(tmp_path / "lock")
    assert _is_free(tmp_path / "lock")


@pytest.mark.parametrize("number", WITHOUT_LOCKS)
def test_where_files_cannot_be_locked_the_work_is_done_and_a_warning_given(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    _fail_with(number, monkeypatch)
    with one_process_at_a_time(tmp_path / "lock", log, "works"):
        pass
    assert caplog.messages == [
        f"files in {tmp_path} cannot be locked ({os.strerror(number)}): see to it that no other process works there now"
    ]


def test_other_errors_are_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _fail_with(errno.EIO, monkeypatch)
    with pytest.raises(OSError, match=os.strerror(errno.EIO)), one_process_at_a_time(tmp_path / "lock", log, "works"):
        pass


def _is_free(path: Path) -> bool:
    lock = FileLock(path)
    try:
        lock.acquire(blocking=False)
    except TimeoutError:
        return False
    lock.release()
    return True


def _fail_with(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    fcntl = pytest.importorskip("fcntl")

    def flock(*arguments: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", flock)
