"""Read RGB-D frames from a plain folder of image files."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from sgbd.frame import MILLIMETERS, Frame, Intrinsics
from sgbd.sources.camera import intrinsics_from, intrinsics_option
from sgbd.sources.dataset_folder import DatasetFolder
from sgbd.sources.errors import FrameReadError
from sgbd.sources.image import checked_depth_scale, image_files, read_depth, read_labels, read_rgb
from sgbd.sources.label_rule import MOSD, LabelRule, detect_label_rule, read_instances
from sgbd.sources.notices import info_once

log = logging.getLogger(__name__)

SPLITS = ("train", "val", "test")
KINDS = ("rgb", "depth", "labels")

_DETECTION_FRAMES = 32
_KIND_FILE = re.compile(rf"(?P<name>.+)_(?P<kind>{'|'.join(KINDS)})")


class _Files(NamedTuple):
    """The files of a frame, as texts: every worker holds those of all frames, and a path takes more memory."""

    name: str
    rgb: str
    depth: str
    labels: str | None


class Folder(DatasetFolder):
    """RGB-D frames in a folder, with optional label images.

    A frame consists of `NAME_rgb.png`, `NAME_depth.png` and `NAME_labels.png`, or of three files with the same name in
    the subfolders `rgb`, `depth` and `labels`. Colours may be PNG or JPEG; labels are optional. The subfolders `train`,
    `val` and `test`, if any exist, are the splits; otherwise all frames form the test split.

    The folder is scanned on the first access to `names`, `splits` or a frame.

    Args:
        root: The folder.
        split: "train", "val" or "test".
        labels: What the values in label images mean. "auto" uses a sample of the frames to decide between plain labels
            (0 background, 1 support, 2 and above objects) and mOSD labels, and logs its choice.
        intrinsics: Camera of all frames; None if unknown.
        depth_scale: Metres per unit of the depth images.

    Raises:
        ValueError: If the split is unknown, or `labels` is neither a rule nor "auto".
        FrameError: If `intrinsics` is not a valid camera.
    """

    layout = """
root/
    NAME_rgb.png      8-bit colours, PNG or JPEG
    NAME_depth.png    uint16, millimetres unless depth_scale says otherwise, 0 = missing
    NAME_labels.png   one integer id a pixel   (optional)
