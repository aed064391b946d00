"""Find frames without knowing their layout: files, folders, recordings or videos."""

from __future__ import annotations

import logging
from functools import cached_property
from pathlib import Path
from typing import Any

from sgbd.frame import MILLIMETERS, Frame, Intrinsics
from sgbd.sources.camera import intrinsics_option
from sgbd.sources.camera_file import find_camera_file
from sgbd.sources.color_depth_recording import ColorDepthRecording
from sgbd.sources.errors import FrameReadError
from sgbd.sources.folder import Folder
from sgbd.sources.image import IMAGE_SUFFIXES, checked_depth_scale, image_files, read_depth, read_rgb
from sgbd.sources.notices import info_once
from sgbd.sources.source import FrameSource
from sgbd.sources.tum_recording import TOLERANCE, TUM_DEPTH_SCALE, TumRecording
from sgbd.sources.video_pair import VIDEO_SUFFIXES, VideoPair

log = logging.getLogger(__name__)


class _RecordedFolder(Folder):
    """A folder of frames that was not given as a dataset; tried last, so its messages list all layouts."""

    layout = "\n".join(
        f"{title}:\n{layout.strip()}"
        for title, layout in (
            ("frames of your own", Folder.layout),
            ("TUM RGB-D", TumRecording.layout),
            ("Open3D, RealSense", ColorDepthRecording.layout),
        )
    )
    remedy = (
        "Give the folder of your frames as rgb, or rgb=<folder of colour images> depth=<folder of depth images>, or "
        "two videos, rgb=<colours> depth=<depth>."
    )


def find_frames(
    rgb: str | Path,
    depth: str | Path | None = None,
    intrinsics: Intrinsics | None = None,
    depth_scale: float | None = None,
    time_tolerance: float = TOLERANCE,
) -> FrameSource:
    """Recognise the layout of a recording, log it, and open its frames.

    A folder with the lists of TUM RGB-D is a `TumRecording`, whatever its subfolders are called, because its depth is
    not in millimetres. A folder with `color` and `depth` is a `ColorDepthRecording`. Two videos are a `VideoPair`, and
    everything else is `RecordedFrames`.

    Args:
        rgb: A colour image, a colour video, or a folder.
        depth: A depth image, a depth video, or a folder of depth images; None if the folder `rgb` contains both.
        intrinsics: The camera of all frames; None uses the intrinsics of the recording.
        depth_scale: Metres per depth unit; None uses the scale of the recording or its layout, or millimetres.
        time_tolerance: Maximum time between the two images of a frame, seconds, if they are paired by the lists of TUM
            RGB-D.

    Returns:
        The frames.

    Raises:
        FrameReadError: If no frames can be read from these paths.
        ValueError: If the scale is not positive or the tolerance is negative.
    """
    if depth_scale is not None:
        checked_depth_scale(depth_scale)
    if not time_tolerance >= 0:
        raise ValueError(f"time_tolerance must be 0 or more, in seconds; got {time_tolerance}")
    place = Path(rgb).expanduser()
    scale = MILLIMETERS if depth_scale is None else depth_scale
    if depth is None:
        if TumRecording.recognizes(place):
            return TumRecording(place, intrinsics, depth_scale or TUM_DEPTH_SCALE, time_tolerance)
        if ColorDepthRecording.recognizes(place):
            return ColorDepthRecording(place, intrinsics, depth_scale)
        if place.is_dir():
            info_once(log, "%s: taken for a folder of frames; the depth has %g units a metre", place, 1 / scale)
        return RecordedFrames(place, None, intrinsics, scale)
    places = (place, Path(depth).expanduser())
    videos = [path.suffix.lower() in VIDEO_SUFFIXES and not path.is_dir() for path in places]
    if all(videos):
        return VideoPair(*places, intrinsics, scale)
    if any(videos):
        raise FrameReadError(places[videos.index(False)], "rgb and depth must both be videos, or both be images")
    parent = place.parent
    if depth_scale is None and places[1].parent == parent and places[1].is_dir() and TumRecording.recognizes(parent):
        raise FrameReadError(
            places[1],
            f"the folder belongs to a TUM RGB-D recording, the depth of which is not in millimetres. Give "
            f"rgb={parent} alone, or state the unit: depth_scale={TUM_DEPTH_SCALE:g} is TUM's.",
        )
    info_once(
        log, "%s, %s: the depth has %g units a metre (option: depth_scale, now %g)%s",
        *places, 1 / scale, scale,
        "" if intrinsics else "; the camera is unknown, a horizontal view of 59° is assumed (option: intrinsics)",
    )  # fmt: skip
    camera_file = find_camera_file(parent)
    apart = places in [(parent / color, parent / "depth") for color in ("color", "rgb")]
    if apart and camera_file is not None and (intrinsics is None or depth_scale is None):
        log.warning("%s is left out, as colours and depth are given apart; rgb=%s alone reads it", camera_file, parent)
    return RecordedFrames(*places, intrinsics, scale)


