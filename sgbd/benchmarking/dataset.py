"""Write frames as image files, to measure preparation, training and evaluation from disk."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from sgbd.benchmarking.frames import RawFrame
from sgbd.jobs.configuration import ConfigurationError
from sgbd.sources import Folder, LabelRule

LARGEST_LABEL = 65534
"""Largest label of a 16-bit label image, apart from the label of ignored pixels."""

IGNORED = 65535

KINDS = ("rgb", "depth", "labels")


def write_dataset(frames: Sequence[RawFrame], count: int, root: Path) -> Folder:
    """Write frames as PNG files, repeating them as needed: the repetitions are symbolic links to the first files.

    Args:
        frames: The frames, with ground truth.
        count: Number of files of each kind.
        root: An empty folder.

    Returns:
        A source that reads the files.

    Raises:
        ConfigurationError: If a frame has no ground truth.
    """
    for number, raw in enumerate(frames[:count]):
        if raw.instances is None:
            raise ConfigurationError(
                f"frame {raw.name!r} has no label image, which training and evaluation need. Leave prepare, train and "
                "evaluate out of sections, or measure on made-up scenes: frames=null"
            )
        labels = np.where(raw.instances < 0, IGNORED, np.minimum(raw.instances, LARGEST_LABEL)).astype(np.uint16)
        images = Image.fromarray(raw.rgb), Image.fromarray(raw.depth), Image.fromarray(labels)
        for kind, image in zip(KINDS, images, strict=True):
            image.save(_file(root, number, kind), compress_level=1)
    for number in range(len(frames), count):
        for kind in KINDS:
            _file(root, number, kind).symlink_to(_file(root, number % len(frames), kind).absolute())
    rule = LabelRule(background=[0], support=[1], ignore=[IGNORED], objects=[f"2-{LARGEST_LABEL}"])
    return Folder(root, labels=rule, intrinsics=frames[0].intrinsics)


def _file(root: Path, number: int, kind: str) -> Path:
    return root / f"{number:06d}_{kind}.png"
