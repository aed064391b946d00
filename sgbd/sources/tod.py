"""Read the Tabletop Object Dataset (TOD), its zero-shot split TOD-Z, and any dataset with the same file layout."""

from __future__ import annotations

import json
import logging
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sgbd.frame import BACKGROUND, IGNORE, SUPPORT, Frame, FrameError, Intrinsics
from sgbd.machine.progress_bar import ProgressBar
from sgbd.sources.camera import intrinsics_from, intrinsics_from_view, intrinsics_option
from sgbd.sources.categories import TOD_CATEGORIES, TODZ_SEEN
from sgbd.sources.dataset_folder import DatasetFolder
from sgbd.sources.errors import FrameReadError
from sgbd.sources.image import read_depth, read_labels, read_rgb
from sgbd.sources.notices import info_once
from sgbd.sources.shapenet import SHAPENET_SYNSETS

log = logging.getLogger(__name__)

FOLDERS = {"train": "training_set", "val": "validation_set", "test": "test_set"}
"""Folder of each split, used if there are no list files."""

LISTS = {
    "train": ("train.txt", "train_ids.npy"),
    "val": ("val.txt", "val_ids.npy"),
    "test": ("test.txt", "test_open.txt", "test_ids.npy", "test_open_ids.npy"),
}
"""Possible names of the file that lists a split's frames; the first that exists is used."""

DESCRIPTION = "scene_description.txt"
VERTICAL_VIEW = 45.0
"""Vertical field of view of TOD's virtual camera, degrees, as in the loading parameters published by its authors."""

UNSEEN_OBJECTS = ("keep", "ignore", "leave_out")
"""Ways to treat objects of unseen categories in training and validation frames."""

_RGB_SUFFIXES = (".jpeg", ".jpg", ".png")
_FRAME_PATH = re.compile(
    r"(?:(?P<folder>training_set|validation_set|test_set)[\\/]+)?"
    r"(?P<scene>scene_\d+)[\\/]+(?P<kind>rgb|depth|segmentation|semseg)_(?P<view>\d+)(?P<suffix>\.jpeg|\.jpg|\.png)$"
)
_RGB_FILE = re.compile(r"rgb_(\d+)(\.jpeg|\.jpg|\.png)")
_SYNSET = re.compile(r"(?<!\d)(" + "|".join(SHAPENET_SYNSETS) + r")(?!\d)")


class _View(NamedTuple):
    scene: str
    """Folder of the scene relative to the root, e.g. training_set/scene_00012."""
    number: str
    suffix: str

    @property
    def name(self) -> str:
        return f"{self.scene}/{self.number}"


class _Files(NamedTuple):
    """The files of a view; the last two may not exist."""

    rgb: Path
    depth: Path
    segmentation: Path
    semseg: Path
    description: Path


class VisibleObject(NamedTuple):
    """An object that is visible in a frame.

    Attributes:
        instance: Instance id in the segmentation.
        pixels: Number of visible pixels.
        category: Category name; None if unknown.
        synset: ShapeNetCore category of the mesh; only set if the category was taken from the scene description.
    """

    instance: int
    pixels: int
    category: str | None
    synset: str | None = None


