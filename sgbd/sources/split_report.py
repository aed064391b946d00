"""Write a zero-shot split to files: readable lists of frames, a report and `dataset` configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from omegaconf import OmegaConf

from sgbd.machine.atomic_file import write_whole
from sgbd.sources.tod import Tod
from sgbd.sources.zero_shot_split import POOLS, SETS, Catalog, ZeroShotSplit


def write_split(
    folder: Path,
    source: Tod,
    frames: Catalog,
    split: ZeroShotSplit,
    groups: Mapping[str, Sequence[str]],
    name: str,
) -> str:
    """Write `train.txt`, `val.txt`, `test_open.txt`, `test_closed.txt`, `report.md` and two dataset configurations.

    The configurations `dataset/NAME.yaml` (open test set) and `dataset/NAME_closed.yaml` are used with
    `--config-dir FOLDER dataset=NAME`.

    Args:
        folder: Output folder; created if needed.
        source: The dataset.
        frames: Catalogue of its frames.
        split: The split.
        groups: Category names by group.
        name: Name of the dataset configurations.

    Returns:
        The report as Markdown.
    """
    for key in SETS:
        lines = [f"# {key}: {len(split.sets[key])} frames of {source.root.resolve()}"]
        lines += [frames.files[index] for index in split.sets[key]]
        write_whole(folder / f"{key}.txt", ("\n".join(lines) + "\n").encode())
    for suffix, test in (("", "test_open"), ("_closed", "test_closed")):
        option = OmegaConf.to_yaml(OmegaConf.create(_dataset_option(folder, source, split, test)))
        heading = f"# {source.root.resolve()}, divided by python -m sgbd.split; its test frames are {test}.txt.\n"
        write_whole(folder / "dataset" / f"{name}{suffix}.yaml", (heading + option).encode())
    report = split_report(frames, split, groups)
    write_whole(folder / "report.md", report.encode())
    return report


def split_report(frames: Catalog, split: ZeroShotSplit, groups: Mapping[str, Sequence[str]]) -> str:
    """Describe the content of a split as Markdown."""
    names = list(frames.category_names)
    numbers = {key: frames.objects[split.sets[key]].sum(axis=0) for key in SETS}
    group_of = {name: group for group, members in groups.items() for name in members}
    table = pd.DataFrame(
        {
            "group": [group_of[name] for name in names],
            "": ["seen" if name in split.seen else "unseen" for name in names],
            **numbers,
        },
        index=pd.Index(names, name="objects of"),
    ).sort_values(["group", ""], kind="stable")
    sets = pd.DataFrame(
        {
            "frames": [len(split.sets[key]) for key in SETS],
            "of candidates": [split.candidates[key] for key in SETS],
            "scenes in its pool": [split.scenes[POOLS[key]] for key in SETS],
            "objects": [int(numbers[key].sum()) for key in SETS],
            "a category least": [_extreme(numbers[key], names, split, key, min) for key in SETS],
            "and most": [_extreme(numbers[key], names, split, key, max) for key in SETS],
        },
        index=pd.Index(SETS, name="set"),
    )
    seen_by_group = "\n".join(
        f"- {group}: seen {', '.join(n for n in members if n in split.seen) or 'none'}; "
        f"unseen {', '.join(n for n in members if n not in split.seen) or 'none'}"
        for group, members in groups.items()
    )
    left = split.left_out
    return (
        f"# Zero-shot split\n\n{len(split.seen)} of {len(names)} categories are seen:\n\n{seen_by_group}\n\n"
        f"{sets.to_markdown()}\n\n"
        f"Of {len(frames.files)} frames in {sum(split.scenes.values())} scenes, {frames.background_views} views of "
        f"background left out before: {left['near_empty']} are near-empty, {left['unknown_category']} show objects "
        f"without a category, {left['mixed_in_training']} show unseen categories in a scene for training or "
        f"validation.\n\n{table.to_markdown()}\n"
    )


def _dataset_option(folder: Path, source: Tod, split: ZeroShotSplit, test: str) -> dict[str, Any]:
    lists = {key: f"{key}.txt" for key in ("train", "val") if len(split.sets[key])}
    if len(split.sets[test]):
        lists["test"] = f"{test}.txt"
    camera = source.intrinsics
    return {
        "_target_": "sgbd.sources.Tod",
        "root": str(source.root.resolve()),
        "lists": {key: str((folder / name).resolve()) for key, name in lists.items()},
        "seen": [name for name in source.category_names if name in split.seen],
        "category_names": list(source.category_names),
        "intrinsics": camera and asdict(camera),
        "unseen_objects": "keep",
        "max_train_frames": None,
        "subset_seed": 0,
    }


def _extreme(number: np.ndarray, names: Sequence[str], split: ZeroShotSplit, key: str, extreme: Any) -> int:
    """Return the smallest or largest number of objects per category, over the categories allowed in a set."""
    return int(extreme(number[k] for k, name in enumerate(names) if key == "test_open" or name in split.seen))
