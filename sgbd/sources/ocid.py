"""Read OCID, the Object Clutter Indoor Dataset."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sgbd.frame import MILLIMETERS, Frame, Intrinsics
from sgbd.sources.camera import intrinsics_from, intrinsics_option
from sgbd.sources.dataset_folder import DatasetFolder
from sgbd.sources.image import checked_depth_scale, read_depth, read_rgb
from sgbd.sources.label_rule import PLAIN, LabelRule, read_instances
from sgbd.sources.parts import checked_parts, natural_order
from sgbd.sources.point_cloud import organized_depth

SUBSETS = ("ARID20", "ARID10", "YCB10")

TABLE_SCENE = LabelRule(support=("1-2",), objects=("3-",))
"""Label rule of table scenes: labels 1 (surroundings) and 2 (table) are support; in floor scenes only label 1 is."""

XTION = Intrinsics(570.34, 570.34, 319.5, 239.5)
"""Camera that the OpenNI driver uses to project the 640x480 points of an ASUS Xtion."""

DEPTHS = {"depth": "png", "pcd": "pcd"}
"""Folders that depth can be read from, with their file suffix."""


class Ocid(DatasetFolder):
    """Real clutter of up to 20 objects, placed one by one on floors and tables, recorded by two ASUS Xtion cameras.

    | subset | objects from                       | a scene at most | scenes                                          |
    |--------|------------------------------------|-----------------|-------------------------------------------------|
    | ARID20 | Autonomous Robot Indoor Dataset    | 20 objects      | floor, table                                    |
    | ARID10 | Autonomous Robot Indoor Dataset    | 10 objects      | box, curved, fruits, non-fruits, mixed          |
    | YCB10  | Yale-CMU-Berkeley                  | 10 objects      | cuboid, curved, mixed                           |

    96 scenes with 89 different objects; 2346 labelled frames of 640x480 pixels, depth uint16 in millimetres.

    A sequence is a folder `{ARID20,ARID10,YCB10}/{floor,table}/{bottom,top}[/KIND]/seqNN` below `root` with
    `rgb/result_*.png`, `depth/result_*.png`, `label/result_*.png` and `pcd/result_*.pcd`. Label 0 is background and 1
    is the support; in table scenes 2 is support as well. Larger labels are objects.

    The SupeRGB-D paper (E. P. Örnek et al., IEEE RA-L 8(6), 2023, doi:10.1109/LRA.2023.3271527) uses two setups:
    sim2real trains on synthetic frames and tests on all of OCID (`dataset=ocid`); zero-shot trains on the ARID subsets
    and tests on YCB10, which has different objects (`dataset=ocid_zeroshot`).

    How to get it: https://www.acin.tuwien.ac.at/en/vision-for-robotics/software-tools/object-clutter-indoor-dataset/.
    Licence: as stated there. M. Suchi, T. Patten, D. Fischinger, M. Vincze, "EasyLabel: A semi-automatic pixel-wise
    object annotation tool for creating robotic RGB-D datasets", ICRA 2019, doi:10.1109/ICRA.2019.8793917.

    Args:
        root: Folder that contains the subsets.
        split: "train", "val" or "test".
        parts: Subsets of each split, or folders in them such as "ARID20/table"; by default all are test data.
        val_share: Share of the training sequences held out for validation if `parts` has no "val"; 0 for none.
        seed: Seed for choosing the held-out sequences.
        labels: Label rule of floor scenes.
        table_labels: Label rule of table scenes (scenes with a folder `table` in their path).
        depth: "depth" or "pcd"; the latter needs `pip install 'sgbd[pcd]'`.
        depth_scale: Metres per unit of the images in `depth`.
        intrinsics: Camera of all frames. None means: fitted to each point cloud with "pcd", unknown with "depth".

    Raises:
        ValueError: If `parts` is not a valid division into splits, or another option is out of range.
        FrameError: If `intrinsics` is not a valid camera.
    """

    layout = """
root/
    {ARID20,ARID10,YCB10}/{floor,table}/{bottom,top}/.../seq01/
        rgb/result_2018-08-21-14-53-22.png      8-bit colours
        depth/result_2018-08-21-14-53-22.png    uint16 millimetres, 0 = missing   (or pcd/)
        pcd/result_2018-08-21-14-53-22.pcd      640x480 points, row by row        (or depth/)
        label/result_2018-08-21-14-53-22.png    0 background, 1 support (on tables 2 too), more: objects
