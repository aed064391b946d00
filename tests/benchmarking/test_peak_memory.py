from __future__ import annotations

import time

import numpy as np

from sgbd.benchmarking.fresh_process import MEBIBYTE
from sgbd.benchmarking.peak_memory import PeakMemory, this_process, worker_processes
from sgbd.machine.workers import map_in_order


def hold(mebibytes: int) -> int:
    """Hold memory long enough to be measured."""
    held = np.ones(mebibytes * MEBIBYTE, np.uint8)
    time.sleep(5 * PeakMemory.INTERVAL)
    return len(held)


def test_the_memory_of_workers_is_seen():
    with PeakMemory(worker_processes) as memory:
        assert list(map_in_order(hold, [150], workers=1)) == [150 * MEBIBYTE]
    assert memory.own_mib is not None
    assert memory.resident_mib is not None
    assert 150 <= memory.own_mib <= memory.resident_mib


def test_without_workers_there_is_nothing_to_see():
    with PeakMemory(worker_processes) as memory:
        assert list(map_in_order(hold, [1], workers=0)) == [MEBIBYTE]
    assert memory.own_mib is None
    assert memory.resident_mib is None


def test_the_memory_of_this_process_is_seen():
    with PeakMemory(this_process) as before:
        time.sleep(3 * PeakMemory.INTERVAL)
    with PeakMemory(this_process) as memory:
        assert hold(150) == 150 * MEBIBYTE
    assert memory.own_mib is not None
    assert before.own_mib is not None
    assert memory.own_mib >= before.own_mib + 140