class RecordedFrames(FrameSource):
    """Frames given as a colour and a depth file, as two folders, or as one folder in the layout of `Folder`.

    In two folders, the files of a frame have the same name, apart from the suffix and a trailing `_rgb`, `_color`,
    `_colour` or `_depth`.

    Args:
        rgb: A colour image or a folder.
        depth: A depth image or a folder of depth images; None if the folder `rgb` contains both.
        intrinsics: The camera of all frames; None if unknown.
        depth_scale: Metres per unit of the depth images.

    Raises:
        FrameReadError: If a path does not exist, only one of the two is a folder, no frame is found, or a folder
            contains two images of the same frame.
    """

    def __init__(
        self,
        rgb: str | Path,
        depth: str | Path | None = None,
        intrinsics: Intrinsics | None = None,
        depth_scale: float = MILLIMETERS,
    ) -> None:
        self.split = "test"
        self.rgb = Path(rgb).expanduser()
        self.depth = None if depth is None else Path(depth).expanduser()
        self.intrinsics = intrinsics
        self.depth_scale = depth_scale
        self._files = self._find()

    def _find(self) -> dict[str, tuple[Path, Path]]:
        for path in (self.rgb, self.depth):
            if path is not None and not path.exists():
                raise FrameReadError(path, "it does not exist. Give rgb=<file or folder> and depth=<file or folder>.")
        if self.depth is None:
            if not self.rgb.is_dir():
                raise FrameReadError(self.rgb, "its depth is not known. Give depth=<file> too.")
            source = _RecordedFolder(self.rgb, intrinsics=self.intrinsics)
            return {name: (source.files(place)[0], source.files(place)[1]) for place, name in enumerate(source.names)}
        if self.rgb.is_dir() != self.depth.is_dir():
            raise FrameReadError(self.depth, "rgb and depth must both be files or both be folders.")
        if not self.rgb.is_dir():
            return {_frame_name(self.rgb): (self.rgb, self.depth)}
        colors, depths = _images_by_name(self.rgb), _images_by_name(self.depth)
        # Keep frames without a depth image: reading them reports the missing file.
        files = {name: (path, depths.get(name, self.depth / f"{name}.png")) for name, path in colors.items()}
        if not files:
            raise FrameReadError(self.rgb, f"there is no image in it ({', '.join(IMAGE_SUFFIXES)}).")
        return files

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the frames, sorted."""
        return tuple(self._files)

    @property
    def splits(self) -> tuple[str, ...]:
        """The one split, "test"."""
        return ("test",)

    def files(self, index: int) -> tuple[Path, ...]:
        """Return the colour and the depth image of a frame."""
        return self._files[self.names[index]]

    def read(self, index: int) -> Frame:
        """Read a frame.

        Raises:
            FrameReadError: If a file is missing, damaged or not an image of the expected kind.
            sgbd.frame.FrameError: If the two images are not a valid frame.
        """
        rgb, depth = self.files(index)
        return Frame(read_rgb(rgb), read_depth(depth, self.depth_scale), self.intrinsics, name=self.names[index])

    def options(self) -> dict[str, Any]:
        """Return the options that affect the frames."""
        return {
            "intrinsics": intrinsics_option(self.intrinsics),
            "depth_scale": self.depth_scale,
        }


def _frame_name(path: Path) -> str:
    for ending in ("_rgb", "_color", "_colour", "_depth"):
        if path.stem.endswith(ending):
            return path.stem.removesuffix(ending)
    return path.stem


def _images_by_name(folder: Path) -> dict[str, Path]:
    images: dict[str, Path] = {}
    for path in image_files(folder):
        name = _frame_name(path)
        if name in images:
            raise FrameReadError(
                path,
                f"frame {name!r} has two images, this one and {images[name].name}. A folder that holds colour and "
                "depth images is given as rgb alone.",
            )
        images[name] = path
    return images
