"""The parameters of a synthetic dataset: everything that its frames depend on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from sgbd.sources.categories import TOD_CATEGORIES, TODZ_SEEN
from sgbd.sources.synthetic.variety import VARIETIES

GENERATOR_VERSION = 1
"""Increase this whenever a code change alters a frame, so that old and new frames are never mixed."""

SENSORS = ("clean", "kinect", "varied")
LATER = {"train_categories": None, "variety": "tabletop"}
"""Options added later: they are left out of the digest at these defaults, so that existing datasets stay valid."""
FOLDERS = {"train": "training_set", "val": "validation_set", "test": "test_set"}
FIRST_VIEW = 2
"""Number of a scene's first view; in TOD's layout, 0 is the empty room and 1 the empty table."""


@dataclass(frozen=True)
class Recipe:
    """Sizes, ranges and seed of a synthetic dataset.

    Attributes:
        train_frames: Number of training frames, with seen categories only.
        val_frames: Number of validation frames, of other scenes, also with seen categories only.
        test_frames: Number of test frames, with seen and unseen categories.
        views_per_scene: Number of views of each scene.
        objects: Minimum and maximum number of objects on the table.
        resolution: Width and height, pixels.
        sensor: `clean` (exact depth), `kinect` (structured light) or `varied` (a different camera for every frame).
        seed: Random seed; a larger dataset with the same seed starts with the same scenes.
        train_categories: Categories of the objects in training and validation frames; None for TOD-Z's 12 seen
            categories.
        variety: Kind of scenes, see `sgbd.sources.synthetic.variety`: `tabletop`, `wide`, `assorted` or `stacked`.

    Raises:
        ValueError: On construction, if a value is out of range.
    """

    train_frames: int
    val_frames: int
    test_frames: int
    views_per_scene: int
    objects: tuple[int, int]
    resolution: tuple[int, int]
    sensor: str
    seed: int
    train_categories: tuple[str, ...] | None = None
    variety: str = "tabletop"

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueError: If one is out of range.
        """
        for name in ("train_frames", "val_frames", "test_frames", "seed"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative; got {getattr(self, name)}")
        if self.views_per_scene < 1:
            raise ValueError(f"views_per_scene must be at least 1; got {self.views_per_scene}")
        low, high = self.objects
        if not 1 <= low <= high <= 40:
            raise ValueError(f"objects must be a range within 1 to 40, such as [5, 25]; got [{low}, {high}]")
        if min(self.resolution) < 64 or max(self.resolution) > 2048:
            raise ValueError(f"resolution must lie between 64 and 2048 pixels a side; got {list(self.resolution)}")
        if self.sensor not in SENSORS:
            raise ValueError(f"no sensor {self.sensor!r}; choose from {', '.join(SENSORS)}")
        if self.train_categories is not None:
            unknown = sorted(set(self.train_categories) - set(TOD_CATEGORIES))
            if unknown or not self.train_categories:
                raise ValueError(
                    f"train_categories must be some of {', '.join(TOD_CATEGORIES)}; got {list(self.train_categories)}"
                )
        if self.variety not in VARIETIES:
            raise ValueError(f"no variety {self.variety!r}; choose from {', '.join(VARIETIES)}")

    def frames(self, split: str) -> int:
        """Return the number of frames of a split."""
        return int(getattr(self, f"{split}_frames"))

    def categories(self, split: str) -> tuple[str, ...]:
        """Return the categories of the objects in a split."""
        if split == "test":
            return TOD_CATEGORIES
        chosen = TODZ_SEEN if self.train_categories is None else frozenset(self.train_categories)
        return tuple(name for name in TOD_CATEGORIES if name in chosen)

    def scenes(self, split: str) -> list[tuple[str, int]]:
        """Return folder (relative to the root) and number of views of each scene; the last may have fewer views."""
        full, rest = divmod(self.frames(split), self.views_per_scene)
        views = [self.views_per_scene] * full + [rest] * (rest > 0)
        return [(f"{FOLDERS[split]}/scene_{number:05d}", count) for number, count in enumerate(views)]

    def listed(self, split: str) -> list[str]:
        """Return the lines of the list file of a split."""
        return [
            f"{folder}/rgb_{view:05d}.jpeg"
            for folder, views in self.scenes(split)
            for view in range(FIRST_VIEW, FIRST_VIEW + views)
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return the recipe as plain JSON values."""
        values = asdict(self)
        # Use a fixed order: the frames do not depend on the order of the names.
        values["train_categories"] = self.train_categories and self.categories("train")
        plain = {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}
        kept = {key: value for key, value in plain.items() if key not in LATER or value != LATER[key]}
        return {"generator_version": GENERATOR_VERSION, **kept}

    def digest(self) -> str:
        """Return a digest of the recipe, ten hexadecimal digits."""
        return hashlib.sha256(json.dumps(self.as_dict(), sort_keys=True).encode()).hexdigest()[:10]


def pair(name: str, value: Sequence[int], meaning: str) -> tuple[int, int]:
    """Convert a sequence of two numbers to a tuple.

    Raises:
        ValueError: If there are not exactly two; the message contains the option's name and meaning.
    """
    if len(value) != 2:
        raise ValueError(f"{name} must be two numbers, {meaning}; got {list(value)}")
    return int(value[0]), int(value[1])
