"""Create zero-shot splits: choose the seen categories and the frames for training, validation and testing.

The rules are those of TOD-Z (E. P. Örnek et al., "SupeRGB-D: Zero-shot instance segmentation in cluttered indoor
environments", IEEE RA-L 8(6), 2023, doi:10.1109/LRA.2023.3271527), made explicit where the paper leaves them open:

- Categories form groups of similar ones. Half of each group (rounded down), drawn at random, is seen.
- Scenes are divided at random: all views of a scene belong to one pool, for training, validation or testing.
- Training and validation frames show objects of seen categories only, without a single pixel of any other.
- Test frames with seen categories only form the closed test set; test frames with at least one unseen category, with or
  without seen ones, form the open test set.
- Of the frames that qualify, those are chosen that balance the number of objects per category best.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sgbd.machine.progress_bar import ProgressBar
from sgbd.machine.workers import map_in_order
from sgbd.sources.tod import Tod

SETS = ("train", "val", "test_closed", "test_open")
"""The four sets of frames in a split."""

POOLS = {"train": "train", "val": "val", "test_closed": "test", "test_open": "test"}
"""The pool of scenes that each set is drawn from."""


class SplitError(ValueError):
    """A split cannot be created; the message says why and what to do."""


@dataclass(frozen=True, eq=False)
class Catalog:
    """The content of each frame of a dataset.

    Attributes:
        files: Colour image of each frame, relative to the dataset's root.
        scenes: Scene of each frame.
        category_names: The categories.
        objects: int64 [F, C], number of sufficiently large objects of each category in each frame.
        visible: bool [F, C], whether at least one pixel of the category is visible.
        unknown: int64 [F], number of objects without a category.
        background_views: Number of views left out because they precede the first view with objects.
    """

    files: tuple[str, ...]
    scenes: tuple[str, ...]
    category_names: tuple[str, ...]
    objects: npt.NDArray[np.int64]
    visible: npt.NDArray[np.bool_]
    unknown: npt.NDArray[np.int64]
    background_views: int


@dataclass(frozen=True, eq=False)
class ZeroShotSplit:
    """A split of a dataset's frames.

    Attributes:
        seen: The seen categories.
        sets: int64 [.], indices of the frames of each of the four `SETS`, ascending.
        candidates: Number of frames that qualify for each set.
        left_out: Number of frames that qualify for no set, by reason: `near_empty`, `unknown_category` (an object
            without a category), `mixed_in_training` (an unseen category in a scene for training or validation).
        scenes: Number of scenes in each pool.
    """

    seen: frozenset[str]
    sets: dict[str, npt.NDArray[np.int64]]
    candidates: dict[str, int]
    left_out: dict[str, int]
    scenes: dict[str, int]


def catalog(source: Tod, min_object_pixels: int, workers: int = 0, progress: bool = True) -> Catalog:
    """Count the objects in every frame of a dataset; existing split lists are ignored.

    Args:
        source: The dataset; any split.
        min_object_pixels: An object counts if it has at least this many visible pixels.
        workers: Number of worker processes; 0 to run in this process.
        progress: Whether to show a progress bar.

    Returns:
        The catalogue, in the order of folders, scenes and views.

    Raises:
        FrameReadError: If a mask or a description cannot be read.
        DatasetNotFoundError: If there is no dataset.
    """
    everything = Tod(source.root, "train", lists={}, seen=None, category_names=source.category_names)
    files, scenes, rows, background = [], [], [], 0
    # Without any folder, reading "train" raises the DatasetNotFoundError.
    for split in everything.splits or ("train",):
        folder = Tod(
            source.root,
            split,
            lists={},
            seen=None,
            category_names=source.category_names,
            first_view=source.first_view,
        )
        background += folder.filtered["background_views"]
        outcomes = map_in_order(_Count(folder, min_object_pixels), range(len(folder)), workers)
        rows += list(ProgressBar(outcomes, f"objects of {split}", len(folder), unit="frame", disable=not progress))
        files += [folder.files(index)[0].relative_to(source.root).as_posix() for index in range(len(folder))]
        scenes += [name.rpartition("/")[0] for name in folder.names]
    counts = np.array(rows, np.int64).reshape(len(rows), 2, -1)
    return Catalog(
        files=tuple(files),
        scenes=tuple(scenes),
        category_names=source.category_names,
        objects=counts[:, 0, 1:],
        visible=counts[:, 1, 1:] > 0,
        unknown=counts[:, 1, 0],
        background_views=background,
    )


def draw_seen(groups: Mapping[str, Sequence[str]], seed: int) -> frozenset[str]:
    """Draw the seen categories: half of each group, rounded down.

    Args:
        groups: Category names by group.
        seed: Random seed.
    """
    rng = np.random.default_rng(seed)
    return frozenset(
        names[place] for names in groups.values() for place in rng.permutation(len(names))[: len(names) // 2]
    )


def zero_shot_split(
    frames: Catalog,
    seen: Collection[str],
    sizes: Mapping[str, int | None],
    shares: Mapping[str, float],
    min_objects: int = 1,
    seed: int = 0,
) -> ZeroShotSplit:
    """Split the frames of a dataset.

    Args:
        frames: Catalogue of the frames.
        seen: The seen categories.
        sizes: Maximum number of frames in each of the four `SETS`; None for all that qualify.
        shares: Shares of the scenes for the pools "train", "val" and "test"; they add up to 1.
        min_objects: Frames with fewer objects are left out as near-empty.
        seed: Random seed for assigning scenes to pools and choosing among equally good frames.

    Returns:
        The split.

    Raises:
        SplitError: If a category is not in the dataset, the shares are invalid, or the training set would be empty.
    """
    unknown = sorted(set(seen) - set(frames.category_names))
    if unknown or not seen:
        raise SplitError(f"seen categories must be some of {', '.join(frames.category_names)}; got {sorted(seen)}")
    if set(shares) != {"train", "val", "test"} or min(shares.values()) < 0 or abs(sum(shares.values()) - 1) > 1e-6:
        raise SplitError(f"shares of train, val and test must not be negative and add up to 1; got {dict(shares)}")
    rng = np.random.default_rng(seed)
    pool, scenes = _pools(frames.scenes, shares, rng)
    is_unseen = np.array([name not in seen for name in frames.category_names])
    shows_unseen = frames.visible[:, is_unseen].any(axis=1)
    near_empty = frames.objects.sum(axis=1) < min_objects
    usable = ~near_empty & (frames.unknown == 0)
    chosen, candidates = {}, {}
    for name in SETS:
        qualifies = usable & (pool == POOLS[name]) & (shows_unseen == (name == "test_open"))
        places = np.flatnonzero(qualifies)
        candidates[name] = len(places)
        taken = balanced_choice(frames.objects[places], sizes.get(name), rng)
        chosen[name] = np.sort(places[taken])
    if not candidates["train"]:
        raise SplitError(
            f"none of {len(frames.files)} frames can be trained on: in the scenes for training "
            f"{int((usable & shows_unseen & (pool == 'train')).sum())} frames show unseen categories, "
            f"{int(near_empty.sum())} frames are near-empty, {int((frames.unknown > 0).sum())} show objects without a "
            "category. Choose other seen categories or a lower min_objects, or write the semantic masks first "
            "(python -m sgbd.semantic_masks)"
        )
    return ZeroShotSplit(
        seen=frozenset(seen),
        sets=chosen,
        candidates=candidates,
        left_out={
            "near_empty": int(near_empty.sum()),
            "unknown_category": int((~near_empty & (frames.unknown > 0)).sum()),
            "mixed_in_training": int((usable & shows_unseen & (pool != "test")).sum()),
        },
        scenes=scenes,
    )


def balanced_choice(
    objects: npt.NDArray[np.int64], size: int | None, rng: np.random.Generator
) -> npt.NDArray[np.int64]:
    """Choose frames greedily so that all categories have a similar number of objects.

    Each step adds the frame that makes the object counts n of the categories most even, i.e. that minimises Simpson's
    index: the sum of n² divided by the square of the sum of n.

    Args:
        objects: int64 [F, C], number of objects of each category in each frame.
        size: Number of frames; None, or more than there are, for all.
        rng: Random generator that breaks ties.

    Returns:
        int64 [size], indices of the frames in the order of choice.
    """
    order = rng.permutation(len(objects))
    if size is None or size >= len(objects):
        return order
    counts = objects[order].astype(np.float64)
    per_frame, squares = counts.sum(axis=1), (counts**2).sum(axis=1)
    total = np.zeros(counts.shape[1])
    free = np.ones(len(order), bool)
    chosen = np.empty(size, np.int64)
    for step in range(size):
        amount = total.sum() + per_frame
        unevenness = np.full(len(order), np.inf)
        # Frames without objects come last: they do not affect the balance.
        np.divide(total @ total + 2 * (counts @ total) + squares, amount**2, out=unevenness, where=amount > 0)
        unevenness[~free] = np.inf
        best = int(np.argmin(unevenness))
        if not free[best]:
            best = int(np.argmax(free))
        chosen[step], free[best] = order[best], False
        total += counts[best]
    return chosen


@dataclass(frozen=True)
class _Count:
    source: Tod
    min_object_pixels: int

    def __call__(self, index: int) -> npt.NDArray[np.int64]:
        """Count the objects of a frame.

        Returns:
            int64 [2, 1 + C]: row 0 counts sufficiently large objects, row 1 all; column 0 those without a category.
        """
        names = self.source.category_names
        counts = np.zeros((2, 1 + len(names)), np.int64)
        for item in self.source.objects(index):
            column = 0 if item.category is None else 1 + names.index(item.category)
            counts[1, column] += 1
            counts[0, column] += item.pixels >= self.min_object_pixels
        return counts


def _pools(
    scenes: Sequence[str], shares: Mapping[str, float], rng: np.random.Generator
) -> tuple[npt.NDArray[np.str_], dict[str, int]]:
    """Assign scenes to pools; return the pool of each frame and the number of scenes in each pool."""
    names = sorted(set(scenes))
    ends = np.round(np.cumsum([shares["train"], shares["val"], shares["test"]]) * len(names)).astype(int)
    of_scene: dict[str, str] = {}
    for rank, place in enumerate(rng.permutation(len(names))):
        of_scene[names[place]] = ("train", "val", "test")[int(np.searchsorted(ends, rank, side="right"))]
    sizes = {key: list(of_scene.values()).count(key) for key in ("train", "val", "test")}
    return np.array([of_scene[scene] for scene in scenes], dtype="<U5"), sizes
