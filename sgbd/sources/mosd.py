"""mOSD: the Object Segmentation Database as re-annotated for the Point Cloud Library, in its own point clouds."""

from __future__ import annotations

import os
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
"""What the drivers of the first Kinect project 640x480 points with."""

FOLDERS = ("learn", "test")


class Mosd(DatasetFolder):
    """Kinect views of tabletops, one labelled point cloud (PCD) a frame.

    | part  | frames | boxes | stacked boxes | occluded | cylindric | mixed | complex |
    |-------|--------|-------|---------------|----------|-----------|-------|---------|
    | learn | 45     | 0-16  | 17-24         | 25-32    | 33-44     |       |         |
    | test  | 66     | 0-15  | 16-23         | 24-30    | 31-42     | 43-54 | 55-65   |

    Points have colours and a label: 0 where there is no depth (and beyond the table, which is cut off), 1 to 9 parts of
    the table, 20 to 29 parts of one object, 30 to 39 of the next. Most clouds are organised, 640x480 points row by row;
    a few are not, and their points are put back into the pixels of `intrinsics`, where the nearest point wins.

    Reading needs `pip install 'sgbd[pcd]'`. Frames exported as PNG triples are read with `dataset=mosd` instead.

    How to get it: https://github.com/PointCloudLibrary/data, folder segmentation/mOSD. Licence: distributed with
    permission of the author under the terms of the original database, see the README there. A. Richtsfeld, T. Mörwald,
    J. Prankl, M. Zillich, M. Vincze, "Segmentation of unknown objects in indoor environments", IROS 2012,
    doi:10.1109/IROS.2012.6385661; labels by S. Alexandrov.

    Args:
        root: Folder that holds `learn` and `test`.
        split: "train", "val" or "test".
        parts: Folders of each split; by default all frames are for testing.
        labels: What the labels mean.
        intrinsics: Camera of all frames; None fits it to each organised cloud, and takes Kinect's for the others.
        resolution: Width and height of the images that unorganised clouds are put back into, pixels.

    Raises:
        ValueError: If the parts are no division, or the resolution is none.
        FrameError: If `intrinsics` are no camera.
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

    @property
    def names(self) -> tuple[str, ...]:
        """`folder/name` of each frame, e.g. learn/learn0, in the order of their numbers."""
        return self._names

    @property
    def splits(self) -> tuple[str, ...]:
        """The splits that have a folder."""
        return tuple(split for split, names in self.parts.items() if any((self.root / n).is_dir() for n in names))

    def files(self, index: int) -> tuple[Path, ...]:
        """Return the point cloud of a frame."""
        return (self.root / f"{self._names[index]}.pcd",)

    def options(self) -> Mapping[str, Any]:
        """Return the options that change what is read."""
        return {
            "parts": {split: list(names) for split, names in self.parts.items()},
            "labels": repr(self.labels),
            "intrinsics": intrinsics_option(self.intrinsics),
            "resolution": list(self.resolution),
        }

    def read(self, index: int) -> Frame:
        """Read one frame.

        Raises:
            FrameReadError: If the cloud is missing, damaged, without colours, has a label without a meaning, or does
                not fit the camera.
            FrameError: If it holds no depth.
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
            name=self._names[index],
        )

    @cached_property
    def _names(self) -> tuple[str, ...]:
        self._require_root()
        if self.split not in self.parts:
            raise self._not_found(f"no part is split {self.split!r}, only {', '.join(self.parts)} (option: parts)")
        names = []
        for part in self.parts[self.split]:
            if not (self.root / part).is_dir():
                raise self._not_found(f"there is no folder {part}")
            found = [name[:-4] for name in os.listdir(self.root / part) if name.endswith(".pcd")]  # noqa: PTH208
            if not found:
                raise self._not_found(f"there is no point cloud (.pcd) in {part}")
            names += [f"{part}/{name}" for name in sorted(found, key=natural_order)]
        return tuple(names)
