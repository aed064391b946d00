"""Read recordings that consist of two image sequences, as exported by Open3D and RealSense tools."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from sgbd.frame import MILLIMETERS, Frame, Intrinsics
from sgbd.sources.camera import intrinsics_from, intrinsics_option
from sgbd.sources.camera_file import CAMERA_FILES, CameraFile, find_camera_file, read_camera_file
from sgbd.sources.errors import FrameReadError
from sgbd.sources.image import IMAGE_SUFFIXES, checked_depth_scale, image_files, read_depth, read_rgb
from sgbd.sources.notices import info_once
from sgbd.sources.recording import Recording

log = logging.getLogger(__name__)

_NUMBER = re.compile(r"(\d+)(?:\.(\d+))?\D*$")


class ColorDepthRecording(Recording):
    """A folder with the image sequences `color` and `depth` and, optionally, a camera file.

    The two images of a frame have the same number (the last number in the file name): `color/000012.jpg` and
    `depth/000012.png`, or `color/Color_12.png` and `depth/Depth_12.png`. It may be a time in seconds, such as
    `1305031102.175304`, if both images have the same. The depth must be aligned to the colour camera, as done by
    Open3D's recorder and librealsense's align filter. The camera is read from one of
    `sgbd.sources.camera_file.CAMERA_FILES`; if such a file exists, the colour folder may also be called `rgb`.

    Args:
        root: Folder that contains both sequences.
        intrinsics: Camera of all frames. None uses the camera file; without one the camera is unknown.
        depth_scale: Metres per unit of the depth images. None uses the camera file, or else millimetres.

    Raises:
        ValueError: If the scale is not positive.
        FrameError: If `intrinsics` is not a valid camera.
    """

    layout = """
root/
    color/000000.jpg        8-bit colours, PNG or JPEG
    depth/000000.png        uint16, aligned to the colours, millimetres unless depth_scale says otherwise, 0 = missing
    camera_intrinsic.json   of Open3D (intrinsic_matrix) or librealsense (fx, fy, ppx, ppy)   (optional)
"""
    remedy = "Record with aligned depth, or export a .bag file with Open3D or librealsense."

    def __init__(
        self,
        root: str | Path,
        intrinsics: Intrinsics | Mapping[str, Any] | None = None,
        depth_scale: float | None = None,
    ) -> None:
        self.root = Path(root).expanduser()
        self._given_intrinsics = intrinsics_from(intrinsics)
        self._given_depth_scale = None if depth_scale is None else checked_depth_scale(depth_scale)

    @staticmethod
    def recognizes(root: str | Path) -> bool:
        """Return whether a folder has this layout."""
        root = Path(root)
        colors = (root / "color").is_dir() or ((root / "rgb").is_dir() and find_camera_file(root) is not None)
        return colors and (root / "depth").is_dir()

    @cached_property
    def camera_file(self) -> CameraFile | None:
        """Content of the camera file; None if there is none."""
        path = find_camera_file(self.root)
        return None if path is None else read_camera_file(path)

    @property
    def intrinsics(self) -> Intrinsics | None:
        """The camera of all frames: the given one, or else that of the camera file."""
        return self._given_intrinsics or (self.camera_file.intrinsics if self.camera_file else None)

    @property
    def depth_scale(self) -> float:
        """Metres per unit of the depth images: the given value, or that of the camera file, or millimetres."""
        stated = self.camera_file.depth_scale if self.camera_file else None
        return self._given_depth_scale or stated or MILLIMETERS

    def options(self) -> Mapping[str, Any]:
        """Return the options that affect what is read."""
        return {
            "intrinsics": intrinsics_option(self.intrinsics),
            "depth_scale": self.depth_scale,
        }

    def read(self, index: int) -> Frame:
        """Read a frame.

        Raises:
            FrameReadError: If a file is missing, damaged or of the wrong kind, or the camera file is for another image
                size.
            sgbd.frame.FrameError: If the two images do not form a valid frame.
        """
        rgb_path, depth_path = self.files(index)
        rgb = read_rgb(rgb_path)
        size = (rgb.shape[1], rgb.shape[0])
        camera = self.camera_file
        if self._given_intrinsics is None and camera and camera.size is not None and camera.size != size:
            raise FrameReadError(
                rgb_path,
                f"it has {size[0]}x{size[1]} pixels, and the camera of {camera.path.name} {camera.size[0]}x"
                f"{camera.size[1]}. State the camera of these images: intrinsics='{{fx: …, fy: …, cx: …, cy: …}}'.",
            )
        return Frame(rgb, read_depth(depth_path, self.depth_scale), self.intrinsics, name=self.names[index])

    @cached_property
    def _frames(self) -> dict[str, tuple[Path, Path]]:
        self._require_root()
        color_folder = self.root / ("color" if (self.root / "color").is_dir() else "rgb")
        depth_folder = self.root / "depth"
        for folder in (color_folder, depth_folder):
            if not folder.is_dir():
                raise self._not_found(f"there is no folder {folder.name}")
        colors, depths = _images_by_number(color_folder), _images_by_number(depth_folder)
        if not colors:
            raise self._not_found(f"there is no image in {color_folder.name} ({', '.join(IMAGE_SUFFIXES)})")
        common = colors.keys() & depths.keys()
        if not common:
            raise self._not_found(
                f"none of the {len(colors)} images in {color_folder.name} has the number of one of the {len(depths)} "
                "in depth"
            )
        self._say(color_folder.name, len(common), len(colors), len(depths))
        # A missing depth image is reported when that frame is read, so that the other frames stay usable.
        return {
            path.stem: (path, depths.get(number, depth_folder / f"{path.stem}.png"))
            for number, path in sorted(colors.items())
        }

    def _say(self, color_folder: str, pairs: int, colors: int, depths: int) -> None:
        camera = self.camera_file
        info_once(
            log, "%s: a recording of two sequences (%s/, depth/); %d frames, %d of %d colour and %d of %d depth images "
            "have no partner of their number",
            self.root, color_folder, pairs, colors - pairs, colors, depths - pairs, depths,
        )  # fmt: skip
        if self._given_intrinsics:
            source = "the camera as given"
        elif camera:
            source = f"the camera of {camera.path.name} ({camera.form}'s form)"
        else:
            source = (
                "the camera is unknown, a horizontal view of 59° is assumed "
                f"(option: intrinsics, or a file {CAMERA_FILES[0]})"
            )
        info_once(
            log, "%s: the depth has %g units a metre (option: depth_scale, now %g); %s",
            self.root, 1 / self.depth_scale, self.depth_scale, source,
        )  # fmt: skip
        if camera and camera.distorted and not self._given_intrinsics:
            log.warning("%s: the lens distortion in it is left out; undistort the images if it is large", camera.path)


def _images_by_number(folder: Path) -> dict[tuple[int, str], Path]:
    """Return the images of a folder by the integer part and the decimals of their number."""
    images: dict[tuple[int, str], Path] = {}
    for path in image_files(folder):
        match = _NUMBER.search(path.stem)
        if match is None:
            raise FrameReadError(path, "its name has no number, by which colour and depth would be paired")
        number = (int(match[1]), match[2] or "")
        if number in images:
            told = ".".join(filter(None, map(str, number)))
            raise FrameReadError(path, f"it has the number {told}, as {images[number].name} has; rename one")
        images[number] = path
    return images