class Tod(DatasetFolder):
    r"""Rendered tabletop scenes in the layout of the Tabletop Object Dataset.

    | dataset | frames               | categories         | image   | depth            |
    |---------|----------------------|--------------------|---------|------------------|
    | TOD     | 40,000 scenes x 7    | ShapeNet's         | 640x480 | exact, uint16 mm |
    | TOD-Z   | 7118 train, 881 test | 12 seen, 13 unseen | 640x480 | exact, uint16 mm |

    Each scene is a folder `{training_set,validation_set,test_set}/scene_XXXXX` below `root`. It contains, for each view
    V, `rgb_0000V.jpeg`, `depth_0000V.png` (uint16 millimetres), `segmentation_0000V.png` (0 background, 1 table, 2 and
    above objects) and `semseg_0000V.png` (1 to 25 categories, 26 table), and one `scene_description.txt` (JSON).

    A list file defines each split: either `{train,val,test}.txt`, with a line such as
    `training_set/scene_00012/rgb_00003.jpeg` per frame, or TOD-Z's `{train,val,test_open}_ids.npy`, arrays of the paths
    of the segmentations. Any of a frame's images may stand for it. Leading folders of these paths are ignored; a scene
    that is not preceded by one of the three set folders is looked up in `training_set`. Without lists, a split is its
    folder without views 0 and 1, which show the room and the empty table.

    The category of an object is the majority category of its pixels in `semseg`. If that file is missing, it is the
    ShapeNet synset of the object's mesh in the scene description (object k has the id k + 2), and otherwise unknown.
    `python -m sgbd.semantic_masks` writes missing masks.

    To study fewer or other categories, no copy of the data is needed: `seen` selects the seen categories,
    `unseen_objects` defines how objects of other categories are treated in training and validation frames, and
    `max_train_frames` limits the number of training frames. Test frames are never changed or filtered by these options.

    The camera is `intrinsics` if given, otherwise `intrinsics` (fx, fy, cx, cy in pixels) in the scene description,
    otherwise TOD's own camera with a vertical field of view of 45°.

    Files are searched for on the first access to `names`, `splits` or a frame.

    How to get it: TOD is linked from https://github.com/chrisdxie/uois, the lists of TOD-Z from
    https://github.com/evinpinar/supergb-d. C. Xie, Y. Xiang, A. Mousavian, D. Fox, "Unseen object instance
    segmentation for robotic environments", IEEE T-RO 37(5), 2021, doi:10.1109/TRO.2021.3060341. TOD-Z: E. P. Örnek et
    al., "SupeRGB-D", IEEE RA-L 8(6), 2023, doi:10.1109/LRA.2023.3271527. Licence: as stated at the download; the meshes
    are from ShapeNet, for non-commercial research and education (https://shapenet.org/terms).

    Args:
        root: Folder that contains `training_set`, `test_set` and, optionally, the lists.
        split: "train", "val" or "test".
        lists: Location of the lists: a folder, or a mapping from split to file; None for `root`.
        seen: Categories that count as seen, i.e. that are trained on; None if there is no such division.
        category_names: Names of categories 1, 2, ... in `semseg`; the id after the last one is the table.
        intrinsics: Camera of all frames; overrides the scene descriptions.
        first_view: Without lists, views with a smaller number are left out.
        min_objects: Frames with fewer objects are left out as near-empty; ignored objects do not count. 0 keeps all
            frames and needs no image to be read.
        min_object_pixels: An object counts towards `min_objects` if it has at least this many visible pixels.
        unseen_objects: Treatment of objects outside the seen categories in training and validation frames: "keep"
            them, "ignore" them (their pixels become -1), or "leave_out" every frame that shows at least one pixel of
            such an object. Objects of unknown category count as unseen.
        max_train_frames: Maximum number of training frames, drawn at random after all other filters; None for all.
            With the same seed, a smaller number gives a subset of a larger one.
        subset_seed: Seed of that draw.

    Raises:
        ValueError: If the split is unknown, `seen` contains a name that is not a category, or one of the last three
            options is out of range.
        FrameError: If `intrinsics` is not a valid camera.
    """

    layout = """
root/
    {training_set,validation_set,test_set}/
        scene_00000/
            rgb_00002.jpeg           8-bit colours
            depth_00002.png          uint16 millimetres, 0 = missing
            segmentation_00002.png   0 background, 1 table, 2+ objects
            semseg_00002.png         1..25 category, 26 table   (optional)
            scene_description.txt    JSON                       (optional)
    {train,val,test}.txt             lines such as training_set/scene_00000/rgb_00002.jpeg   (optional)
"""
    remedy = (
        "The Tabletop Object Dataset is linked from https://github.com/chrisdxie/uois (the lists of TOD-Z from "
        "https://github.com/evinpinar/supergb-d); unpack it and give its folder as dataset.root. To start without a "
        "download, use the embedded synthetic set: dataset=tabletop."
    )

    def __init__(
        self,
        root: str | Path,
        split: str = "train",
        lists: str | Path | Mapping[str, str | Path] | None = None,
        seen: Iterable[str] | None = TODZ_SEEN,
        category_names: Iterable[str] = TOD_CATEGORIES,
        intrinsics: Intrinsics | Mapping[str, Any] | None = None,
        first_view: int = 2,
        min_objects: int = 0,
        min_object_pixels: int = 1,
        unseen_objects: str = "keep",
        max_train_frames: int | None = None,
        subset_seed: int = 0,
    ) -> None:
        if split not in FOLDERS:
            raise ValueError(f"no split {split!r}; choose from {', '.join(FOLDERS)}")
        self.root = Path(root).expanduser()
        self.split = split
        self.category_names = tuple(category_names)
        self.seen = frozenset(seen or ())
        unknown = sorted(self.seen - set(self.category_names))
        if unknown:
            raise ValueError(f"seen categories that do not exist: {unknown}; choose from {list(self.category_names)}")
        self.intrinsics = intrinsics_from(intrinsics)
        self.first_view = first_view
        self.min_objects = min_objects
        self.min_object_pixels = min_object_pixels
        if unseen_objects not in UNSEEN_OBJECTS:
            raise ValueError(f"unseen_objects must be one of {', '.join(UNSEEN_OBJECTS)}; got {unseen_objects!r}")
        if unseen_objects != "keep" and not self.seen:
            raise ValueError(f"unseen_objects={unseen_objects} needs the categories that are seen: set `seen`")
        if max_train_frames is not None and max_train_frames < 1:
            raise ValueError(f"max_train_frames must be at least 1, or null for all; got {max_train_frames}")
        if subset_seed < 0:
            raise ValueError(f"subset_seed must not be negative; got {subset_seed}")
        self.unseen_objects = unseen_objects
        self.max_train_frames = max_train_frames
        self.subset_seed = subset_seed
        self._list_location: Path | dict[str, Path]
        if isinstance(lists, Mapping):
            self._list_location = {key: Path(value).expanduser() for key, value in lists.items()}
        else:
            self._list_location = self.root if lists is None else Path(lists).expanduser()
        self._lists_required = lists is not None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """`folder/scene/view` of each frame, e.g. training_set/scene_00012/00003."""
        return tuple(view.name for view in self._views)

    @property
    def splits(self) -> tuple[str, ...]:
        """The splits that have a list or, if there are no lists, a folder."""
        if self._lists:
            return tuple(self._lists)
        return tuple(split for split, folder in FOLDERS.items() if (self.root / folder).is_dir())

    @property
    def filtered(self) -> Mapping[str, int]:
        """Number of views of the split that each rule left out.

        Keys: `background_views` (before `first_view`), `near_empty` (`min_objects`), `unseen_objects` and `not_drawn`
        (`max_train_frames`).
        """
        return {"background_views": self._candidates[1], **self._chosen[1]}

    def files(self, index: int) -> tuple[Path, ...]:
        """Return a frame's colour, depth, segmentation, semantic mask and description; the last two may not exist."""
        return self._files(self._views[index])

    def options(self) -> Mapping[str, Any]:
        """Return the options that affect what is read."""
        return {
            "intrinsics": intrinsics_option(self.intrinsics),
            "min_objects": self.min_objects,
            "min_object_pixels": self.min_object_pixels,
            "first_view": self.first_view,
            "unseen_objects": self.unseen_objects,
            "max_train_frames": self.max_train_frames,
            "subset_seed": self.subset_seed,
            "lists": {split: os.path.relpath(path, self.root) for split, path in self._lists.items()},
        }

    def read(self, index: int) -> Frame:
        """Read one frame.

        Raises:
            FrameReadError: If a file is missing, damaged, or contains an unknown category.
            FrameError: If the images differ in size or contain no depth.
        """
        view = self._views[index]
        files = self._files(view)
        rgb = read_rgb(files.rgb)
        description = _read_description(files.description)
        instances, objects = self._truth(view, description)
        if self._filters_unseen and self.unseen_objects == "ignore":
            ignored = [item.instance for item in objects if item.category not in self.seen]
            objects = [item for item in objects if item.category in self.seen]
            instances = np.where(np.isin(instances, ignored), np.int32(IGNORE), instances)
        return Frame(
            rgb=rgb,
            depth=read_depth(files.depth),
            intrinsics=self._camera(rgb.shape[1], rgb.shape[0], description, files.description),
            instances=instances,
            categories={item.instance: item.category for item in objects if item.category is not None},
            name=view.name,
        )

    def objects(self, index: int) -> list[VisibleObject]:
        """Return the objects in a frame, before `unseen_objects` is applied; colours and depth are not read.

        Raises:
            FrameReadError: If a file is missing, damaged, or contains an unknown category.
        """
        view = self._views[index]
        return self._truth(view, _read_description(self._files(view).description))[1]

    def semantic_mask(self, index: int) -> npt.NDArray[np.uint16]:
        """Return the semantic mask of a frame, i.e. the content that its `semseg` file has or should have.

        Returns:
            uint16 [H, W]: 1, 2, ... are the categories, the next number is the table; 0 is the background and objects
            of unknown category.

        Raises:
            FrameReadError: If a file is missing, damaged, or contains an unknown category.
        """
        view = self._views[index]
        instances, objects = self._truth(view, _read_description(self._files(view).description))
        value = np.zeros(max(int(instances.max()), SUPPORT) + 1, np.uint16)
        value[SUPPORT] = len(self.category_names) + 1
        for item in objects:
            if item.category is not None:
                value[item.instance] = self.category_names.index(item.category) + 1
        return value[instances]

    def _fingerprinted(self) -> Iterator[tuple[str, tuple[Path, ...]]]:
        # Cover all candidates: the filters are part of the options, so that a fingerprint needs no image to be read.
        return ((view.name, self._files(view)) for view in self._candidates[0])

    def _files(self, view: _View) -> _Files:
        scene = self.root / view.scene
        return _Files(
            scene / f"rgb_{view.number}{view.suffix}",
            scene / f"depth_{view.number}.png",
            scene / f"segmentation_{view.number}.png",
            scene / f"semseg_{view.number}.png",
            scene / DESCRIPTION,
        )

    @cached_property
    def _lists(self) -> dict[str, Path]:
        """The list file of each split that has one."""
        if isinstance(self._list_location, dict):
            return self._list_location
        found = {}
        for split, names in LISTS.items():
            paths = [self._list_location / name for name in names]
            existing = [path for path in paths if path.is_file()]
            if existing:
                found[split] = existing[0]
        if self._lists_required and not found:
            raise self._not_found(f"no list of a split in {self._list_location} ({', '.join(sum(LISTS.values(), ()))})")
        return found

    @cached_property
    def _candidates(self) -> tuple[tuple[_View, ...], int]:
        """The frames of the split before filtering by content, and the number of background views left out."""
        self._require_root()
        if self._lists and self.split not in self._lists:
            raise self._not_found(f"there is no list of split {self.split!r}, only of {', '.join(self._lists)}")
        views, background = self._views_of_list() if self._lists else self._views_of_folder()
        if not views:
            origin = self._lists.get(self.split, self.root / FOLDERS[self.split])
            raise self._not_found(f"{origin} names no frame of split {self.split!r}")
        return views, background

    def _views_of_list(self) -> tuple[tuple[_View, ...], int]:
        path = self._lists[self.split]
        views: dict[_View, None] = {}
        entries = _read_list(path)
        for number, entry in entries:
            match = _FRAME_PATH.search(entry)
            if match is None:
                raise FrameReadError(
                    path,
                    f"entry {number} is {entry!r}; expected a path that ends like "
                    "training_set/scene_00012/rgb_00003.jpeg",
                )
            scene = f"{match['folder'] or FOLDERS['train']}/{match['scene']}"
            suffix = match["suffix"] if match["kind"] == "rgb" else self._rgb_suffix(scene, match["view"])
            views[_View(scene, match["view"], suffix)] = None
        if len(views) < len(entries):
            log.warning("%s names %d frames twice; each is read once", path, len(entries) - len(views))
        if views and not any(self._files(view).rgb.exists() for view in views):
            first = self._files(next(iter(views))).rgb
            raise self._not_found(f"none of the {len(views)} frames that {path} lists is there; the first is {first}")
        return tuple(views), 0

    def _rgb_suffix(self, scene: str, number: str) -> str:
        """Return the suffix of the colour image of a view; TOD's if there is no such image."""
        present = (s for s in _RGB_SUFFIXES if self._files(_View(scene, number, s)).rgb.exists())
        return next(present, _RGB_SUFFIXES[0])

    def _views_of_folder(self) -> tuple[tuple[_View, ...], int]:
        folder = FOLDERS[self.split]
        if not (self.root / folder).is_dir():
            raise self._not_found(f"there is no folder {folder} for split {self.split!r}, and there are no lists")
        views = []
        background = 0
        with os.scandir(self.root / folder) as scenes:
            names = sorted(scene.name for scene in scenes if scene.name.startswith("scene_") and scene.is_dir())
        for scene in names:
            matches = (_RGB_FILE.fullmatch(name) for name in sorted(os.listdir(self.root / folder / scene)))  # noqa: PTH208
            for match in filter(None, matches):
                if int(match[1]) >= self.first_view:
                    views.append(_View(f"{folder}/{scene}", match[1], match[2]))
                else:
                    background += 1
        return tuple(views), background

    @property
    def _views(self) -> tuple[_View, ...]:
        """The frames of the split, after filtering."""
        return self._chosen[0]

    @cached_property
    def _chosen(self) -> tuple[tuple[_View, ...], dict[str, int]]:
        """The frames of the split, and the number of candidates that each rule left out."""
        candidates, background = self._candidates
        left_out = dict.fromkeys(("near_empty", "unseen_objects", "not_drawn"), 0)
        views = list(candidates)
        if self.min_objects > 0 or (self._filters_unseen and self.unseen_objects == "leave_out"):
            # Image decoding releases the GIL, so threads are enough.
            with ThreadPoolExecutor(min(8, os.cpu_count() or 1)) as pool:
                verdicts = list(
                    ProgressBar(
                        pool.map(self._why_not, candidates),
                        total=len(candidates),
                        desc=f"choosing frames of {self.split}",
                        unit="frame",
                        leave=False,
                    )
                )
            views = [view for view, verdict in zip(candidates, verdicts, strict=True) if verdict is None]
            for verdict in filter(None, verdicts):
                left_out[verdict] += 1
        if not views:
            raise self._not_found(
                f"none of the {len(candidates)} frames of split {self.split!r} is left: "
                f"{left_out['near_empty']} have fewer than {self.min_objects} objects of {self.min_object_pixels} "
                f"pixels (min_objects, min_object_pixels), {left_out['unseen_objects']} show objects of unseen "
                "categories (unseen_objects)"
            )
        if self.split == "train" and self.max_train_frames is not None:
            drawn = np.random.default_rng(self.subset_seed).permutation(len(views))[: self.max_train_frames]
            left_out["not_drawn"] = len(views) - len(drawn)
            views = [views[place] for place in sorted(drawn)]
        if background or any(left_out.values()):
            info_once(
                log,
                "%s, %s: %d frames; left out: %d views before number %d, %d with fewer than %d objects of %d pixels, "
                "%d with unseen objects, %d not drawn",
                self.root,
                self.split,
                len(views),
                background,
                self.first_view,
                left_out["near_empty"],
                self.min_objects,
                self.min_object_pixels,
                left_out["unseen_objects"],
                left_out["not_drawn"],
            )
        return tuple(views), left_out

    @property
    def _filters_unseen(self) -> bool:
        return self.unseen_objects != "keep" and self.split != "test"

    def _why_not(self, view: _View) -> str | None:
        """Return the name of the rule that leaves a candidate out, or None if it is kept."""
        try:
            if self._filters_unseen:
                _, objects = self._truth(view, _read_description(self._files(view).description))
                seen = [item.pixels for item in objects if item.category in self.seen]
                if self.unseen_objects == "leave_out" and len(seen) < len(objects):
                    return "unseen_objects"
                pixels = np.array(seen, dtype=int)
            else:
                pixels = np.bincount(read_labels(self._files(view).segmentation).ravel())[SUPPORT + 1 :]
        except FrameReadError:
            return None  # kept, so that reading the frame reports it
        enough = np.count_nonzero(pixels >= max(1, self.min_object_pixels)) >= self.min_objects
        return None if enough else "near_empty"

    def _truth(self, view: _View, description: Mapping[str, Any]) -> tuple[npt.NDArray[np.int32], list[VisibleObject]]:
        """Return the segmentation of a view and the objects in it."""
        files = self._files(view)
        instances = read_labels(files.segmentation)
        pixels = np.bincount(instances.ravel())
        visible = SUPPORT + 1 + np.flatnonzero(pixels[SUPPORT + 1 :])
        if files.semseg.exists():
            categories = self._categories_of_pixels(instances, read_labels(files.semseg), files.semseg)
            synsets: dict[int, str] = {}
        else:
            synsets = _synsets_of_meshes(visible.tolist(), description)
            categories = {key: name for key, name in synsets.items() if name in self.category_names}
        return instances, [
            VisibleObject(key, int(pixels[key]), categories.get(key), synsets.get(key)) for key in visible.tolist()
        ]

    def _categories_of_pixels(
        self, instances: npt.NDArray[np.int32], semseg: npt.NDArray[np.int32], path: Path
    ) -> dict[int, str]:
        if semseg.shape != instances.shape:
            raise FrameReadError(path, f"the mask is {semseg.shape} pixels, the segmentation {instances.shape}")
        table = len(self.category_names) + 1
        highest = int(semseg.max())
        if highest > table:
            raise FrameReadError(
                path,
                f"category {highest} is unknown; 1 to {table - 1} are {', '.join(self.category_names)}, {table} is the "
                "table and 0 the background (the dataset's category_names option sets others)",
            )
        objects = instances > SUPPORT
        pairs = instances[objects] * (table + 1) + semseg[objects]
        votes = np.bincount(pairs, minlength=(int(instances.max()) + 1) * (table + 1)).reshape(-1, table + 1)
        winners = votes.argmax(axis=1)
        named = np.flatnonzero(votes.any(axis=1) & (winners != BACKGROUND) & (winners != table))
        return {int(identity): self.category_names[winners[identity] - 1] for identity in named}

    def _camera(self, width: int, height: int, description: Mapping[str, Any], path: Path) -> Intrinsics:
        try:
            camera = self.intrinsics or intrinsics_from(description.get("intrinsics"))
        except FrameError as error:
            raise FrameReadError(path, str(error)) from error
        return camera or intrinsics_from_view(width, height, VERTICAL_VIEW)


