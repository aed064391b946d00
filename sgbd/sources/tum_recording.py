"""Read recordings in the layout of the TUM RGB-D benchmark."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sgbd.frame import Frame, Intrinsics
from sgbd.sources.camera import intrinsics_from, intrinsics_option
from sgbd.sources.errors import FrameReadError
from sgbd.sources.image import checked_depth_scale, read_depth, read_rgb
from sgbd.sources.mosd import KINECT
from sgbd.sources.notices import info_once
from sgbd.sources.recording import Recording
from sgbd.sources.time_association import associate

log = logging.getLogger(__name__)

TUM_DEPTH_SCALE = 1 / 5000
"""Metres per unit of the depth images: the benchmark stores 5000 units per metre."""
TOLERANCE = 0.02
"""Maximum time difference between the colour and depth image of a frame, seconds; the benchmark's default."""

LISTS = ("rgb.txt", "depth.txt")
ASSOCIATIONS = ("associations.txt", "association.txt", "associated.txt", "associate.txt")
"""Lists of already associated pairs, `time file time file` per line, as used by ICL-NUIM and SLAM systems."""


class _Listed(NamedTuple):
    time: float
    path: Path


class TumRecording(Recording):
    """A recording of the TUM RGB-D benchmark, or of a program that writes the same layout.

    `rgb.txt` and `depth.txt` contain one `timestamp filename` per line; comments start with #. The two cameras are not
    synchronised: a colour and a depth image form a frame if each is the other's nearest in time and they are at most
    `tolerance` apart. Images without a partner are left out and counted in a log message. A list of pairs
    (`associations.txt`) is used as it is.

    J. Sturm, N. Engelhard, F. Endres, W. Burgard, D. Cremers, "A Benchmark for the Evaluation of RGB-D SLAM Systems",
    IROS 2012, doi:10.1109/IROS.2012.6385773.

    Args:
        root: Folder that contains the lists.
        intrinsics: Camera of all frames. None uses the benchmark's default (fx = fy = 525, cx = 319.5, cy = 239.5)
            for 640x480 images and treats the camera as unknown otherwise.
        depth_scale: Metres per unit of the depth images.
        tolerance: Maximum time difference between the two images of a frame, seconds.

    Raises:
        ValueError: If the scale is not positive or the tolerance is negative.
        FrameError: If `intrinsics` is not a valid camera.
    """

    layout = """
root/
    rgb.txt                      timestamp filename, in seconds, one image a line; # before comments
    depth.txt                    the same of the depth images
    rgb/1305031102.175304.png    8-bit colours
    depth/1305031102.160407.png  uint16, 5000 units a metre unless depth_scale says otherwise, 0 = missing
or associations.txt with timestamp filename timestamp filename instead of the two lists
"""
    remedy = "Sequences are at https://cvg.cit.tum.de/data/datasets/rgbd-dataset; unpack one and give its folder."

    def __init__(
        self,
        root: str | Path,
        intrinsics: Intrinsics | Mapping[str, Any] | None = None,
        depth_scale: float = TUM_DEPTH_SCALE,
        tolerance: float = TOLERANCE,
    ) -> None:
        if not tolerance >= 0:
            raise ValueError(f"the tolerance of time differences must be 0 or more, in seconds; got {tolerance}")
        self.root = Path(root).expanduser()
        self.intrinsics = intrinsics_from(intrinsics)
        self.depth_scale = checked_depth_scale(depth_scale)
        self.tolerance = tolerance

    @staticmethod
    def recognizes(root: str | Path) -> bool:
        """Return whether a folder contains one of the layout's list files."""
        return any((Path(root) / name).is_file() for name in (*LISTS, *ASSOCIATIONS))

    def options(self) -> Mapping[str, Any]:
        """Return the options that affect what is read."""
        return {
            "intrinsics": intrinsics_option(self.intrinsics),
            "depth_scale": self.depth_scale,
            "tolerance": self.tolerance,
        }

    def read(self, index: int) -> Frame:
        """Read a frame.

        Raises:
            FrameReadError: If a file is missing, damaged or of the wrong kind.
            sgbd.frame.FrameError: If the two images do not form a valid frame.
        """
        rgb_path, depth_path = self.files(index)
        rgb = read_rgb(rgb_path)
        camera = self.intrinsics or (KINECT if rgb.shape[:2] == (480, 640) else None)
        return Frame(rgb, read_depth(depth_path, self.depth_scale), camera, name=self.names[index])

    @cached_property
    def _frames(self) -> dict[str, tuple[Path, Path]]:
        pairs = self._pairs()
        frames = {rgb.stem: (rgb, depth) for rgb, depth in pairs}
        if len(frames) < len(pairs):
            names = [rgb.stem for rgb, _ in pairs]
            twice = next(name for place, name in enumerate(names) if name in names[:place])
            raise FrameReadError(self.root, f"the colour image {twice!r} is listed more than once; list it once")
        camera = (
            "the camera as given"
            if self.intrinsics
            else "the benchmark's default camera for 640x480 images, fx = fy = 525 (option: intrinsics)"
        )
        info_once(
            log, "%s: the depth has %g units a metre (option: depth_scale, now %g); %s",
            self.root, 1 / self.depth_scale, self.depth_scale, camera,
        )  # fmt: skip
        return frames

    def _pairs(self) -> list[tuple[Path, Path]]:
        self._require_root()
        lists = [self.root / name for name in LISTS]
        associated = next((path for name in ASSOCIATIONS if (path := self.root / name).is_file()), None)
        if associated is not None and not all(path.is_file() for path in lists):
            pairs = _read_associations(associated)
            if not pairs:
                raise FrameReadError(associated, "no image is listed in it")
            info_once(log, "%s: a TUM RGB-D recording, %d frames in %s", self.root, len(pairs), associated.name)
            return pairs
        for path in lists:
            if not path.is_file():
                raise self._not_found(f"there is no {path.name}")
        colors, depths = (_read_list(path) for path in lists)
        for path, images in zip(lists, (colors, depths), strict=True):
            if not images:
                raise FrameReadError(path, "no image is listed in it")
        color_times, depth_times = ([image.time for image in images] for images in (colors, depths))
        chosen, partners = associate(color_times, depth_times, self.tolerance)
        if not chosen.size:
            # The smallest difference of all pairs shows how far the clocks are apart.
            nearest = associate(color_times, depth_times, math.inf)
            gap = np.abs(np.take(color_times, nearest[0]) - np.take(depth_times, nearest[1])).min()
            raise FrameReadError(
                self.root,
                f"none of the {len(colors)} colour images has a depth image within {self.tolerance * 1000:g} ms; the "
                f"least difference is {gap:.3f} s. If the clocks agree, allow more: time_tolerance=<seconds>.",
            )
        info_once(
            log,
            "%s: a TUM RGB-D recording (rgb.txt, depth.txt); %d frames of colour and depth at most %g ms apart; "
            "%d of %d colour and %d of %d depth images have no partner and are left out (option: time_tolerance)",
            self.root, chosen.size, self.tolerance * 1000,
            len(colors) - chosen.size, len(colors), len(depths) - chosen.size, len(depths),
        )  # fmt: skip
        return [
            (colors[color].path, depths[depth].path)
            for color, depth in zip(chosen.tolist(), partners.tolist(), strict=True)
        ]


