"""Tiny datasets in the layouts of OCID, OSD and mOSD."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from sgbd.frame import Frame, Intrinsics
from tests.scenes import scene
from tests.sources.pcd_files import pack_colors, write_pcd

SCENE_CAMERA = Intrinsics(50.0, 50.0, 31.5, 23.5)


def save(path: Path, array: npt.NDArray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(array).save(path)


def millimeters(frame: Frame) -> npt.NDArray[np.uint16]:
    return (frame.depth * 1000).round().astype(np.uint16)


def write_cloud(path: Path, frame: Frame, labels: npt.NDArray | None, encoding: str, organized: bool = True) -> None:
    """Write a frame as a point cloud of `SCENE_CAMERA`; if unorganised, without the points that have no depth."""
    rows, columns = np.indices(frame.depth.shape)
    camera = SCENE_CAMERA
    xyz = np.stack(
        [
            (columns - camera.cx) / camera.fx * frame.depth,
            (rows - camera.cy) / camera.fy * frame.depth,
            np.where(frame.depth > 0, frame.depth, np.nan),
        ],
        axis=2,
    ).astype(np.float32)
    fields = {name: xyz[..., place].ravel() for place, name in enumerate("xyz")}
    fields["rgba"] = pack_colors(frame.rgb)
    if labels is not None:
        fields["label"] = labels.ravel().astype(np.uint32)
    height, width = frame.depth.shape
    if not organized:
        present = np.flatnonzero(frame.depth.ravel() > 0)
        fields = {name: values[present] for name, values in fields.items()}
        height, width = 1, len(present)
    write_pcd(path, fields, height, width, encoding)


def with_holes(number: int) -> Frame:
    frame = scene(number)
    depth = frame.depth.copy()
    depth[:3, :5] = 0
    return replace(frame, depth=depth)


def mosd_labels(frame: Frame) -> npt.NDArray[np.int64]:
    """Return mOSD labels: 0 no depth, 1-9 table, 20-29 one object, ...; even and odd columns are different parts."""
    assert frame.instances is not None
    parts = np.arange(frame.width)[None] % 2
    labels = np.where(frame.instances > 1, 10 * frame.instances + parts, 1 + parts)
    return np.where(frame.depth > 0, labels, 0)


def write_mosd(root: Path) -> dict[str, Frame]:
    """Write frames learn0, learn2, learn10 and test0, in all encodings; test0 is unorganised."""
    kinds = {
        "learn/learn0": ("binary_compressed", True),
        "learn/learn2": ("binary", True),
        "learn/learn10": ("ascii", True),
        "test/test0": ("binary_compressed", False),
    }
    frames = {}
    for number, (name, (encoding, organized)) in enumerate(kinds.items()):
        frames[name] = with_holes(number)
        write_cloud(root / f"{name}.pcd", frames[name], mosd_labels(frames[name]), encoding, organized)
    return frames


def osd_labels(frame: Frame) -> npt.NDArray[np.uint8]:
    assert frame.instances is not None
    return np.maximum(frame.instances - 1, 0).astype(np.uint8)


def write_osd(root: Path, clouds: bool = False) -> dict[str, Frame]:
    """Write frames learn0, learn10, learn2 and test1."""
    frames = {name: with_holes(number) for number, name in enumerate(("learn0", "learn10", "learn2", "test1"))}
    for name, frame in frames.items():
        save(root / "image_color" / f"{name}.png", frame.rgb)
        save(root / "annotation" / f"{name}.png", osd_labels(frame))
        if clouds:
            write_cloud(root / "pcd" / f"{name}.pcd", frame, None, "binary_compressed")
        else:
            save(root / "disparity" / f"{name}.png", millimeters(frame))
    return frames


OCID_SEQUENCES = (
    "ARID20/floor/bottom/seq01",
    "ARID20/table/top/seq02",
    "ARID10/floor/top/box/seq03",
    "ARID10/table/bottom/non-fruits/seq10",
    "YCB10/table/bottom/cuboid/seq01",
)


def ocid_labels(frame: Frame, sequence: str) -> npt.NDArray[np.uint8]:
    """Return OCID labels: the support is 1 on the floor, 1 (upper half) and 2 on a table; objects follow."""
    assert frame.instances is not None
    if "/table/" not in sequence:
        return frame.instances.astype(np.uint8)
    upper = np.arange(frame.height)[:, None] < frame.height // 2
    return np.select(
        [frame.instances == 0, (frame.instances == 1) & upper], [0, 1], default=frame.instances + 1
    ).astype(np.uint8)


def write_ocid(root: Path, clouds: bool = False) -> dict[str, Frame]:
    """Write two frames in each of five sequences."""
    frames = {}
    for number, sequence in enumerate(OCID_SEQUENCES):
        for view in range(2):
            name = f"result_2018-08-2{number}-14-53-0{view}"
            frame = with_holes(2 * number + view)
            folder = root / sequence
            save(folder / "rgb" / f"{name}.png", frame.rgb)
            save(folder / "label" / f"{name}.png", ocid_labels(frame, sequence))
            if clouds:
                write_cloud(folder / "pcd" / f"{name}.pcd", frame, None, "binary")
            else:
                save(folder / "depth" / f"{name}.png", millimeters(frame))
            frames[f"{sequence}/{name}"] = frame
    return frames
