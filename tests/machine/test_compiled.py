from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from sgbd.machine.compiled import compiled

numba = pytest.importorskip("numba")


def total(values: np.ndarray) -> float:
    result = 0.0
    for value in values:
        result += value
    return result


def test_bare_and_with_options_give_the_result_of_the_source():
    values = np.arange(5.0)
    assert compiled(total)(values) == compiled(fastmath=True)(total)(values) == total(values) == 10
    assert compiled(total).targetoptions["nogil"] is True
    assert compiled(nogil=False)(total).targetoptions["nogil"] is False


def test_that_loops_are_compiled_is_said_once_and_only_if_they_are(tmp_path):
    program = """
import logging, sys
logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)
import numba
import numpy as np
from sgbd.metrics.label_index import distinct_labels
numba.njit(lambda x: x + 1)(1)  # not ours
print("begun")
distinct_labels(np.array([[0, 1]], np.int32))
distinct_labels(np.array([[0, 1]]))
print("ended")
"""
    said = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True, text=True, check=True, env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
        )  # fmt: skip
        said.append(done.stdout.splitlines())
    assert said[0][0] == "begun"
    assert said[0][1].startswith("compiling loops, once on this machine")
    assert said[0][2:] == ["ended"]
    assert said[1] == ["begun", "ended"]


def test_without_a_writable_folder_it_compiles_in_memory(monkeypatch: pytest.MonkeyPatch):
    from numba.core.caching import CacheImpl

    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    with pytest.raises(RuntimeError, match="cannot cache function"):
        numba.njit(cache=True)(total)
    function = compiled(total)
    assert function(np.arange(4.0)) == 6
    assert function.signatures


def test_without_numba_the_source_runs_and_it_is_said_once():
    program = """
import sys
sys.modules["numba"] = None
import numpy as np
from sgbd.machine.compiled import HAS_NUMBA, compiled
from sgbd.metrics import ContingencyTable, boundary_scores, match_objects
from sgbd.partition import GreedyMulticut
assert not HAS_NUMBA
function = lambda x: x
assert compiled(function) is function and compiled(fastmath=True)(function) is function
truth = np.zeros((8, 9), dtype=int); truth[2:5, 3:7] = 2
table = ContingencyTable.from_label_maps(truth, truth)
assert boundary_scores(truth, truth, match_objects(table)).f_measure == 1
assert GreedyMulticut()(3, [[0, 1], [1, 2]], [0.9, 0.1], [5, 5]).tolist() == [0, 0, 1]
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("numba is not installed") == 1
