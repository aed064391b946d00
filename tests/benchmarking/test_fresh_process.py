from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from sgbd.benchmarking.fresh_process import MEBIBYTE, peak_memory

SCRIPT = """
from sgbd.benchmarking.fresh_process import peak_memory
before = peak_memory()
held = bytearray(64 * 2**20)
held[::4096] = b"x" * len(held[::4096])
print(before, peak_memory())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere the system counts in another way")
def test_the_peak_is_the_process_s_own() -> None:
    held = np.ones(2**27)  # 1 GiB in this process must not appear in the fresh one
    found = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    before, after = map(float, found.stdout.split())
    assert 0 < before < held.nbytes / MEBIBYTE / 2
    assert 60 < after - before < 80
    mine = peak_memory()
    assert mine is not None
    assert mine > held.nbytes / MEBIBYTE
