"""Simulate a large cache by repeating the graphs of a small one, to measure training on many graphs."""

from __future__ import annotations

import json
from pathlib import Path

from sgbd.preparation import INDEX_FILE, RECIPE_FILE, graph_file_name, read_index


def repeat_graphs(cache: Path, split: str, count: int, folder: Path) -> Path:
    """Create symbolic links to the graphs of a split, as many as requested, under different names.

    To a program, these are separate graphs: each has its own index entry and file, is read separately and takes its own
    memory. Only the disk space is shared.

    Args:
        cache: Recipe folder of the graphs.
        split: Split of the graphs; must be complete.
        count: Number of graphs to create.
        folder: An empty folder.

    Returns:
        A recipe folder like `cache`, with only this split.
    """
    index = read_index(cache / split)
    assert index is not None
    repeated = folder / cache.name
    (repeated / split).mkdir(parents=True)
    (repeated / RECIPE_FILE).write_bytes((cache / RECIPE_FILE).read_bytes())
    sources = [number % len(index["names"]) for number in range(count)]
    names = [f"{number:06d}" for number in range(count)]
    for name, source in zip(names, sources, strict=True):
        file = (cache / split / graph_file_name(index["names"][source])).absolute()
        (repeated / split / graph_file_name(name)).symlink_to(file)
    for key in ("bytes", "nodes", "edges"):
        index[key] = [index[key][source] for source in sources]
    index |= {"names": names, "statistics": {**index["statistics"], "graphs": count}}
    (repeated / split / INDEX_FILE).write_text(json.dumps(index), encoding="utf-8")
    return repeated
