"""python -m sgbd.compare: trained models, classical baselines and other systems' label images on the same frames."""

from __future__ import annotations

from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from sgbd.benchmarking.cost import measure_costs
from sgbd.comparison import judge, load_methods, load_segmenters
from sgbd.comparison_results import write_failures, write_grids, write_scores
from sgbd.jobs.configuration import ConfigurationError, count_workers, entry_point, output_folder
from sgbd.jobs.pipeline import frame_source_of_split
from sgbd.machine.atomic_file import write_whole
from sgbd.sources import FrameSource

SECTIONS = ("scores", "failures", "pictures", "cost")


@entry_point("compare")
def main(config: DictConfig) -> None:
    """Run all methods on the same frames, and write the tables and pictures of the chosen sections."""
    sections = list(config.sections)
    unknown = [name for name in sections if name not in SECTIONS]
    if unknown or not sections:
        raise ConfigurationError(f"sections must be a list of {', '.join(SECTIONS)}; got {sections}")
    for key in ("pictures", "cost_frames", "cost_repeats"):
        if not isinstance(config[key], int) or config[key] < 1:
            raise ConfigurationError(f"{key} must be a number from 1; got {config[key]!r}")
    workers = count_workers(config.workers)
    source = frame_source_of_split(config.dataset, workers, config.split)
    out = output_folder()
    write_whole(out / "config.yaml", OmegaConf.to_yaml(config, resolve=True).encode())
    if "cost" in sections:
        _measure(config, source, out)
    if set(sections) != {"cost"}:
        judged = judge(config, source, workers)
        if "scores" in sections:
            print(f"\nPer cent:\n\n{write_scores(judged, out)}")
        if "failures" in sections:
            print(f"\nFailures by kind:\n\n{write_failures(judged, source, out, config.pictures)}")
        if "pictures" in sections:
            write_grids(judged, source, out, config.pictures)
    print(f"\nTables and pictures: {out}")


def _measure(config: DictConfig, source: FrameSource, out: Path) -> None:
    report = measure_costs(config, load_segmenters(config), load_methods(config), source)
    report.write(out / "cost.json", out / "cost.md")
    print(f"\n{report.markdown()}")


if __name__ == "__main__":
    main()
