"""Write the semantic masks of a dataset in TOD's layout, using the mesh names in its scene descriptions."""

from __future__ import annotations

import io
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from PIL import Image

from sgbd.machine.atomic_file import write_whole
from sgbd.machine.progress_bar import ProgressBar
from sgbd.machine.workers import map_in_order
from sgbd.sources.tod import Tod


@dataclass(frozen=True)
class FrameOfMasks:
    """Outcome for the mask of one frame.

    Attributes:
        state: `written`, `kept` (the mask existed) or `not described` (the scene has no description).
        unknown: For each object outside the dataset's categories, its ShapeNetCore category or "unknown mesh".
    """

    state: str
    unknown: tuple[str, ...] = ()


@dataclass(frozen=True)
class SemanticMasks:
    """Outcome for all frames.

    Attributes:
        frames: Number of frames per state, see `FrameOfMasks`.
        unknown: Number of objects without a category, per ShapeNetCore category of their mesh.
    """

    frames: Counter[str] = field(default_factory=Counter)
    unknown: Counter[str] = field(default_factory=Counter)


def write_semantic_masks(source: Tod, workers: int = 0, progress: bool = True) -> SemanticMasks:
    """Write `semseg_XXXXX.png`, the category of each pixel, for every frame without such a file.

    The encoding is that of E. P. Örnek et al., "SupeRGB-D", IEEE RA-L 8(6), 2023, doi:10.1109/LRA.2023.3271527:
    1, 2, ... are the categories in the order of `source.category_names`, the next number is the table. Existing masks
    are kept, and frames whose scene has no description get no mask.

    Args:
        source: The frames.
        workers: Number of worker processes; 0 to run in this process.
        progress: Whether to show a progress bar.

    Returns:
        Counts of frames and of objects without a category.

    Raises:
        FrameReadError: If a segmentation or a description cannot be read.
    """
    done = SemanticMasks()
    outcomes = map_in_order(_WriteMask(source), range(len(source)), workers)
    for outcome in ProgressBar(outcomes, f"masks of {source.split}", len(source), unit="frame", disable=not progress):
        done.frames[outcome.state] += 1
        done.unknown.update(outcome.unknown)
    return done


@dataclass(frozen=True)
class _WriteMask:
    source: Tod

    def __call__(self, index: int) -> FrameOfMasks:
        _, _, _, path, description = self.source.files(index)
        if path.exists():
            return FrameOfMasks("kept")
        if not description.exists():
            return FrameOfMasks("not described")
        mask = self.source.semantic_mask(index)
        content = io.BytesIO()
        Image.fromarray(mask.astype(np.uint8) if mask.max() < 256 else mask).save(content, "PNG")
        objects = self.source.objects(index)
        write_whole(path, content.getvalue())
        return FrameOfMasks("written", tuple(o.synset or "unknown mesh" for o in objects if o.category is None))
