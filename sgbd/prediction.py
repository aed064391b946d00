"""Segmentation of unlabelled frames, one after another, and the files of the results."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imageio.v3 as iio
import numpy as np
from scipy.ndimage import find_objects

from sgbd.frame import Frame, FrameError
from sgbd.machine.atomic_file import write_whole
from sgbd.machine.one_ahead import one_ahead
from sgbd.reporting.overlay import overlay
from sgbd.segmentation import Segmentation
from sgbd.sources import FrameSource

if TYPE_CHECKING:
    from sgbd.segmenter import Segmenter


def segment_ahead(frames: FrameSource, segmenter: Segmenter) -> Iterator[tuple[Frame, Segmentation] | FrameError]:
    """Segment frames in order. While the caller processes one frame, the next is segmented and the one after it read.

    Args:
        frames: The frames.
        segmenter: The segmenter.

    Yields:
        Each frame with its segmentation, or the error if the frame cannot be read.
    """
    indices = iter(range(len(frames)))

    def read() -> Frame | FrameError | None:
        index = next(indices, None)
        try:
            return None if index is None else frames[index]
        except FrameError as error:
            return error

    frames_read: Iterator[Frame | FrameError] = one_ahead(read)

    def segment() -> tuple[Frame, Segmentation] | FrameError | None:
        frame = next(frames_read, None)
        return (frame, segmenter.segment_frame(frame)) if isinstance(frame, Frame) else frame

    return one_ahead(segment)


def objects_as_json(segmentation: Segmentation) -> list[dict[str, Any]]:
    """Describe the objects of a frame as JSON values.

    Args:
        segmentation: Segmentation of the frame.

    Returns:
        For each object, in order of descending score: `id` in the label image; `area` in pixels; `box` as [left, top,
        width, height] in pixels; `score` and `objectness` from 0 to 1.
    """
    areas = np.bincount(segmentation.instances.ravel(), minlength=len(segmentation.scores) + 1)
    # Finds the boxes of all objects in one pass over the image.
    boxes = find_objects(segmentation.instances)
    return [
        {
            "id": number,
            "area": int(areas[number]),
            "box": [columns.start, rows.start, columns.stop - columns.start, rows.stop - rows.start],
            "score": round(score, 4),
            "objectness": round(objectness, 4),
        }
        for number, (score, objectness, (rows, columns)) in enumerate(
            zip(segmentation.scores.tolist(), segmentation.objectness.tolist(), boxes, strict=True), start=1
        )
    ]


def label_images_in_the_way(frames: FrameSource, folder: Path) -> list[Path]:
    """Return the label images that belong to the frames, perhaps as ground truth, and that writing would replace.

    Those of an earlier prediction, which have a JSON file beside them, are not among them.

    Args:
        frames: The frames.
        folder: Output folder of `write_segmentation`.
    """
    place = folder.resolve()
    return [
        labels
        for index, name in enumerate(frames.names)
        if (labels := folder / f"{_file_stem(name)}_labels.png").is_file()
        and not (folder / f"{_file_stem(name)}.json").is_file()
        and any(path.parent.resolve() == place for path in frames.files(index))
    ]


def write_segmentation(frame: Frame, segmentation: Segmentation, folder: Path, draw: bool = True) -> None:
    """Write `NAME_labels.png` (uint16 ids, 0 = not an object), `NAME_overlay.png` and `NAME.json`.

    Args:
        frame: The frame.
        segmentation: Its segmentation.
        folder: Output folder; created if needed.
        draw: Whether to write the overlay, which takes as long as the segmentation.
    """
    stem = _file_stem(frame.name)
    description = {
        "name": frame.name,
        "width": frame.width,
        "height": frame.height,
        "objects": objects_as_json(segmentation),
    }
    # First, so that the label image of an interrupted prediction is not taken for one of the frame's own.
    write_whole(folder / f"{stem}.json", json.dumps(description, indent=1).encode())
    labels = segmentation.instances.astype(np.uint16)
    write_whole(folder / f"{stem}_labels.png", iio.imwrite("<bytes>", labels, extension=".png"))
    if draw:
        picture = overlay(frame.rgb, segmentation.instances)
        # With default compression, encoding would take longer than the segmentation, and the file is hardly smaller.
        encoded = iio.imwrite("<bytes>", picture, extension=".png", compress_level=1, compress_type=zlib.Z_HUFFMAN_ONLY)
        write_whole(folder / f"{stem}_overlay.png", encoded)


def _file_stem(name: str) -> str:
    return name.replace("/", "_")
