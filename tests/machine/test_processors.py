import os

import pytest

from sgbd.machine.processors import usable_processors


def test_there_is_one_at_least() -> None:
    assert usable_processors() == sorted(set(usable_processors()))
    assert len(usable_processors()) >= 1


def test_systems_that_cannot_tell_count_the_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 3)
    assert usable_processors() == [0, 1, 2]
