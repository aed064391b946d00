"""python -m sgbd.benchmark: measure speed and memory of segmentation, preparation and training."""

from __future__ import annotations

import dataclasses
import logging
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from sgbd.benchmarking.checkpoints import configured_checkpoint, number_of_superpixels
from sgbd.benchmarking.curves import draw_curves
from sgbd.benchmarking.environment import environment, limited_to
from sgbd.benchmarking.extent import configured_extent
from sgbd.benchmarking.frames import raw_frames
from sgbd.benchmarking.report import Report
from sgbd.benchmarking.sections import SECTIONS, Benchmark, chosen_sections
from sgbd.jobs.configuration import ConfigurationError, count_workers, entry_point, output_folder

log = logging.getLogger(__name__)


def run_benchmark(config: DictConfig) -> Report:
    """Run the configured measurements, printing each table as soon as it is complete.

    Args:
        config: A configuration with the keys of conf/benchmark.yaml.

    Returns:
        The report.

    Raises:
        ConfigurationError: If an option is invalid.
    """
    sections = chosen_sections(config.sections)
    extent = configured_extent(config)
    compare = config.compare
    if compare is not None and len(compare) != 2:
        raise ConfigurationError(f"compare must name two methods, for example [ours,reference]; got {list(compare)}")
    size = None if config.size is None else tuple(config.size)
    frames = raw_frames(config.frames, size, config.frame_count, config.seed)
    with limited_to(config.threads, config.torch_threads):
        settings: dict[str, Any] = OmegaConf.to_container(config, resolve=True)  # type: ignore[assignment]
        report = Report(environment(), {**settings, **dataclasses.asdict(extent)}, _notes(config, len(frames)))
        print(report.heading())
        with Benchmark(config, frames, extent, _numbers(config), report) as benchmark:
            if compare is not None:
                benchmark.compare(*compare)
                _print_from(report, 0)
                return report
            for name in sections:
                printed = len(report.tables)
                SECTIONS[name](benchmark)
                _print_from(report, printed)
    return report


def _numbers(config: DictConfig) -> list[int]:
    if config.n is None:
        return [number_of_superpixels(configured_checkpoint(config))]
    numbers = [config.n] if isinstance(config.n, int) else list(config.n)
    if not numbers or any(not isinstance(n, int) or n < 1 for n in numbers):
        raise ConfigurationError(f"n must be a number from 1, or a list such as [128,256,512]; got {config.n}")
    return numbers


def _notes(config: DictConfig, frames: int) -> list[str]:
    return [
        f"{frames} frames of {config.frames}" if config.frames else f"{frames} made-up scenes, seed {config.seed}",
        (
            f"weights of {config.checkpoint}"
            if config.checkpoint
            else "untrained weights, on which the time of a model does not depend"
        ),
    ]


def _print_from(report: Report, start: int) -> None:
    for table in report.tables[start:]:
        print(f"\n{table.markdown()}", flush=True)


@entry_point("benchmark")
def main(config: DictConfig) -> None:
    """Measure, print the tables and write them."""
    config.workers = count_workers(config.workers)
    report = run_benchmark(config)
    folder = output_folder()
    path = folder / "benchmark.json" if config.json is None else Path(config.json).expanduser()
    report.write(path, folder / "benchmark.md")
    if any(table.name == "curve_size" for table in report.tables):
        draw_curves(report, folder / "curves.png")
        print(f"\nCurves: {folder / 'curves.png'}")
    print(f"\nThe same as JSON: {path}\nand as Markdown: {folder / 'benchmark.md'}")


if __name__ == "__main__":
    main()
