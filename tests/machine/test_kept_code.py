from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sgbd.machine.compiled import compiled

numba = pytest.importorskip("numba")
IndexDataCacheFile = pytest.importorskip("numba.core.caching").IndexDataCacheFile
kept_code = pytest.importorskip("sgbd.machine.kept_code")
short_way = pytest.mark.skipif(not kept_code.CAN_SKIP, reason=f"not tried with Numba {numba.__version__}")

PROGRAM = """
import json, sys
import numpy as np
from sgbd.machine.compiled import compiled

@compiled
def doubled(values):
    result = np.empty_like(values)  # memory from Numba
    for k in range(len(values)):
        if values[k] < 0:
            raise ValueError("below zero")
        result[k] = np.log1p(values[k])
    return result

@compiled
def turned(values):
    return doubled(values)[::-1].copy()

def report(function, values):
    try:
        found = function(np.array(values)).tolist()
    except ValueError as error:
        found = str(error)
    read = sum(function.stats.cache_hits.values()) if hasattr(function, "stats") else 0
    return found, read, "numba.np.arraymath" in sys.modules

print(json.dumps([report(doubled, [0.0, 1.0]), report(doubled, [-1.0]), report(turned, [0.0, 1.0])]))
"""
LOG = [0.0, 0.6931471805599453]


def _run(path: Path, **environment: str) -> list[list[object]]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(path.parent / "cache"), **environment}
    done = subprocess.run([sys.executable, str(path)], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    result: list[list[object]] = json.loads(done.stdout)
    return result


@short_way
def test_what_is_kept_is_read_without_getting_ready_to_compile(tmp_path: Path):
    path = tmp_path / "program.py"
    path.write_text(PROGRAM)
    assert _run(path) == [[LOG, 0, True], ["below zero", 0, True], [LOG[::-1], 0, True]]
    assert _run(path) == [[LOG, 1, False], ["below zero", 1, False], [LOG[::-1], 1, False]]


@short_way
def test_what_is_not_kept_is_compiled_and_linked_to_what_is(tmp_path: Path):
    path = tmp_path / "program.py"
    path.write_text(PROGRAM)
    _run(path)
    for file in (tmp_path / "cache").rglob("*turned*"):
        file.unlink()
    assert _run(path) == [[LOG, 1, False], ["below zero", 1, False], [LOG[::-1], 0, True]]


def twice(value: int) -> int:
    return 2 * value


def use_of_kept_code(function: Callable[[int], int]) -> tuple[int, int]:
    """Compile a function or read what is kept of it, call it, and return the result and how often code was read."""
    dispatcher: Any = compiled(function)
    return dispatcher(3), sum(dispatcher.stats.cache_hits.values())


@short_way
@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("length", [0, 100])
def test_what_is_damaged_is_made_again(
    suffix: str, length: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    assert [use_of_kept_code(twice) for _ in range(2)] == [(6, 0), (6, 1)]
    (file,) = tmp_path.rglob(f"*.{suffix}")
    file.write_bytes(file.read_bytes()[:length])
    assert [use_of_kept_code(twice) for _ in range(2)] == [(6, 0), (6, 1)]


@short_way
def test_what_there_is_no_room_for_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    with monkeypatch.context() as full:

        def write(*arguments: object) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        full.setattr(IndexDataCacheFile, "_save_data", write)
        assert [use_of_kept_code(twice) for _ in range(2)] == [(6, 0), (6, 0)]
    assert not list(tmp_path.rglob("*.nb*"))
    assert [use_of_kept_code(twice) for _ in range(2)] == [(6, 0), (6, 1)]


CALLED = """
from sgbd.machine.compiled import compiled

FACTOR = 2

@compiled
def scaled(value):
    return {scaled}
"""
CALLING = """
import json
from sgbd.machine.compiled import compiled
from called import FACTOR, scaled

@compiled
def inner(value):
    return scaled(value)

@compiled
def outer(value):
    return inner(value) + 100 * FACTOR

print(json.dumps([outer(3), sum(outer.stats.cache_hits.values())]))
"""


@short_way
def test_a_change_in_the_file_of_a_called_function_or_constant_is_noticed(tmp_path: Path) -> None:
    path, called = tmp_path / "calling.py", tmp_path / "called.py"
    path.write_text(CALLING)
    called.write_text(CALLED.format(scaled="10 * value"))
    assert [_run(path) for _ in range(2)] == [[230, 0], [230, 1]]
    called.write_text(CALLED.format(scaled="value + 1"))
    assert [_run(path) for _ in range(2)] == [[204, 0], [204, 1]]
    called.write_text(CALLED.format(scaled="value + 1").replace("FACTOR = 2", "FACTOR = 3"))
    assert [_run(path) for _ in range(2)] == [[304, 0], [304, 1]]


def test_another_numba_reads_in_its_own_way(tmp_path: Path):
    path = tmp_path / "program.py"
    path.write_text("import sgbd.machine.kept_code\nsgbd.machine.kept_code.CAN_SKIP = False\n" + PROGRAM)
    _run(path)
    assert _run(path) == [[LOG, 1, True], ["below zero", 1, True], [LOG[::-1], 1, True]]


def test_nothing_is_kept_where_nothing_is_compiled(tmp_path: Path):
    path = tmp_path / "program.py"
    path.write_text(PROGRAM)
    results = _run(path, NUMBA_DISABLE_JIT="1")
    assert [result[:2] for result in results] == [[LOG, 0], ["below zero", 0], [LOG[::-1], 0]]
    assert not (tmp_path / "cache").exists()
