"""A cache of many graphs from one of few, for measuring what training on many costs."""

from __future__ import annotations

import json
from pathlib import Path

from sgbd.preparation import INDEX_FILE, RECIPE_FILE, graph_file_name, read_index


def repeat_graphs(cache: Path, split: str, count: int, folder: Path) -> Path:
    """Link the graphs of a split as often as it takes, under names of their own.

    To a program these are so many graphs: each has its entry in the index and its file, is read by itself, and takes
    its own memory. Only the disk holds the few that there are.

    Args:
        cache: Recipe folder of the graphs.
        split: Their split, complete.
        count: Graphs wanted.
        folder: An empty folder.

    Returns:
        A recipe folder like `cache`, with this split alone.
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