def _rows(path: Path, columns: int, form: str) -> list[list[str]]:
    """Return the fields of each line that is neither empty nor a comment; the last field may contain spaces."""
    try:
        text = path.read_text(encoding="utf-8-sig")  # editors on Windows write a byte order mark
    except (OSError, UnicodeDecodeError) as error:
        raise FrameReadError(path, f"the list cannot be read: {error}") from error
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        # Some programs separate the fields with commas.
        line = line.replace(",", " ").strip()
        if not line or line.startswith("#"):
            continue
        row = line.split(maxsplit=columns - 1)
        if len(row) < columns or not all(_is_time(time) for time in row[::2]):
            raise FrameReadError(path, f"line {number} should be `{form}`; it is {line!r}")
        rows.append(row)
    return rows


def _is_time(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _read_list(path: Path) -> list[_Listed]:
    return [_Listed(float(time), path.parent / name) for time, name in _rows(path, 2, "timestamp filename")]


def _read_associations(path: Path) -> list[tuple[Path, Path]]:
    """Return the colour and depth file of each line; the file whose folder name starts with "depth" is the depth."""
    pairs = []
    for _, first, _, second in _rows(path, 4, "timestamp filename timestamp filename"):
        depths = [Path(name).parts[0].startswith("depth") for name in (first, second)]
        if depths[0] == depths[1]:
            raise FrameReadError(path, f"one of {first!r} and {second!r} should lie in the folder depth, and one not")
        rgb, depth = (second, first) if depths[0] else (first, second)
        pairs.append((path.parent / rgb, path.parent / depth))
    return pairs
