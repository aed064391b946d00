"""The sections of a benchmark."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig

from sgbd.benchmarking.checkpoints import configured_checkpoint, configured_segmenter
from sgbd.benchmarking.dataset import write_dataset
from sgbd.benchmarking.evaluation_speed import measure_evaluation
from sgbd.benchmarking.extent import Extent
from sgbd.benchmarking.frames import RawFrame, raw_frames
from sgbd.benchmarking.fresh_process import in_fresh_process, save_frames
from sgbd.benchmarking.methods import OURS, REFERENCE, SCIKIT_IMAGE, Method, make_method, with_option
from sgbd.benchmarking.preparation_speed import measure_preparation, prepare_frames
from sgbd.benchmarking.reference import STAGES as REFERENCE_STAGES
from sgbd.benchmarking.reference import Reference
from sgbd.benchmarking.report import Report
from sgbd.benchmarking.stages import measure_stages, stage_rows
from sgbd.benchmarking.timing import Ratio, Stopwatch, take_turns
from sgbd.benchmarking.training_speed import measure_training
from sgbd.jobs.configuration import ConfigurationError
from sgbd.jobs.untrained import trusted_packages
from sgbd.machine.progress_bar import ProgressBar
from sgbd.segmenter import Segmenter
from sgbd.sources import FrameSource

SCIKIT_IMAGE_SUPERPIXELS = "superpixels/slic_reference"

WIDTHS = (320, 480, 640, 960, 1280)
"""Frame widths on the curve of cost against image size; the aspect ratio is that of the given frames."""
NUMBERS = (32, 64, 128, 256, 512, 1024)
"""Numbers of superpixels requested on the curve of cost against n."""
DIVISORS = (64, 16, 4, 1)
"""The preparation curve has a point at each of these fractions of the frames."""
CURVE_COLUMNS = (
    "frames",
    "workers",
    "seconds",
    "seconds_to_first_graph",
    "frames_per_second_then",
    "worker_resident_mib",
    "worker_own_mib",
    "main_process_mib",
)
"""Columns of the preparation curve."""


@dataclass
class Benchmark:
    """Runs the sections of a benchmark and collects the results in a report.

    Attributes:
        config: Configuration with the keys of conf/benchmark.yaml.
        frames: The frames, all of the same size.
        extent: Numbers of repetitions, frames and graphs.
        numbers: Numbers of superpixels to request (n). The section `frame` and `compare` use all, others the first.
        report: The report to add results to.
    """

    config: DictConfig
    frames: Sequence[RawFrame]
    extent: Extent
    numbers: Sequence[int]
    report: Report
    _open: ExitStack = field(default_factory=ExitStack)
    _cache: tuple[FrameSource, Path] | None = None

    def __enter__(self) -> Benchmark:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    @property
    def size(self) -> str:
        """Size of the frames as text, for titles."""
        height, width = self.frames[0].depth.shape
        return f"{width}x{height}"

    def frame(self) -> None:
        """Time our pipeline from frame to objects, stage by stage, for each n."""
        rows = []
        for n in self.numbers:
            chosen = configured_segmenter(self.config, n)
            nodes, edges = [], []
            for raw in self.frames:
                found = chosen.segment(raw.rgb, raw.depth, raw.intrinsics)
                nodes.append(int(found.superpixels.max()) + 1)
                edges.append(found.edge_index.shape[1])
            stopwatch = measure_stages(chosen, list(self.frames), self._bar(self.extent.repeats, f"frame, n={n}"))
            graph = {"n": n, "nodes": round(median(nodes)), "edges": round(median(edges))}
            rows += [{**graph, **row} for row in stage_rows(stopwatch)]
        self.report.add("frame", f"Frame to segmentation, {self.size}; '-' marks parts, measured apart", rows)

    def reference(self) -> None:
        """Time the published algorithm and scikit-image's two SLIC calls, in turns with ours."""
        n, repeats = self.numbers[0], self.extent.reference_repeats
        stages = Stopwatch()
        reference = Reference.untrained(n)

        def by_reference(number: int) -> None:
            reference(self._raw(number).frame(), stages)

        turns = {name: self._on_frames(make_method(name, self.config, n)) for name in (OURS, SCIKIT_IMAGE)}
        turns[REFERENCE] = by_reference
        watched = take_turns(turns, self._bar(repeats, f"reference, n={n}"))
        # The first repetition was a warm-up.
        stages.seconds = {name: seconds[1:] for name, seconds in stages.seconds.items()}
        rows = [{"stage": name, **timing.row()} for name, timing in stages.timings().items()]
        rows.append({"stage": "sum of stages", **stages.sums(REFERENCE_STAGES).row()})
        self.report.add("reference_stages", f"The published algorithm re-stated, {self.size}, n={n}", rows)
        self._add_comparison("reference", watched, OURS, f"In turns, {self.size}, n={n}")

    def compare(self, first: str, second: str) -> None:
        """Time two methods in turns.

        Args:
            first: Name of a method; see `sgbd.benchmarking.methods.make_method`.
            second: Name of the other method.
        """
        if first == second:
            raise ConfigurationError(f"compare needs two different methods; got {first!r} twice")
        for n in self.numbers:
            methods = {name: make_method(name, self.config, n) for name in (first, second)}
            turns = {name: self._on_frames(method) for name, method in methods.items()}
            watched = take_turns(turns, self._bar(self.extent.repeats, f"compare, n={n}"), 2)
            self._add_comparison(f"compare_n{n}", watched, first, f"In turns, {self.size}, n={n}")

    def memory(self) -> None:
        """Measure the memory of fresh processes over many frames, for ours and for the reference."""
        self._in_fresh_process(OURS, 1)  # fills the compilation cache if needed
        rows = []
        for method, count in ((OURS, self.extent.memory_frames), (REFERENCE, max(2, self.extent.reference_repeats))):
            found = self._in_fresh_process(method, count, numba_apart=method == OURS)
            after, half = found["frame_mib"], len(found["frame_mib"]) // 2
            rows.append(
                {
                    "method": method,
                    "frames": count,
                    "imports_mib": found["imports_mib"],
                    "model_mib": found["model_mib"] - found["imports_mib"],
                    "numba_start_mib": found["numba_mib"] - found["model_mib"],
                    "first_frame_mib": after[0] - found["imports_mib"],
                    "steady_mib": median(after[half:]) - found["imports_mib"],
                    "peak_mib": None if found["peak_mib"] is None else found["peak_mib"] - found["imports_mib"],
                    "growth_kib_per_frame": 1024 * (after[-1] - after[half]) / max(1, len(after) - 1 - half),
                }
            )
        title = (
            "Resident memory of a fresh process; from the first frame on all that is beyond the imports, model and "
            f"Numba's start included, {self.size}, n={self.numbers[0]}"
        )
        self.report.add("memory", title, rows)

    def first_call(self) -> None:
        """Time the imports and the first frame of fresh processes, with a cold and a warm compilation cache."""
        compiled = self._folder("compiled")
        rows = []
        kinds = ["cold", *["warm"] * self.extent.start_repeats]
        for kind in ProgressBar(kinds, "first call", unit="process", leave=False, disable=not self.config.progress):
            found = self._in_fresh_process(OURS, 3, {"NUMBA_CACHE_DIR": str(compiled)})
            first, *later = found["frame_seconds"]
            rows.append(
                {
                    "cache": kind,
                    "imports_s": found["import_seconds"],
                    "imports_cpu_s": found["import_cpu_seconds"],
                    "model_s": found["load_seconds"],
                    "first_frame_s": first,
                    "first_frame_cpu_s": found["frame_cpu_seconds"][0],
                    "later_frame_s": min(later),
                    "first_call_s": found["import_seconds"] + found["load_seconds"] + first,
                    "process_s": found["process_seconds"],
                }
            )
        self.report.add("first_call", f"A fresh process, {self.size}, n={self.numbers[0]}", rows)

    def prepare(self) -> None:
        """Time the preparation of image files, with our superpixels and with those of scikit-image."""
        n, progress = self.numbers[0], self.config.progress
        source = self._files(self.extent.prepare_frames)
        chosen = configured_segmenter(self.config, n)
        counts = sorted({0, int(self.config.workers)})
        self._warm_up(chosen)
        rows = []
        for count in counts:
            row, cache = measure_preparation(source, chosen, count, self._folder("caches"), progress)
            rows.append(row)
            self._cache = source, cache
        # Fewer frames are enough here: scikit-image takes as long for them as we take for all.
        few = self._files(max(1, self.extent.prepare_frames // 8))
        other = with_option(self.config, SCIKIT_IMAGE_SUPERPIXELS)
        chosen = configured_segmenter(other, n, other.superpixels)
        self._warm_up(chosen)
        rows.append(measure_preparation(few, chosen, 0, self._folder("caches"), progress)[0])
        self.report.add("prepare", f"PNG files to cached graphs, {self.size}, n={n}", rows)

    def curve(self) -> None:
        """Time whole frames with increasing size and n, and the preparation of increasing numbers of frames."""
        n = self.numbers[0]
        height, width = self.frames[0].depth.shape
        rows = []
        for wide in WIDTHS:
            size = (wide, max(1, round(wide * height / width)))
            frames = raw_frames(self.config.frames, size, self.config.frame_count, self.config.seed)
            rows.append({"width": size[0], "height": size[1], **self._whole_frames(frames, n)})
        self.report.add("curve_size", f"A whole frame by its size, n={n}", rows)
        rows = [{"n": number, **self._whole_frames(self.frames, number)} for number in NUMBERS]
        self.report.add("curve_n", f"A whole frame by n, {self.size}", rows)
        chosen = configured_segmenter(self.config, n)
        rows = []
        self._warm_up(chosen)
        for divisor in DIVISORS:
            # Many frames fill a disk, so each cache is deleted before the next one is written.
            with tempfile.TemporaryDirectory(prefix="sgbd_benchmark_curve_") as folder:
                (Path(folder) / "files").mkdir()
                source = write_dataset(
                    self.frames, max(1, self.extent.prepare_frames // divisor), Path(folder) / "files"
                )
                row, _ = measure_preparation(
                    source, chosen, int(self.config.workers), Path(folder) / "caches", self.config.progress
                )
            rows.append({key: row[key] for key in CURVE_COLUMNS})
        self.report.add("curve_frames", f"Preparation of ever more frames, {self.size}, n={n}", rows)

    def _warm_up(self, segmenter: Segmenter) -> None:
        """Prepare one frame, so that everything is compiled."""
        prepare_frames(self._files(1), segmenter, 0, self._folder("caches"), self.config.progress)

    def _whole_frames(self, frames: Sequence[RawFrame], n: int) -> dict[str, float]:
        ours = make_method(OURS, self.config, n)
        watched = take_turns(
            {OURS: lambda number: ours(frames[number % len(frames)])},
            self._bar(self.extent.repeats, f"curve, n={n}"),
            2,
        )
        return watched.timings()[OURS].row()

    def train(self) -> None:
        """Time training on cached graphs."""
        source, cache = self._graphs()
        checkpoint = configured_checkpoint(self.config, self.numbers[0])
        row = measure_training(
            cache,
            source.split,
            checkpoint,
            instantiate(self.config.trainer),
            instantiate(self.config.sampler),
            self.extent.train_graphs,
            self.config.in_memory,
            self._folder("training"),
        )
        name = type(checkpoint.model).__name__
        self.report.add("train", f"Training of {name} on cached graphs, without validation", [row])

    def evaluate(self) -> None:
        """Time evaluation on cached graphs."""
        source, cache = self._graphs()
        chosen = configured_segmenter(self.config, self.numbers[0])
        rows = measure_evaluation(cache, source.split, chosen, self.extent.evaluate_repeats)
        self.report.add("evaluate", f"Evaluation of cached graphs, a frame of {self.size}, n={self.numbers[0]}", rows)

    def _add_comparison(self, name: str, watched: Stopwatch, base: str, title: str) -> None:
        rows = []
        for method, timing in watched.timings().items():
            ratio = Ratio.of(watched.seconds[method], watched.seconds[base])
            rows.append(
                {
                    "method": method,
                    **timing.row(),
                    "ratio": ratio.median,
                    "ratio_p10": ratio.p10,
                    "ratio_p90": ratio.p90,
                    "ratio_cpu": ratio.cpu,
                }
            )
        self.report.add(name, f"{title}; ratios of times to those of {base}", rows)

    def _in_fresh_process(
        self, method: str, count: int, environment: Mapping[str, str] | None = None, *, numba_apart: bool = False
    ) -> dict[str, Any]:
        folder = self._folder("fresh")
        frames, checkpoint = folder / "frames.npz", folder / "checkpoint.safetensors"
        save_frames(self.frames, frames)
        configured_checkpoint(self.config, self.numbers[0]).save(checkpoint)
        job = {
            "method": method,
            "frames": str(frames),
            "n": self.numbers[0],
            "count": count,
            "checkpoint": str(checkpoint),
            "trust": list(trusted_packages(self.config)),
            "reduce": self.config.reduce,
            "torch_threads": self.config.torch_threads,
            "numba_apart": numba_apart,
        }
        return in_fresh_process(job, environment)

    def _files(self, count: int) -> FrameSource:
        return write_dataset(self.frames, count, self._folder("files"))

    def _graphs(self) -> tuple[FrameSource, Path]:
        """Return cached graphs, from the section `prepare` or newly prepared."""
        if self._cache is None:
            source = self._files(self.extent.prepare_frames)
            chosen = configured_segmenter(self.config, self.numbers[0])
            self._cache = source, prepare_frames(source, chosen, 0, self._folder("caches"), self.config.progress)
        return self._cache

    def _on_frames(self, method: Method) -> Callable[[int], Any]:
        return lambda number: method(self._raw(number))

    def _raw(self, number: int) -> RawFrame:
        return self.frames[number % len(self.frames)]

    def _bar(self, repeats: int, title: str) -> ProgressBar:
        return ProgressBar(range(repeats), title, unit="turn", leave=False, disable=not self.config.progress)

    def _folder(self, name: str) -> Path:
        """Return an empty temporary folder, deleted at the end of the benchmark."""
        return Path(self._open.enter_context(tempfile.TemporaryDirectory(prefix=f"sgbd_benchmark_{name}_")))


SECTIONS: Mapping[str, Callable[[Benchmark], None]] = {
    "frame": Benchmark.frame,
    "reference": Benchmark.reference,
    "memory": Benchmark.memory,
    "first_call": Benchmark.first_call,
    "prepare": Benchmark.prepare,
    "curve": Benchmark.curve,
    "train": Benchmark.train,
    "evaluate": Benchmark.evaluate,
}
"""Valid values of `sections`, in the order of the report."""


def chosen_sections(names: Sequence[str]) -> list[str]:
    """Return the requested sections in the order of the report.

    Raises:
        ConfigurationError: If a section is unknown or none is given.
    """
    unknown = [name for name in names if name not in SECTIONS]
    if unknown or not names:
        given = f"got {', '.join(map(str, unknown))}" if unknown else "got none"
        raise ConfigurationError(f"sections must be a list of {', '.join(SECTIONS)}; {given}")
    return [name for name in SECTIONS if name in names]
