"""Small hand-written result folders of trainings, evaluations and sweeps."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from sgbd.frame import Frame
from sgbd.reporting.panels import write_index, write_panels
from tests.reporting.segmentations import halves
from tests.scenes import CATEGORIES, SEEN, scene

SCORES = {"hm/overlap_f": 0.5, "all/overlap_f": 0.625, "all/boundary_f": 0.25, "oracle/overlap_f": 0.9}


def write_run(
    folder: Path,
    frames: dict[str, float],
    *,
    history: bool = False,
    pictures: bool = False,
    dataset: str = "scenes",
    unseen_only: tuple[str, ...] = (),
) -> Path:
    """Write a run with the given frames and their overlap F; those in `unseen_only` show only bowls."""
    folder.mkdir(parents=True)
    (folder / "scores.json").write_text(json.dumps(SCORES))
    table = pd.DataFrame(
        {"overlap_f_measure": list(frames.values()), "unaided_overlap_f_measure": [v / 2 for v in frames.values()]},
        pd.Index(list(frames), name="name"),
    )
    table.to_csv(folder / "frames.csv")
    categories = {"overlap_f_measure": [0.5, 0.75, 0.25], "frames": [3, 2, 1], "seen": [c in SEEN for c in CATEGORIES]}
    pd.DataFrame(categories, pd.Index(CATEGORIES, name="category")).to_csv(folder / "categories.csv")
    (folder / "config.yaml").write_text(
        f"dataset:\n  _target_: sgbd.sources.Folder\n  name: '{dataset}'\nroot: ${{data_dir}}/x\n"
    )
    if history:
        epochs = {"epoch": [1, 2], "loss": [0.7, 0.4], "val/overlap_f": [0.5, 0.6]}
        pd.DataFrame(epochs).to_csv(folder / "history.csv", index=False)
        (folder / "result.json").write_text(json.dumps({"parameters": 102785, "best_epoch": 2, "seconds": 9.5}))
    if pictures:
        shown = []
        for number, name in enumerate(frames):
            made = scene(number)
            names = dict.fromkeys(made.categories, "bowl") if name in unseen_only else made.categories
            frame = Frame(made.rgb, made.depth, None, made.instances, names, name)
            shown.append(write_panels(frame, halves(frame, 0.5), SEEN, folder / "gallery", str(number)))
        write_index(shown, folder / "gallery")
    return folder


def write_sweep(folder: Path, settings: dict[str, str | None]) -> Path:
    """Write a sweep over `features` with two seeds each; a setting with a text has failed with this error."""
    records = folder / ".jobs"
    records.mkdir(parents=True)
    number = 0
    for value, error in settings.items():
        for seed in (0, 1):
            job = f"features={value}/seed={seed}"
            record = {
                "number": number,
                "overrides": {"features": value},
                "seed": seed,
                "folder": job,
                "state": "failed" if error else "finished",
                "error": error,
            }
            (records / f"{number:05d}.json").write_text(json.dumps(record))
            if not error:
                write_run(folder / job, {"a": 0.5, "b": 0.25}, history=True)
                scores = {name: score + 0.01 * number for name, score in SCORES.items()}
                (folder / job / "result.json").write_text(json.dumps({"scores": scores, "seconds": 3.0}))
            number += 1
    return folder
