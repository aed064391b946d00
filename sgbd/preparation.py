"""Preparation of graphs: converts the frames of a split to graph files, in parallel, resumable, and never stale.

Layout of a cache::

    <root>/<dataset>-<hash of the recipe>/recipe.json     what the graphs were made with (`sgbd.recipe`)
                                         /<split>.lock    held while the split is prepared
                                         /<split>/<name>.safetensors    one graph per frame (`sgbd.graph_file`)
                                         /<split>/index.json            written last: the split is complete

A cache is never stale, because a different dataset, configuration or code gives a different hash and thus a different
folder. Within a folder, the index stores the fingerprint of all frames of its split (names, sizes and modification
times of their files), and every graph stores the fingerprint of its own frame. If the fingerprint in the index still
matches, nothing is done. Otherwise the index is removed, and the graphs of changed frames are built again. Graphs and
index are replaced atomically: a process that is killed at any moment leaves only complete graphs behind, and the next
run builds the missing ones. Graphs of removed frames stay in the folder, in case the frames come back, but only graphs
listed in the index are used.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from sgbd.adjacency import LabelMap
from sgbd.features import EDGE_NAMES, NODE_NAMES
from sgbd.frame import Frame
from sgbd.graph import array_builder
from sgbd.graph_arrays import GraphArrays
from sgbd.graph_file import (
    FORMAT_VERSION,
    SUFFIX,
    GraphFileError,
    GraphSummary,
    cannot_write,
    read_summary,
    write_graph,
)
from sgbd.machine.atomic_file import write_whole
from sgbd.machine.one_process_at_a_time import one_process_at_a_time
from sgbd.machine.progress_bar import ProgressBar
from sgbd.machine.workers import WorkerError, map_in_order
from sgbd.own_columns import own_columns
from sgbd.recipe import Recipe, folder_name, graph_recipe
from sgbd.sources.source import FrameSource

if TYPE_CHECKING:
    from torch_geometric.data import Data

log = logging.getLogger(__name__)

RECIPE_FILE = "recipe.json"
INDEX_FILE = "index.json"
INDEX_KEYS = ("fingerprint", "category_names", "seen", "statistics", "skipped", "names", "bytes")

FRAMES_PER_WORKER = 8
"""Minimum number of frames per worker process; with fewer frames, fewer workers are started."""
LINES_OF_REPORT = 20
"""Number of skipped frames that the report lists; the index lists all."""


class PreparationError(RuntimeError):
    """Raised if graphs cannot be prepared; the message says why and what to do."""


@dataclass(frozen=True)
class _Outcome:
    """The result of processing one frame: a summary of its graph, or the reason why it failed."""

    index: int
    summary: GraphSummary | None = None
    failure: str | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class _FrameToGraphFile:
    """The task of a worker: build the graph of frame `index` of the source and write its file."""

    source: FrameSource
    superpixels: Callable[[Any], Any]
    graph: Callable[..., Data]
    folder: Path

    def __call__(self, index: int) -> _Outcome:
        name = self.source.names[index]
        try:
            start = time.perf_counter()
            # Taken before reading: if the files change meanwhile, the next run notices.
            made_from = frame_fingerprint(self.source, index)
            frame = self.source[index]
            read = time.perf_counter()
            label_map = self.superpixels(frame)
            segmented = time.perf_counter()
            graph = self._build(frame, label_map)
            built = time.perf_counter()
        except MemoryError:
            raise
        except Exception as error:
            log.debug("frame %s", name, exc_info=True)
            return _Outcome(index, failure=f"{type(error).__name__}: {error}")
        _check_columns(graph, own_columns(self.graph))
        graph["name"] = name
        summary = write_graph(self.folder / graph_file_name(name), graph, made_from)
        seconds = {
            "read": read - start,
            "superpixels": segmented - read,
            "graph": built - segmented,
            "write": time.perf_counter() - built,
        }
        return _Outcome(index, summary, seconds=seconds)

    def _build(self, frame: Frame, label_map: LabelMap) -> Data | GraphArrays:
        # The builders of this package need neither PyTorch nor PyG, so workers do not load these.
        build = array_builder(self.graph) or self.graph
        return build(frame, label_map, category_names=self.source.category_names)


def prepare(
    source: FrameSource,
    superpixels: Callable[[Any], Any],
    graph: Callable[..., Data],
    root: str | Path,
    *,
    workers: int = 0,
    on_error: Literal["skip", "fail"] = "skip",
    progress: bool = True,
) -> Path:
    """Build the graphs of one split that are missing or whose frames changed.

    The graphs are identical, byte for byte, for any number of workers. Two processes may prepare the same split at the
    same time: the second one waits and finds the finished graphs. After an interruption, the next run continues.

    Args:
        source: The frames of the split.
        superpixels: Maps a frame to a label map int32 [H, W] with ids 0..N-1. So that the recipe can record it, it must
            be a function, a partial of a function, or an object that stores its constructor's arguments as attributes
            of the same names.
        graph: Called as ``graph(frame, label_map, category_names=...)``, such as `sgbd.graph.GraphBuilder`; recorded in
            the same way.
        root: Folder of all caches; created if missing.
        workers: Number of worker processes; 0 does all work in this process.
        on_error: What to do if a frame cannot be read, over-segmented or made into a graph: `skip` it, list it in the
            report and the index, and try it again next time; or `fail` on the first one.
        progress: Whether to show a progress bar.

    Returns:
        The recipe folder: the `root` of `sgbd.data.SuperpixelGraphDataset`.

    Raises:
        PreparationError: If a frame fails and `on_error` is `fail`, if every frame fails, if the split is empty, if
            its names are not valid file names, or if the cache cannot be written.
        GraphFileError: If a graph cannot be written, for example because the disk is full.
        RecipeError: If the recipe cannot record a component.
        WorkerError: If a worker process dies.
    """
    if on_error not in ("skip", "fail"):
        raise PreparationError(f"on_error must be 'skip' or 'fail'; got {on_error!r}")
    if not source.split or "/" in source.split or source.split.startswith("."):
        raise PreparationError(f"a split needs a name that can be a folder; got {source.split!r}")
    recipe = graph_recipe(source, superpixels, graph)
    folder = Path(root).expanduser() / folder_name(recipe)
    split = folder / source.split
    fingerprint = source.fingerprint()
    if _is_complete(split, fingerprint):
        log.info("%s of %s is prepared already: %s", source.split, recipe["dataset"]["name"], split)
        return folder
    # Checked only now, because a source may have to look at every frame to find the names.
    _check_names(source)
    with contextlib.ExitStack() as stack:
        try:
            split.mkdir(parents=True, exist_ok=True)
            wait = partial(_wait_for_another, split, len(source), progress)
            stack.enter_context(one_process_at_a_time(folder / f"{source.split}.lock", log, f"prepares {split}", wait))
        except OSError as error:
            raise PreparationError(cannot_write(split, error)) from error
        # Another process may have finished the split while this one waited.
        if not _is_complete(split, fingerprint):
            _write_recipe(folder, recipe)
            work = _FrameToGraphFile(source, superpixels, graph, split)
            _prepare_split(work, fingerprint, workers, on_error, progress)
    return folder


def graph_file_name(name: str) -> str:
    """Return the file name of a frame's graph: the frame's name with `/` replaced by `__`, and the suffix."""
    return name.replace("/", "__") + SUFFIX


def frame_fingerprint(source: FrameSource, index: int) -> str:
    """Return a digest (16 hexadecimal digits) of a frame's name and its files' sizes and modification times."""
    stats: list[Any] = []
    for path in source.files(index):
        with contextlib.suppress(OSError):  # a missing file is reported when the frame is read
            status = path.stat()
            stats.append([status.st_size, status.st_mtime_ns])
    return hashlib.sha256(json.dumps([source.names[index], stats]).encode()).hexdigest()[:16]


def read_index(split: Path) -> dict[str, Any] | None:
    """Return the index of a prepared split, or None if it is missing or damaged."""
    try:
        index = json.loads((split / INDEX_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return index if isinstance(index, dict) and set(INDEX_KEYS) <= set(index) else None


def _prepare_split(work: _FrameToGraphFile, fingerprint: str, workers: int, on_error: str, progress: bool) -> None:
    """Build the graphs that are missing or out of date, then write the index, which marks the split as complete."""
    source, split = work.source, work.folder
    before = read_index(split)
    if before is not None and before["fingerprint"] != fingerprint:
        log.info("the frames of %s changed: the graphs of those that did are made anew", split)
        (split / INDEX_FILE).unlink()
    summaries = _kept_graphs(source, split, progress)
    kept = sum(summary is not None for summary in summaries)
    started = time.perf_counter()
    failures, seconds = _make_graphs(work, summaries, workers, on_error, progress)
    if len(failures) == len(source):
        raise PreparationError(
            f"every frame of {source.split} failed, so there is nothing to train or evaluate on:\n"
            + _list_of_failures(source, failures)
        )
    made = len(source) - kept - len(failures)
    if made:
        seconds_per_frame = {stage: total / made for stage, total in seconds.items()}
    else:
        seconds_per_frame = {} if before is None else before["statistics"]["seconds_per_frame"]
    index = _index(source, fingerprint, summaries, failures, seconds_per_frame)
    _write(split / INDEX_FILE, json.dumps(index).encode())
    log.info(
        "%s: %d graphs made in %.1f s, %d kept, %d skipped; %.0f nodes and %.0f edges a graph, %.0f KiB each, in %s",
        source.split,
        made,
        time.perf_counter() - started,
        kept,
        len(failures),
        index["statistics"]["nodes_per_graph"],
        index["statistics"]["edges_per_graph"],
        index["statistics"]["bytes_per_graph"] / 1024,
        split,
    )
    if failures:
        log.warning(
            "%d of %d frames of %s were skipped; the next preparation tries them again:\n%s",
            len(failures),
            len(source),
            source.split,
            _list_of_failures(source, failures),
        )


def _make_graphs(
    work: _FrameToGraphFile, summaries: list[GraphSummary | None], workers: int, on_error: str, progress: bool
) -> tuple[dict[int, str], dict[str, float]]:
    """Build the graphs that have no summary yet, and fill in their summaries.

    Returns:
        The reason of failure by frame index, and the total seconds of each stage.
    """
    failures: dict[int, str] = {}
    seconds: dict[str, float] = {}
    for outcome in _outcomes(work, summaries, workers, progress):
        if outcome.failure is None:
            for stage, duration in outcome.seconds.items():
                seconds[stage] = seconds.get(stage, 0.0) + duration
            continue
        failures[outcome.index] = outcome.failure
        if on_error == "fail":
            source = work.source
            raise PreparationError(
                f"frame {source.names[outcome.index]} of {source.split} failed ({outcome.failure}). Mend or remove it, "
                "or use on_error=skip to leave such frames out. What is prepared is kept."
            )
    return failures, seconds


def _outcomes(
    work: _FrameToGraphFile, summaries: list[GraphSummary | None], workers: int, progress: bool
) -> Iterator[_Outcome]:
    """Build the graphs that have no summary yet, fill in their summaries, and yield the outcome of each frame."""
    pending = [index for index, summary in enumerate(summaries) if summary is None]
    # Starting a process takes as long as processing a few frames.
    workers = min(workers, len(pending) // FRAMES_PER_WORKER)
    skipped = 0
    try:
        with (
            ProgressBar(
                total=len(summaries),
                initial=len(summaries) - len(pending),
                desc=f"graphs of {work.source.split}",
                unit="frame",
                disable=not progress,
                mininterval=0.5,
            ) as bar,
            contextlib.closing(map_in_order(work, pending, workers)) as outcomes,
        ):
            for outcome in outcomes:
                summaries[outcome.index] = outcome.summary
                bar.update()
                if outcome.failure is not None:
                    skipped += 1
                    bar.set_postfix(skipped=skipped)
                yield outcome
    except (KeyboardInterrupt, WorkerError) as error:
        done = sum(summary is not None for summary in summaries)
        told = (
            f"{done} of {len(summaries)} graphs of {work.source.split} are prepared and kept; "
            "run the same command again to go on"
        )
        if isinstance(error, WorkerError):
            raise WorkerError(f"{error} {told}.") from error
        log.warning("interrupted: %s", told)
        raise


def _index(
    source: FrameSource,
    fingerprint: str,
    summaries: Sequence[GraphSummary | None],
    failures: Mapping[int, str],
    seconds_per_frame: Mapping[str, float],
) -> dict[str, Any]:
    names = source.names
    present = [(names[index], summary) for index, summary in enumerate(summaries) if summary is not None]
    merges, cuts = (sum(getattr(summary, key) for _, summary in present) for key in ("merges", "cuts"))
    nodes, edges = ([getattr(summary, key) for _, summary in present] for key in ("nodes", "edges"))
    return {
        "format_version": FORMAT_VERSION,
        "split": source.split,
        "fingerprint": fingerprint,
        "category_names": list(source.category_names),
        "seen": sorted(source.seen),
        "statistics": {
            "graphs": len(present),
            "nodes_per_graph": sum(nodes) / len(present),
            "edges_per_graph": sum(edges) / len(present),
            "merge_share": merges / (merges + cuts) if merges + cuts else None,
            "bytes_per_graph": sum(summary.bytes for _, summary in present) / len(present),
            "seconds_per_frame": seconds_per_frame,
        },
        "skipped": [{"name": names[index], "reason": reason} for index, reason in sorted(failures.items())],
        "names": [name for name, _ in present],
        "bytes": [summary.bytes for _, summary in present],
        "nodes": nodes,
        "edges": edges,
    }


def _is_complete(split: Path, fingerprint: str) -> bool:
    """Return whether a split is complete: frames unchanged, no graph missing or truncated, none to retry."""
    index = read_index(split)
    if (
        index is None
        or index.get("format_version") != FORMAT_VERSION
        or index.get("fingerprint") != fingerprint
        or index.get("skipped")
        or not (split.parent / RECIPE_FILE).is_file()
    ):
        return False
    sizes = {entry.name: entry.stat().st_size for entry in split.iterdir() if entry.name.endswith(SUFFIX)}
    expected = {graph_file_name(name): size for name, size in zip(index["names"], index["bytes"], strict=True)}
    return expected.items() <= sizes.items()


def _kept_graphs(source: FrameSource, split: Path, progress: bool) -> list[GraphSummary | None]:
    """Return, for every frame, the summary of its graph if that exists and is up to date, else None."""
    present = set()
    for path in split.iterdir():
        if path.name.endswith(".tmp"):
            path.unlink()  # left by a process that was killed while writing
        present.add(path.name)
    summaries: list[GraphSummary | None] = []
    names = ProgressBar(source.names, "looking for graphs", delay=1, leave=False, unit="frame", disable=not progress)
    for index, name in enumerate(names):
        summary = None
        if graph_file_name(name) in present:
            with contextlib.suppress(GraphFileError):  # a damaged graph is built again
                summary = read_summary(split / graph_file_name(name))
            if summary is not None and summary.made_from != frame_fingerprint(source, index):
                summary = None
        summaries.append(summary)
    return summaries


def _wait_for_another(split: Path, total: int, progress: bool, is_done: Callable[[], bool]) -> None:
    """Wait for another process to prepare a split, and show its progress."""
    with ProgressBar(total=total, desc=f"waiting for {split.name}", unit="frame", disable=not progress) as bar:
        while not is_done():
            bar.n = min(total, sum(1 for file in split.iterdir() if file.name.endswith(SUFFIX)))
            bar.refresh()


def _write_recipe(folder: Path, recipe: Recipe) -> None:
    content = (json.dumps(recipe, indent=2) + "\n").encode()
    path = folder / RECIPE_FILE
    if not path.is_file() or path.read_bytes() != content:
        _write(path, content)


def _write(path: Path, content: bytes) -> None:
    try:
        write_whole(path, content)
    except OSError as error:
        raise PreparationError(cannot_write(path, error)) from error


def _check_names(source: FrameSource) -> None:
    names = source.names
    if not names:
        raise PreparationError(f"split {source.split!r} of {type(source).__name__} has no frames to prepare")
    files: dict[str, str] = {}
    for name in names:
        file = graph_file_name(name)
        if not name or name.startswith(".") or "\0" in name or len(file.encode()) > 200:
            raise PreparationError(f"frame name {name!r} cannot be a file name: it is empty, hidden or too long")
        if files.setdefault(file, name) != name:
            raise PreparationError(f"frames {files[file]!r} and {name!r} would share the file {file}: rename one")
    if len(files) < len(names):
        twice = next(name for name, count in Counter(names).items() if count > 1)
        raise PreparationError(f"frame name {twice!r} occurs twice; names must be unique")


def _check_columns(graph: Data | GraphArrays, own: Mapping[str, Sequence[str]]) -> None:
    for key, names, what in (("x", NODE_NAMES, "node"), ("edge_attr", EDGE_NAMES, "edge")):
        declared = len(names) + len(own.get(f"own_{what}_columns", ()))
        columns = graph[key].shape[1]  # type: ignore[union-attr]
        if columns != declared:
            raise PreparationError(
                f"the graphs have {columns} {what} features, but {declared} columns are named: declare "
                f"every column in its group in sgbd.features, or in the builder's own {what}_columns"
            )


def _list_of_failures(source: FrameSource, failures: Mapping[int, str]) -> str:
    lines = [f"  {source.names[index]}: {reason}" for index, reason in sorted(failures.items())]
    if len(lines) > LINES_OF_REPORT:
        lines = [*lines[:LINES_OF_REPORT], f"  and {len(lines) - LINES_OF_REPORT} more"]
    return "\n".join(lines)
