"""Read OSD, the Object Segmentation Database."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sgbd.frame import MILLIMETERS, Frame, Intrinsics
from sgbd.sources.camera import intrinsics_from, intrinsics_option
from sgbd.sources.dataset_folder import DatasetFolder
from sgbd.sources.errors import FrameReadError
from sgbd.sources.image import checked_depth_scale, read_depth, read_rgb
from sgbd.sources.label_rule import LabelRule, read_instances
from sgbd.sources.mosd import KINECT
from sgbd.sources.parts import checked_parts, natural_order
from sgbd.sources.point_cloud import organized_depth

OSD = LabelRule(support=(), objects=("1-",), offset=1)
"""Label rule: 0 is everything except objects, including the table; every other label is an object."""

PARTS = ("learn", "test")
DEPTHS = {"disparity": "png", "pcd": "pcd"}
"""Folders that depth can be read from, with their file suffix."""

RAW_KINECT_MISSING = 2047
"""Value that marks a missing measurement in the Kinect's raw 11-bit disparities."""


class Osd(DatasetFolder):
    """Kinect views of tabletops with boxes, cylinders and everyday objects, stacked and occluded.

    | part  | frames | boxes | stacked boxes | occluded | cylindric | mixed | complex |
    |-------|--------|-------|---------------|----------|-----------|-------|---------|
    | learn | 45     | 0-16  | 17-24         | 25-32    | 33-44     |       |         |
    | test  | 66     | 0-15  | 16-23         | 24-30    | 31-42     | 43-54 | 55-65   |

    The files below `root` are `image_color/NAME.png`, `disparity/NAME.png` (uint16 depth, despite the name),
    `pcd/NAME.pcd` (one point per colour pixel) and `annotation/NAME.png` (0 background and table, 1 and above objects);
    NAME is learn0 to learn44 and test0 to test65. Depth is read from either `disparity` or `pcd`; only one of them has
    to exist. Frames without an annotation have no ground truth.

    How to get it: https://www.acin.tuwien.ac.at/vision-for-robotics/software-tools/osd/ (OSD-0.2 or OSD-0.2-depth).
    Licence: as stated there. A. Richtsfeld, T. Mörwald, J. Prankl, M. Zillich, M. Vincze, "Segmentation of unknown
    objects in indoor environments", IROS 2012, doi:10.1109/IROS.2012.6385661.

    Args:
        root: Folder that contains `image_color`.
        split: "train", "val" or "test".
        parts: Name prefixes ("learn", "test") of each split's frames; by default all are test data.
        depth: "disparity" or "pcd"; the latter needs `pip install 'sgbd[pcd]'`.
        depth_scale: Metres per unit of the images in `disparity`.
        labels: What the values in `annotation` mean.
        intrinsics: Camera of all frames. None means: fitted to each point cloud with "pcd", unknown with "disparity".

    Raises:
        ValueError: If `parts` is not a valid division into splits, or `depth` or `depth_scale` is out of range.
        FrameError: If `intrinsics` is not a valid camera.
    """

    layout = """
root/
    image_color/learn0.png    8-bit colours
    disparity/learn0.png      uint16, depth in millimetres, 0 = missing   (or pcd/)
    pcd/learn0.pcd            640x480 points, row by row                  (or disparity/)
    annotation/learn0.png     0 background and table, 1+ objects          (optional)
"""
    remedy = (
        "OSD is at https://www.acin.tuwien.ac.at/vision-for-robotics/software-tools/osd/ (OSD-0.2, or OSD-0.2-depth); "
        "give its folder as dataset.root. Without a download there is the embedded synthetic set: dataset=tabletop."
    )

    def __init__(
        self,
        root: str | Path,
        split: str = "test",
        parts: Mapping[str, Iterable[str]] | None = None,
        depth: str = "disparity",
        depth_scale: float = MILLIMETERS,
        labels: LabelRule = OSD,
        intrinsics: Intrinsics | Mapping[str, Any] | None = KINECT,
    ) -> None:
        self.parts = checked_parts({"test": PARTS} if parts is None else parts, split)
        unknown = sorted({name for names in self.parts.values() for name in names} - set(PARTS))
        if unknown:
            raise ValueError(f"OSD has the parts {' and '.join(PARTS)}; got {', '.join(unknown)}")
        if depth not in DEPTHS:
            raise ValueError(f"depth must be one of {', '.join(DEPTHS)}; got {depth!r}")
        self.root = Path(root).expanduser()
        self.split = split
        self.depth = depth
        self.depth_scale = checked_depth_scale(depth_scale)
        self.labels = labels
        self.intrinsics = intrinsics_from(intrinsics)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each frame, such as learn0, part by part and in numerical order."""
        self._require_root()
        if self.split not in self.parts:
            raise self._not_found(f"no part is split {self.split!r}, only {', '.join(self.parts)} (option: parts)")
        for folder in ("image_color", self.depth):
            if not (self.root / folder).is_dir():
                hint = f"; use dataset.depth={other}" if folder != "image_color" and (other := self._other()) else ""
                raise self._not_found(f"there is no folder {folder}{hint}")
        found = [path.stem for path in (self.root / "image_color").glob("*.png")]
        names = []
        for part in self.parts[self.split]:
            its = sorted((name for name in found if name.rstrip("0123456789") == part), key=natural_order)
            if not its:
                raise self._not_found(f"there is no image {part}*.png in image_color")
            names += its
        return tuple(names)

    @property
    def splits(self) -> tuple[str, ...]:
        """The splits that have parts."""
        return tuple(self.parts)

    def files(self, index: int) -> tuple[Path, ...]:
        """Return the colour, depth and annotation file of a frame; the last may not exist."""
        name = self.names[index]
        return (
            self.root / "image_color" / f"{name}.png",
            self.root / self.depth / f"{name}.{DEPTHS[self.depth]}",
            self.root / "annotation" / f"{name}.png",
        )

    def options(self) -> Mapping[str, Any]:
        """Return the options that affect what is read."""
        return {
            "parts": {split: list(names) for split, names in self.parts.items()},
            "depth": self.depth,
            "depth_scale": self.depth_scale,
            "labels": repr(self.labels),
            "intrinsics": intrinsics_option(self.intrinsics),
        }

    def read(self, index: int) -> Frame:
        """Read one frame.

        Raises:
            FrameReadError: If a file is missing or damaged, if `disparity` contains raw disparities instead of depth,
                or if a label is not defined by the rule.
            FrameError: If the images differ in size or contain no depth.
        """
        rgb_path, depth_path, labels_path = self.files(index)
        depth, camera = self._depth(depth_path)
        return Frame(
            rgb=read_rgb(rgb_path),
            depth=depth,
            intrinsics=camera,
            instances=read_instances(labels_path, self.labels) if labels_path.exists() else None,
            name=self.names[index],
        )

    def _depth(self, path: Path) -> tuple[npt.NDArray[np.float32], Intrinsics | None]:
        if self.depth == "pcd":
            return organized_depth(path, self.intrinsics)
        depth = read_depth(path, self.depth_scale)
        raw = np.round(depth / self.depth_scale).astype(np.int64)
        if raw.max() == RAW_KINECT_MISSING and np.count_nonzero(raw == RAW_KINECT_MISSING) > 0.001 * raw.size:
            raise FrameReadError(
                path,
                f"these are Kinect's raw disparities ({RAW_KINECT_MISSING} stands for none) and no depth; take the "
                "depth from the point clouds: dataset.depth=pcd",
            )
        return depth, self.intrinsics

    def _other(self) -> str | None:
        return next((name for name in DEPTHS if name != self.depth and (self.root / name).is_dir()), None)
