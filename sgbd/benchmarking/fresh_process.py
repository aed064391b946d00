"""Measure in a fresh process: import time, time of the first frame, and memory over many frames.

``python -m sgbd.benchmarking.fresh_process JOB`` is this process: it starts measuring before importing anything else,
runs the job given as JSON, and prints the results as JSON. `in_fresh_process` starts it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

MEBIBYTE = 2**20

IMPORTS = ("numpy", "psutil", "torch", "sgbd.frame", "sgbd.segmenter")
IMPORTS_OF_METHOD = {"reference": ("sgbd.benchmarking.reference",), "baseline": ("hydra.utils", "sgbd.baselines")}
"""Modules whose import is timed before a method is loaded."""


def save_frames(frames: Sequence[Any], path: Path) -> None:
    """Write frames (`RawFrame`) to a file for a fresh process.

    Args:
        frames: The frames, all of the same size.
        path: The .npz file.
    """
    import numpy as np

    cameras = [
        [np.nan] * 4 if raw.intrinsics is None else [getattr(raw.intrinsics, key) for key in ("fx", "fy", "cx", "cy")]
        for raw in frames
    ]
    np.savez(path, rgb=[raw.rgb for raw in frames], depth=[raw.depth for raw in frames], cameras=cameras)


def in_fresh_process(
    job: Mapping[str, Any], environment: Mapping[str, str] | None = None, timeout: float = 600
) -> dict[str, Any]:
    """Run `do_job` in a fresh process.

    Args:
        job: The arguments of `do_job`.
        environment: Environment variables to set.
        timeout: Maximum run time, seconds.

    Returns:
        The result of `do_job`, and `process_seconds`, the run time of the whole process.

    Raises:
        RuntimeError: If the process fails; the message contains its error output.
    """
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "sgbd.benchmarking.fresh_process", json.dumps(dict(job))],
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    seconds = time.perf_counter() - started
    if done.returncode != 0:
        raise RuntimeError(f"the process that measures a fresh start failed:\n{done.stderr}")
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return {**result, "process_seconds": seconds}


def do_job(
    method: str,
    frames: str,
    n: int,
    count: int,
    checkpoint: str,
    trust: Sequence[str],
    torch_threads: int,
    baseline: Mapping[str, Any] | None = None,
    numba_apart: bool = False,
    reduce: int = 1,
) -> dict[str, Any]:
    """Import the package, load a method and segment frames, while measuring time and memory.

    Args:
        method: `ours`, `reference` or `baseline`.
        frames: File written by `save_frames`.
        n: Number of superpixels requested by the reference.
        count: Number of frames to segment, cycling through those in the file.
        checkpoint: Checkpoint file, for `ours`.
        trust: Packages whose classes the checkpoint may name.
        torch_threads: Number of threads of PyTorch operations.
        baseline: Configuration of a baseline (`sgbd.baselines`).
        numba_apart: Call a small compiled function before the first frame, to measure the start of Numba separately.
        reduce: Factor by which `ours` reduces the frames.

    Returns:
        Wall and processor time (seconds) of the imports and of each frame; seconds for loading the model; resident
        memory (MiB) after the imports, after loading the model, after the small compiled function and after each frame;
        and the peak memory (MiB).
    """
    start, start_cpu = time.perf_counter(), time.process_time()
    for module in (*IMPORTS, *IMPORTS_OF_METHOD.get(method, ())):
        import_module(module)
    imported, imported_cpu = time.perf_counter(), time.process_time()
    import numpy as np
    import psutil
    import torch

    from sgbd.frame import Intrinsics

    torch.set_num_threads(torch_threads)
    with np.load(frames) as arrays:
        rgb, depth, cameras = arrays["rgb"], arrays["depth"], arrays["cameras"]
    process = psutil.Process()

    def resident() -> float:
        return float(process.memory_info().rss / MEBIBYTE)

    loading, base = time.perf_counter(), resident()
    segment = _loaded(method, n, checkpoint, trust, reduce, baseline)
    loaded, with_model = time.perf_counter(), resident()
    if numba_apart:
        from sgbd.repaint import repaint

        repaint(np.zeros((1, 1), np.int32), np.zeros(1, np.int32))
    with_numba = resident()
    seconds, cpu_seconds, memory = [], [], []
    for number in range(count):
        place = number % len(rgb)
        begun, begun_cpu = time.perf_counter(), time.process_time()
        camera = None if np.isnan(cameras[place]).any() else Intrinsics(*cameras[place].tolist())
        segment(rgb[place], depth[place], camera)
        seconds.append(time.perf_counter() - begun)
        cpu_seconds.append(time.process_time() - begun_cpu)
        memory.append(resident())
    return {
        "import_seconds": imported - start,
        "import_cpu_seconds": imported_cpu - start_cpu,
        "load_seconds": loaded - loading,
        "frame_seconds": seconds,
        "frame_cpu_seconds": cpu_seconds,
        "imports_mib": base,
        "model_mib": with_model,
        "numba_mib": with_numba,
        "frame_mib": memory,
        "peak_mib": peak_memory(),
    }


def _loaded(
    method: str, n: int, checkpoint: str, trust: Sequence[str], reduce: int, baseline: Mapping[str, Any] | None
) -> Callable[..., Any]:
    """Load a method and return it as a function of a frame's colours, depth and camera."""
    if method == "ours":
        from sgbd.segmenter import Segmenter

        return Segmenter.load(checkpoint, trust=trust, reduce=reduce).segment
    from sgbd.frame import Frame

    chosen: Callable[[Frame], Any]
    if method == "reference":
        from sgbd.benchmarking.reference import Reference

        chosen = Reference.untrained(n)
    else:
        from hydra.utils import instantiate

        chosen = instantiate(baseline)
    return lambda rgb, depth, camera: chosen(Frame(rgb, depth, camera))


def peak_memory() -> float | None:
    """Return the peak memory of this process, MiB; None if the system does not report it."""
    status = Path("/proc/self/status")
    if status.is_file():
        # On Linux, a process inherits the peak reported by getrusage from its parent.
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / MEBIBYTE
    try:
        import resource
    except ImportError:
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / MEBIBYTE


if __name__ == "__main__":
    print(json.dumps(do_job(**json.loads(sys.argv[1]))))
