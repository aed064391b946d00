"""python -m sgbd.train: from frames to a trained and evaluated model."""

from __future__ import annotations

import logging

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from sgbd.jobs.configuration import entry_point, output_folder
from sgbd.jobs.experiment import run_experiment
from sgbd.jobs.job import run_once
from sgbd.jobs.sweep import NotRun
from sgbd.machine.availability import NotAvailableError

log = logging.getLogger(__name__)


@entry_point("train")
def main(config: DictConfig) -> float | NotRun | None:
    """Train, or find the result of an identical earlier training, and print the scores."""
    folder = output_folder()
    try:
        result = run_once(folder, config, run_experiment)
    except NotAvailableError as error:
        if HydraConfig.get().mode != RunMode.MULTIRUN:
            raise
        log.warning("not run: %s", error)
        return NotRun(str(error))
    scores = result["scores"]
    if scores:
        print(f"\nScores on the test frames, per cent:\n\n{(folder / 'scores.md').read_text()}")
    print(f"Checkpoint, scores, curves and pictures: {folder}")
    return scores.get("hm/overlap_f", scores.get("all/overlap_f"))


if __name__ == "__main__":
    main()
