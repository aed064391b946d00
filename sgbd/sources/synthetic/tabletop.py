"""The embedded synthetic dataset as a frame source."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from pathlib import Path

from sgbd.sources.categories import TODZ_SEEN
from sgbd.sources.synthetic import generation
from sgbd.sources.synthetic.recipe import Recipe, pair
from sgbd.sources.tod import Tod


class Tabletop(Tod):
    """Synthetic tabletop clutter with TOD's 25 categories, generated on demand and stored in the TOD layout.

    A rigid-body simulation drops parametric objects on a table in a furnished room, and a ray caster renders them with
    light sources, shadows and textures. Training and validation frames contain the 12 seen categories of TOD-Z, test
    frames all 25.

    | split | frames (default) | categories         |
    |-------|------------------|--------------------|
    | train | 400              | 12 seen            |
    | val   | 50               | 12 seen            |
    | test  | 100              | 12 seen, 13 unseen |

    The frames of each recipe are stored in their own folder, `root/<name>-<digest of the recipe>`, so that changing an
    argument never reads outdated frames. Reading does not generate frames: call `generate` first.

    Args:
        root: Parent folder of the generated datasets.
        split: "train", "val" or "test".
        train_frames: Number of training frames.
        val_frames: Number of validation frames.
        test_frames: Number of test frames.
        views_per_scene: Number of views of each scene.
        objects: Minimum and maximum number of objects on the table.
        resolution: Width and height, pixels.
        sensor: "clean" for exact depth as in TOD; "kinect" for quantised depth with holes and a noisy colour camera;
            "varied" for a different camera in every frame: structured light, stereo or exact, with or without depth
            beyond the table.
        seed: Random seed; the frames do not depend on the number of workers.
        variety: "tabletop" for clutter on tables; "wide" for scenes from a single box on the floor to heaps and stacks;
            "assorted" for "wide" with additional made-up objects without a category; "stacked" for "assorted" with more
            stacks and rows.
        name: Prefix of the dataset's folder name.
        train_categories: Categories of the objects in training and validation frames; None for TOD-Z's 12 seen
            categories.
        min_objects, min_object_pixels, seen, unseen_objects, max_train_frames, subset_seed: As in `sgbd.sources.Tod`;
            they select among the generated frames and do not affect the recipe.

    Raises:
        ValueError: If a value is out of range.
    """

    remedy = (
        "Generate the frames with Tabletop(...).generate(), or python -m sgbd.prepare dataset=tabletop; this needs "
        "pip install 'sgbd[synthetic]'. What is already there is not made again."
    )

    def __init__(
        self,
        root: str | Path,
        split: str = "train",
        train_frames: int = 400,
        val_frames: int = 50,
        test_frames: int = 100,
        views_per_scene: int = 5,
        objects: Sequence[int] = (5, 25),
        resolution: Sequence[int] = (640, 480),
        sensor: str = "clean",
        seed: int = 0,
        variety: str = "tabletop",
        name: str = "tabletop",
        train_categories: Iterable[str] | None = None,
        min_objects: int = 0,
        min_object_pixels: int = 1,
        seen: Iterable[str] | None = TODZ_SEEN,
        unseen_objects: str = "keep",
        max_train_frames: int | None = None,
        subset_seed: int = 0,
    ) -> None:
        self.recipe = Recipe(
            train_frames=train_frames,
            val_frames=val_frames,
            test_frames=test_frames,
            views_per_scene=views_per_scene,
            objects=pair("objects", objects, "least and largest number"),
            resolution=pair("resolution", resolution, "width and height in pixels"),
            sensor=sensor,
            seed=seed,
            train_categories=None if train_categories is None else tuple(train_categories),
            variety=variety,
        )
        self.name = name
        folder = Path(root).expanduser() / f"{name}-{self.recipe.digest()}"
        super().__init__(
            folder,
            split,
            seen=seen,
            min_objects=min_objects,
            min_object_pixels=min_object_pixels,
            unseen_objects=unseen_objects,
            max_train_frames=max_train_frames,
            subset_seed=subset_seed,
        )

    @property
    def splits(self) -> tuple[str, ...]:
        """The splits that have frames."""
        return tuple(split for split in super().splits if self.recipe.frames(split) > 0)

    @property
    def generated(self) -> bool:
        """Whether all frames have been generated."""
        return generation.is_complete(self.root, self.recipe)

    def generate(self, workers: int | None = None, progress: bool = True) -> None:
        """Generate the missing frames of all splits.

        Needs the extra `sgbd[synthetic]`. An interrupted generation resumes where it stopped.

        Args:
            workers: Number of worker processes; None for one per core, 0 to run in this process. The frames do not
                depend on it.
            progress: Whether to show a progress bar.

        Raises:
            MissingExtraError: If the extra is not installed.
            GenerationError: If a scene cannot be generated or written.
        """
        generation.generate(self.root, self.recipe, workers, progress)

    @cached_property
    def _lists(self) -> dict[str, Path]:
        if not self.generated:
            raise self._not_found(
                "its generation was not finished" if self.root.is_dir() else "its frames have not been generated"
            )
        return super()._lists