def _synsets_of_meshes(visible: Iterable[int], description: Mapping[str, Any]) -> dict[int, str]:
    """Return the ShapeNetCore category of each visible instance; instance k is object k - 2 of the description."""
    objects = description.get("object_descriptions", [])
    synsets = {}
    for instance in visible:
        position = instance - SUPPORT - 1
        mesh = objects[position].get("mesh_filename", "") if position < len(objects) else ""
        match = _SYNSET.search(mesh)
        if match:
            synsets[instance] = SHAPENET_SYNSETS[match[1]]
    return synsets


def _read_description(path: Path) -> Mapping[str, Any]:
    """Read a scene description; return an empty one if the file does not exist."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise FrameReadError(path, f"the scene's description cannot be read as JSON: {error}") from error
    if not isinstance(content, dict):
        raise FrameReadError(path, f"the scene's description must be a JSON object; got {type(content).__name__}")
    return content


def _read_list(path: Path) -> list[tuple[int, str]]:
    """Return number (from 1) and text of each entry of a list, without blank lines and lines that start with #."""
    try:
        if path.suffix == ".npy":
            array = np.load(path, allow_pickle=False)
            if array.dtype.kind not in "US":
                raise FrameReadError(path, f"expected an array of paths (text); got {array.dtype}")
            entries: list[str] = np.char.asarray(array.ravel()).astype(str).tolist()
        else:
            entries = path.read_text(encoding="utf-8-sig").splitlines()  # Windows writes a byte order mark
    except (OSError, ValueError) as error:
        if isinstance(error, FrameReadError):
            raise
        raise FrameReadError(path, f"the list of frames cannot be read: {error}") from error
    lines = ((number, entry.strip()) for number, entry in enumerate(entries, start=1))
    return [(number, entry) for number, entry in lines if entry and not entry.startswith("#")]
