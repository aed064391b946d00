"""Read mOSD, the Object Segmentation Database as re-annotated for the Point Cloud Library, from its point clouds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sgbd.frame import Frame, FrameError, Intrinsics
from sgbd.sources.camera import intrinsics_from, intrinsics_option
from sgbd.sources.dataset_folder import DatasetFolder
from sgbd.sources.errors import FrameReadError
from sgbd.sources.label_rule import MOSD, LabelRule
from sgbd.sources.parts import checked_parts, natural_order
from sgbd.sources.point_cloud import read_point_cloud

KINECT = Intrinsics(525.0, 525.0, 319.5, 239.5)
"""Camera that the drivers of the first Kinect use to project 640x480 points."""

FOLDERS = ("learn", "test")


class Mosd(DatasetFolder):
    """Kinect views of tabletops, one labelled point cloud (PCD) per frame.

    | part  | frames | boxes | stacked boxes | occluded | cylindric | mixed | complex |
    |-------|--------|-------|---------------|----------|-----------|-------|---------|
    | learn | 45     | 0-16  | 17-24         | 25-32    | 33-44     |       |         |
    | test  | 66     | 0-15  | 16-23         | 24-30    | 31-42     | 43-54 | 55-65   |

    Each point has a colour and a label: 0 if its depth is missing (everything beyond the table is cut off and counts as
    missing), 1 to 9 for parts of the table, 20 to 29 for parts of one object, 30 to 39 for parts of the next one. Most
    clouds are organised: 640x480 points, row by row. The few others are projected with `intrinsics`; if several points
    fall into a pixel, the nearest one is kept.

    Reading needs `pip install 'sgbd[pcd]'`. Frames exported as PNG triples are read with `dataset=mosd` instead.

    How to get it: https://github.com/PointCloudLibrary/data, folder segmentation/mOSD. Licence: distributed with
    permission of the author under the terms of the original database, see the README there. A. Richtsfeld, T. Mörwald,
    J. Prankl, M. Zillich, M. Vincze, "Segmentation of unknown objects in indoor environments", IROS 2012,
    doi:10.1109/IROS.2012.6385661; labels by S. Alexandrov.

    Args:
        root: Folder that contains `learn` and `test`.
        split: "train", "val" or "test".
        parts: Folders of each split; by default all are test data.
        labels: What the labels mean.
        intrinsics: Camera of all frames. None fits it to each organised cloud and uses the Kinect camera for others.
        resolution: Width and height in pixels of the images that unorganised clouds are projected to.

    Raises:
        ValueError: If `parts` is not a valid division into splits, or the resolution is invalid.
        FrameError: If `intrinsics` is not a valid camera.
    """

    layout = """
root/
    learn/learn0.pcd ...   fields x y z (metres), rgb or rgba, label; ascii, binary or binary_compressed
    test/test0.pcd ...
"""
    remedy = (
        "mOSD is the folder segmentation/mOSD of https://github.com/PointCloudLibrary/data; give it as dataset.root. "
        "PNG triples (NAME_rgb, NAME_depth in uint16 millimetres, NAME_labels) are read with dataset=mosd; "
        "without a download there is the embedded synthetic set: dataset=tabletop."
    )

    def __init__(
        self,
        root: str | Path,
        split: str = "test",
        parts: Mapping[str, Iterable[str]] | None = None,
        labels: LabelRule = MOSD,
        intrinsics: Intrinsics | Mapping[str, Any] | None = KINECT,
        resolution: Sequence[int] = (640, 480),
    ) -> None:
        self.parts = checked_parts({"test": FOLDERS} if parts is None else parts, split)
        self.root = Path(root).expanduser()
        self.split = split
        self.labels = labels
        self.intrinsics = intrinsics_from(intrinsics)
        if len(resolution) != 2 or min(resolution) < 1:
            raise ValueError(f"resolution must be two numbers, width and height in pixels; got {list(resolution)}")
        self.resolution = (int(resolution[0]), int(resolution[1]))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """`folder/name` of each frame, e.g. learn/learn0, in numerical order."""
        self._require_root()
        if self.split not in self.parts:
            raise self._not_found(f"no part is split {self.split!r}, only {', '.join(self.parts)} (option: parts)")
        names = []
        for part in self.parts[self.split]:
            if not (self.root / part).is_dir():
                raise self._not_found(f"there is no folder {part}")
            found = [path.stem for path in (self.root / part).glob("[!.]*.pcd")]
            if not found:
                raise self._not_found(f"there is no point cloud (.pcd) in {part}")
            names += [f"{part}/{name}" for name in sorted(found, key=natural_order)]
        return tuple(names)

    @property
    def splits(self) -> tuple[str, ...]:
        """The splits whose folders exist (at least one of them)."""
        return tuple(split for split, names in self.parts.items() if any((self.root / n).is_dir() for n in names))

    def files(self, index: int) -> tuple[Path, ...]:
        """Return the point cloud of a frame."""
        return (self.root / f"{self.names[index]}.pcd",)

    def options(self) -> Mapping[str, Any]:
        """Return the options that affect what is read."""
        return {
            "parts": {split: list(names) for split, names in self.parts.items()},
            "labels": repr(self.labels),
            "intrinsics": intrinsics_option(self.intrinsics),
            "resolution": list(self.resolution),
        }

    def read(self, index: int) -> Frame:
        """Read one frame.

        Raises:
            FrameReadError: If the cloud is missing, damaged or without colours, contains a label the rule does not
                define, or does not match the camera.
            FrameError: If it contains no depth.
        """
        (path,) = self.files(index)
        cloud = read_point_cloud(path)
        camera = self.intrinsics
        if not cloud.organized:
            camera = camera or KINECT
            width, height = self.resolution
            try:
                cloud = cloud.projected(camera, height, width)
            except ValueError as error:
                raise FrameReadError(path, str(error)) from error
        if cloud.rgb is None:
            raise FrameReadError(path, "the points need colours, a field rgb or rgba")
        shape = (cloud.height, cloud.width)
        instances = None
        if cloud.labels is not None:
            try:
                instances = self.labels(cloud.labels.reshape(shape))
            except FrameError as error:
                raise FrameReadError(path, str(error)) from error
        return Frame(
            rgb=np.ascontiguousarray(cloud.rgb.reshape(*shape, 3)),
            depth=cloud.depth(),
            intrinsics=camera or cloud.intrinsics(),
            instances=instances,
            name=self.names[index],
        )
