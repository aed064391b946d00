"""The gallery of a report: inlined pictures of frames, with the attributes for filtering and sorting."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from sgbd.jobs.configuration import ConfigurationError
from sgbd.reporting.panels import GALLERY_FOLDER, PANELS, GalleryFrame, encoded, read_index
from sgbd.reporting.runs import Run

MEASURES = {
    "overlap_f_measure": "overlap F",
    "unaided_overlap_f_measure": "unaided overlap F",
    "boundary_f_measure": "boundary F",
    "oracle_overlap_f_measure": "oracle overlap F",
}
"""Columns of the frame scores that the gallery can be filtered and sorted by."""

WHOLE_PICTURE = "overview"
WHOLE_PICTURE_WIDTH = 1400


@dataclass(frozen=True)
class Picture:
    """An inlined picture.

    Attributes:
        panel: Name of the panel.
        title: Displayed title.
        data: The file as a `data:` URL.
        width: Pixels.
        height: Pixels.
    """

    panel: str
    title: str
    data: str
    width: int
    height: int


@dataclass(frozen=True)
class Card:
    """A frame in the gallery.

    Attributes:
        identity: HTML id on the page.
        run: Label of the run.
        dataset: Name of the dataset.
        name: Name of the frame.
        scores: Available scores in per cent, by the keys of `MEASURES`.
        seen: Whether the frame shows objects of seen categories; None if unknown.
        unseen: Whether the frame shows objects of unseen categories; None if unknown.
        categories: Categories of the objects.
        pictures: Pictures of the frame.
    """

    identity: str
    run: str
    dataset: str
    name: str
    scores: dict[str, float]
    seen: bool | None
    unseen: bool | None
    categories: Sequence[str]
    pictures: Sequence[Picture]


@dataclass(frozen=True)
class Gallery:
    """The frames shown on a page.

    Attributes:
        cards: The frames.
        available: Number of frames that the runs have pictures of.
        places: HTML id by run and frame.
    """

    cards: Sequence[Card]
    available: int
    places: dict[tuple[str, str], str]


def collect(runs: Sequence[Run], megabytes: float) -> Gallery:
    """Choose the frames to show and inline their pictures.

    Runs without a gallery (from older versions) show their overview pictures.

    Args:
        runs: The runs.
        megabytes: Maximum total size of all pictures. If the runs have more, each run shows fewer frames, evenly spread
            from worst to best.

    Returns:
        The gallery.

    Raises:
        ConfigurationError: If a picture listed in an index is missing or damaged.
    """
    found = {run.label: _frames(run) for run in runs}
    sizes = {
        label: [sum(path.stat().st_size for _, path in files) for _, files in rows] for label, rows in found.items()
    }
    most = max((len(rows) for rows in found.values()), default=0)
    # Base64 encodes three bytes as four characters.
    budget = megabytes * 1e6 * 3 / 4
    while (
        most > 0 and sum(sizes[label][place] for label in found for place in _spread(len(found[label]), most)) > budget
    ):
        most -= 1
    cards: list[Card] = []
    for run in runs:
        for place in _spread(len(found[run.label]), most):
            frame, files = found[run.label][place]
            cards.append(_card(f"frame-{len(cards)}", run, frame, files))
    places = {(card.run, card.name): card.identity for card in cards}
    return Gallery(cards, sum(len(rows) for rows in found.values()), places)


def _spread(count: int, most: int) -> list[int]:
    """Return at most `most` of `count` indices, evenly spread, including the first and the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist() if count and most else []


def _frames(run: Run) -> list[tuple[GalleryFrame, list[tuple[str, Path]]]]:
    """Return the frames that a run has pictures of, each with its picture files."""
    folder = run.folder / GALLERY_FOLDER
    indexed = read_index(folder)
    if indexed:
        rows = []
        for frame in indexed:
            files = [(panel, folder / frame.panels[panel]) for panel in PANELS if panel in frame.panels]
            missing = [path for _, path in files if not path.is_file()]
            if missing:
                raise ConfigurationError(f"{missing[0]} is missing, which {folder} lists; repeat the evaluation")
            rows.append((frame, files))
        return rows
    names = {str(name).replace("/", "_"): str(name) for name in run.frames.index}
    rows = []
    for path in sorted((run.folder / "pictures").glob("*.png"), key=_rank):
        stem = path.stem.partition("_")[2]
        rows.append((GalleryFrame(names.get(stem, stem), {}), [(WHOLE_PICTURE, path)]))
    return rows


def _rank(path: Path) -> tuple[int, str]:
    rank = path.stem.partition("_")[0]
    return (int(rank) if rank.isdigit() else 0, path.name)


def _card(identity: str, run: Run, frame: GalleryFrame, files: Sequence[tuple[str, Path]]) -> Card:
    row: dict[str, float] = {}
    if frame.name in run.frames.index:
        numbers = run.frames.select_dtypes("number").loc[[frame.name]]
        row = dict(zip(map(str, numbers.columns), numbers.to_numpy(float)[0].tolist(), strict=True))
    scores = {name: 100 * row[name] for name in MEASURES if not math.isnan(row.get(name, math.nan))}
    seen: bool | None = None
    unseen: bool | None = None
    if frame.seen is not None and frame.unseen is not None:
        seen, unseen = frame.seen > 0, frame.unseen > 0
    elif "seen_overlap_f_measure" in row:
        seen, unseen = (not math.isnan(row[f"{group}_overlap_f_measure"]) for group in ("seen", "unseen"))
    pictures = [_picture(panel, frame.nodes if panel == "superpixels" else panel, path) for panel, path in files]
    return Card(identity, run.label, run.dataset, frame.name, scores, seen, unseen, frame.categories, pictures)


def _picture(panel: str, title: str, path: Path) -> Picture:
    try:
        with Image.open(path) as picture:
            picture.load()
            width, height = picture.size
            content = encoded(picture, WHOLE_PICTURE_WIDTH) if panel == WHOLE_PICTURE else path.read_bytes()
            kind = "webp" if panel == WHOLE_PICTURE else str(picture.format).lower()
    except (UnidentifiedImageError, OSError) as error:
        raise ConfigurationError(f"{path} is damaged ({error}); remove it, or repeat the evaluation") from None
    return Picture(panel, title, f"data:image/{kind};base64,{base64.b64encode(content).decode()}", width, height)
