"""Describe the machine and package versions, and limit the number of cores and threads."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import psutil
import torch

from sgbd.jobs.configuration import ConfigurationError
from sgbd.machine.processors import usable_processors

PACKAGES = ("sgbd", "numpy", "numba", "scipy", "scikit-image", "torch", "torch-geometric", "networkx")


def environment() -> dict[str, Any]:
    """Return processor, number of usable cores, load and versions as plain JSON values."""
    return {
        "cpu": cpu_name(),
        "cores": os.cpu_count(),
        "cores_used": len(usable_processors()),
        "torch_threads": torch.get_num_threads(),
        "memory_gib": round(psutil.virtual_memory().total / 2**30, 1),
        # A load above the number of cores means that other programs were running: trust ratios more than times.
        "load": round(psutil.getloadavg()[0], 2),
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": {package: _version(package) for package in PACKAGES},
    }


def cpu_name() -> str:
    """Return the processor name reported by the system."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


@contextmanager
def limited_to(threads: int | None, torch_threads: int) -> Iterator[None]:
    """Limit this process, and all threads and processes started within the context, to a number of cores.

    Args:
        threads: Number of cores; None for all that this process may use.
        torch_threads: Number of threads of PyTorch operations.

    Raises:
        ConfigurationError: If a number is out of range, or the system cannot bind processes to cores.
    """
    cores, torch_before = usable_processors(), torch.get_num_threads()
    if threads is not None and not 1 <= threads <= len(cores):
        raise ConfigurationError(f"threads must be from 1 to {len(cores)}, the cores of this process; got {threads}")
    if torch_threads < 1:
        raise ConfigurationError(f"torch_threads must be at least 1; got {torch_threads}")
    bound = threads is not None and threads < len(cores)
    if bound and not hasattr(os, "sched_setaffinity"):
        raise ConfigurationError("this system cannot bind a process to cores: leave threads at null")
    if bound:
        os.sched_setaffinity(0, cores[:threads])
    torch.set_num_threads(torch_threads)
    try:
        yield
    finally:
        torch.set_num_threads(torch_before)
        if bound:
            os.sched_setaffinity(0, cores)


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