or the same three files as root/rgb/NAME.png, root/depth/NAME.png, root/labels/NAME.png;
root may hold train/, val/ and test/, each of this layout.
"""
    remedy = "Give the folder of your frames as dataset.root, or use the embedded synthetic set: dataset=tabletop."

    def __init__(
        self,
        root: str | Path,
        split: str = "test",
        labels: LabelRule | str = "auto",
        intrinsics: Intrinsics | Mapping[str, Any] | None = None,
        depth_scale: float = MILLIMETERS,
    ) -> None:
        if split not in SPLITS:
            raise ValueError(f"no split {split!r}; choose from {', '.join(SPLITS)}")
        if labels != "auto" and not isinstance(labels, LabelRule):
            raise ValueError(f"labels must be 'auto' or a LabelRule; got {labels!r}")
        self.root = Path(root).expanduser()
        self.split = split
        self.intrinsics = intrinsics_from(intrinsics)
        self.depth_scale = checked_depth_scale(depth_scale)
        self._labels = labels

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The NAME of each frame, sorted."""
        return tuple(frame.name for frame in self._frames)

    @property
    def splits(self) -> tuple[str, ...]:
        """Those of the subfolders train, val and test that exist; only "test" if there are none."""
        return tuple(split for split in SPLITS if (self.root / split).is_dir()) or ("test",)

    @cached_property
    def label_rule(self) -> LabelRule:
        """The rule that converts label images to instance ids."""
        if isinstance(self._labels, LabelRule):
            return self._labels
        labeled = [frame for frame in self._frames if frame.labels is not None]
        # Sample evenly: the first frames alone may all show the same scene.
        step = max(1, -(-len(labeled) // _DETECTION_FRAMES))
        rule = detect_label_rule(
            pair for frame in labeled[::step] if (pair := _labels_and_depth(frame, self.depth_scale)) is not None
        )
        if labeled:
            info_once(
                log,
                "%s: labels are read as %s (%s); the dataset's `labels` option overrides it",
                self.root,
                rule,
                "recognised as mOSD's; dataset=mosd also sets its camera" if rule == MOSD else "the plain rule",
            )
        return rule

    def files(self, index: int) -> tuple[Path, ...]:
        """Return the colour, depth and (if present) label image of a frame."""
        _, *paths = self._frames[index]
        return tuple(Path(path) for path in paths if path is not None)

    def options(self) -> Mapping[str, Any]:
        """Return the options that affect what is read."""
        return {
            "labels": repr(self.label_rule),
            "intrinsics": intrinsics_option(self.intrinsics),
            "depth_scale": self.depth_scale,
        }

    def read(self, index: int) -> Frame:
        """Read one frame.

        Raises:
            FrameReadError: If a file is missing, damaged or of the wrong kind, or contains a label the rule does not
                define.
            FrameError: If the images differ in size or contain no depth.
        """
        frame = self._frames[index]
        return Frame(
            rgb=read_rgb(Path(frame.rgb)),
            depth=read_depth(Path(frame.depth), self.depth_scale),
            intrinsics=self.intrinsics,
            instances=None if frame.labels is None else read_instances(Path(frame.labels), self.label_rule),
            name=frame.name,
        )

    @cached_property
    def _frames(self) -> tuple[_Files, ...]:
        self._require_root()
        if self.split not in self.splits:
            raise self._not_found(f"there is no split {self.split!r}, only {', '.join(self.splits)}")
        subfolder = self.root / self.split
        folder = subfolder if subfolder.is_dir() else self.root
        found = _images(folder)
        if not found["rgb"]:
            raise self._not_found(f"there is no colour image in {folder}")
        without_depth = [name for name in found["rgb"] if name not in found["depth"]]
        if len(without_depth) == len(found["rgb"]):
            raise self._not_found(f"none of the {len(without_depth)} colour images in {folder} has a depth image")
        if self.intrinsics is None:
            info_once(
                log, "%s: the camera is unknown, a horizontal view of 59° is assumed (option: intrinsics)", self.root
            )
        # A missing depth image is reported when that frame is read, so that the other frames stay usable.
        return tuple(
            _Files(
                name,
                str(rgb),
                str(found["depth"].get(name) or _depth_path(rgb)),
                str(found["labels"][name]) if name in found["labels"] else None,
            )
            for name, rgb in sorted(found["rgb"].items())
        )


def _images(folder: Path) -> dict[str, dict[str, Path]]:
    """Return the image files as a mapping from kind to frame name to path."""
    found: dict[str, dict[str, Path]] = {kind: {} for kind in KINDS}
    in_subfolders = (folder / "rgb").is_dir() and (folder / "depth").is_dir()
    if in_subfolders:
        files = [
            (kind, path.stem, path) for kind in KINDS if (folder / kind).is_dir() for path in image_files(folder / kind)
        ]
    else:
        matches = ((_KIND_FILE.fullmatch(path.stem), path) for path in image_files(folder))
        files = [(match["kind"], match["name"], path) for match, path in matches if match]
    for kind, name, path in files:
        if name in found[kind]:
            raise FrameReadError(path, f"frame {name!r} has two {kind} images, this one and {found[kind][name].name}")
        found[kind][name] = path
    return found


def _depth_path(rgb: Path) -> Path:
    """Return the expected path of the depth image that belongs to a colour image."""
    if rgb.parent.name == "rgb":
        return rgb.parent.parent / "depth" / f"{rgb.stem}.png"
    return rgb.with_name(f"{rgb.stem.removesuffix('_rgb')}_depth.png")


def _labels_and_depth(frame: _Files, depth_scale: float) -> tuple[Any, Any] | None:
    """Read the images that rule detection needs, or return None if unreadable (reading the frame reports that)."""
    if frame.labels is None:
        return None
    try:
        return read_labels(Path(frame.labels)), read_depth(Path(frame.depth), depth_scale)
    except FrameReadError:
        return None