"""
    remedy = (
        "OCID is at https://www.acin.tuwien.ac.at/en/vision-for-robotics/software-tools/object-clutter-indoor-dataset/;"
        " unpack it and give the folder OCID-dataset as dataset.root. Without a download there is the embedded "
        "synthetic set: dataset=tabletop."
    )

    def __init__(
        self,
        root: str | Path,
        split: str = "test",
        parts: Mapping[str, Iterable[str]] | None = None,
        val_share: float = 0.1,
        seed: int = 0,
        labels: LabelRule = PLAIN,
        table_labels: LabelRule = TABLE_SCENE,
        depth: str = "depth",
        depth_scale: float = MILLIMETERS,
        intrinsics: Intrinsics | Mapping[str, Any] | None = XTION,
    ) -> None:
        self.parts = checked_parts({"test": SUBSETS} if parts is None else parts, split)
        if not 0 <= val_share < 1:
            raise ValueError(f"val_share must be a share of the training sequences, 0 to below 1; got {val_share}")
        if seed < 0:
            raise ValueError(f"seed must not be negative; got {seed}")
        if depth not in DEPTHS:
            raise ValueError(f"depth must be one of {', '.join(DEPTHS)}; got {depth!r}")
        self.root = Path(root).expanduser()
        self.split = split
        self.val_share = val_share
        self.seed = seed
        self.labels = labels
        self.table_labels = table_labels
        self.depth = depth
        self.depth_scale = checked_depth_scale(depth_scale)
        self.intrinsics = intrinsics_from(intrinsics)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """`sequence/frame` of each frame, e.g. ARID20/floor/top/seq01/result_2018-08-21-14-53-22."""
        names = []
        for sequence in self.sequences:
            folder = self.root / sequence
            if not (folder / self.depth).is_dir():
                other = next((name for name in DEPTHS if (folder / name).is_dir()), None)
                hint = f"; use dataset.depth={other}" if other else ""
                raise self._not_found(f"there is no folder {self.depth} in {sequence}{hint}")
            names += [f"{sequence}/{path.stem}" for path in sorted((folder / "rgb").glob("[!.]*.png"))]
        if not names:
            raise self._not_found(f"there is no colour image in the sequences of split {self.split!r}")
        return tuple(names)

    @property
    def splits(self) -> tuple[str, ...]:
        """The splits that have parts, and "val" if training sequences are held out."""
        held_out = "train" in self.parts and self.val_share > 0
        return tuple(
            split for split in ("train", "val", "test") if split in self.parts or (split == "val" and held_out)
        )

    def files(self, index: int) -> tuple[Path, ...]:
        """Return the colour, depth and label file of a frame."""
        sequence, _, name = self.names[index].rpartition("/")
        folder = self.root / sequence
        return (
            folder / "rgb" / f"{name}.png",
            folder / self.depth / f"{name}.{DEPTHS[self.depth]}",
            folder / "label" / f"{name}.png",
        )

    def options(self) -> Mapping[str, Any]:
        """Return the options that affect what is read."""
        return {
            "parts": {split: list(names) for split, names in self.parts.items()},
            "val_share": self.val_share,
            "seed": self.seed,
            "labels": repr(self.labels),
            "table_labels": repr(self.table_labels),
            "depth": self.depth,
            "depth_scale": self.depth_scale,
            "intrinsics": intrinsics_option(self.intrinsics),
        }

    def read(self, index: int) -> Frame:
        """Read one frame.

        Raises:
            FrameReadError: If a file is missing or damaged, or contains a label the rule does not define.
            FrameError: If the images differ in size or contain no depth.
        """
        name = self.names[index]
        rgb_path, depth_path, label_path = self.files(index)
        camera = self.intrinsics
        if self.depth == "pcd":
            depth, camera = organized_depth(depth_path, camera)
        else:
            depth = read_depth(depth_path, self.depth_scale)
        rule = self.table_labels if "table" in name.split("/") else self.labels
        return Frame(
            rgb=read_rgb(rgb_path),
            depth=depth,
            intrinsics=camera,
            instances=read_instances(label_path, rule),
            name=name,
        )

    @cached_property
    def sequences(self) -> tuple[str, ...]:
        """Folder of each sequence of the split, relative to the root."""
        self._require_root()
        if self.split not in self.splits:
            raise self._not_found(f"no part is split {self.split!r}, only {', '.join(self.splits)} (option: parts)")
        if self.split in self.parts and (self.split != "train" or "val" in self.parts or self.val_share == 0):
            return self._sequences_of(self.parts[self.split])
        sequences = self._sequences_of(self.parts["train"])
        count = max(1, round(self.val_share * len(sequences)))
        if count >= len(sequences):
            raise self._not_found(
                f"{', '.join(self.parts['train'])} holds {len(sequences)} sequences, too few to hold one out for "
                "validation (option: val_share)"
            )
        held_out = set(np.random.default_rng(self.seed).permutation(len(sequences))[:count].tolist())
        return tuple(name for place, name in enumerate(sequences) if (place in held_out) == (self.split == "val"))

    def _sequences_of(self, parts: Iterable[str]) -> tuple[str, ...]:
        found = []
        for part in parts:
            folder = self.root / part
            if not folder.is_dir():
                raise self._not_found(f"there is no folder {part}")
            its = []
            for path, folders, _ in os.walk(folder):
                if "rgb" in folders:
                    its.append(Path(path).relative_to(self.root).as_posix())
                    folders.clear()
            if not its:
                raise self._not_found(f"there is no sequence in {part}: no folder with a folder rgb")
            found += sorted(its, key=natural_order)
        return tuple(found)
