"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# One test process a core: more threads only fight each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")


# The first example of a test may compile a loop, and machines are noisy: no test is about time.
settings.register_profile("sgbd", deadline=None)
settings.load_profile("sgbd")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real frames and golden metric values that lies beside a development checkout."""
    folder = Path(os.environ.get("SGBD_SHARED_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real frames here: {folder} does not exist (set SGBD_SHARED_DATA to the folder)")
    return folder
