"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# One thread per process: tests run in one process per core.
os.environ.setdefault("OMP_NUM_THREADS", "1")


# No deadline: the first example of a test may trigger compilation, and machines are noisy.
settings.register_profile("sgbd", deadline=None)
settings.load_profile("sgbd")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real frames and golden metric values next to a development checkout."""
    folder = Path(os.environ.get("SGBD_SHARED_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real frames here: {folder} does not exist (set SGBD_SHARED_DATA to the folder)")
    return folder
