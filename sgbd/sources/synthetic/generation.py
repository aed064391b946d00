"""Generate a synthetic dataset on disk, scene by scene in worker processes; each scene is written atomically."""

from __future__ import annotations

import json
import logging
import os
import shutil
from dataclasses import asdict
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from sgbd.machine.atomic_file import write_whole
from sgbd.machine.one_process_at_a_time import one_process_at_a_time
from sgbd.machine.processors import usable_processors
from sgbd.machine.progress_bar import ProgressBar
from sgbd.machine.workers import WorkerError, map_in_order
from sgbd.sources.categories import TABLE_CATEGORY, TOD_CATEGORIES, TOD_SYNSETS
from sgbd.sources.errors import MissingExtraError
from sgbd.sources.synthetic.recipe import FIRST_VIEW, FOLDERS, Recipe
from sgbd.sources.synthetic.variety import VARIETIES

log = logging.getLogger(__name__)

RECIPE_FILE = "dataset.json"
LISTS = {split: f"{split}.txt" for split in FOLDERS}


class GenerationError(RuntimeError):
    """A scene could not be generated or written; finished scenes are kept and not generated again."""


def is_complete(root: Path, recipe: Recipe) -> bool:
    """Return whether a folder contains all frames of a recipe."""
    return _stored_recipe(root) == recipe.as_dict() and all((root / name).is_file() for name in LISTS.values())


def generate(root: Path, recipe: Recipe, workers: int | None = None, progress: bool = True) -> None:
    """Write all frames of a recipe that do not exist yet.

    Processes that generate the same dataset at the same time do not conflict: the second one waits until the first has
    finished. An interrupted generation resumes where it stopped.

    Args:
        root: Folder of this dataset only.
        recipe: The dataset to generate.
        workers: Number of worker processes; None for one per core, 0 to run in this process. The frames do not depend
            on it.
        progress: Whether to show a progress bar.

    Raises:
        MissingExtraError: If a required package is not installed.
        GenerationError: If a scene cannot be generated, or the folder cannot be written.
    """
    if is_complete(root, recipe):
        return
    require_extra()
    if workers is None:
        workers = len(usable_processors())
    try:
        root.mkdir(parents=True, exist_ok=True)
        with one_process_at_a_time(root / ".lock", log, f"generates {root}"):
            if not is_complete(root, recipe):
                _generate_locked(root, recipe, workers, progress)
    except OSError as error:
        raise GenerationError(
            f"{root} cannot be written: {error.strerror or error}. Free space or choose another folder (root); "
            "finished scenes are kept and not made again."
        ) from error
    except WorkerError as error:
        raise GenerationError(f"{error} Finished scenes are kept and not made again.") from error


def require_extra() -> None:
    """Check that the packages needed for generating frames are installed.

    Raises:
        MissingExtraError: If one is missing; the message says how to install it.
    """
    for package in ("embreex.rtcore_scene", "mujoco", "trimesh"):
        try:
            import_module(package)
        except ImportError as error:
            raise MissingExtraError(
                f"making synthetic frames needs {package.split('.')[0]}, which cannot be imported ({error}). "
                "Install the extra: pip install 'sgbd[synthetic]'. Reading frames made before needs none of it."
            ) from error


def write_scene(root: Path, recipe: Recipe, split: str, number: int) -> Path:
    """Generate one scene and move it to its folder atomically.

    Args:
        root: Folder of the dataset.
        recipe: The dataset to generate.
        split: `train`, `val` or `test`.
        number: Index of the scene in the split.

    Returns:
        Folder of the scene.
    """
    from sgbd.sources.synthetic.scene import arrange, photograph

    folder, count = recipe.scenes(split)[number]
    target = root / folder
    temporary = target.with_name(f".{target.name}.{os.getpid()}")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    try:
        seed = np.random.SeedSequence([recipe.seed, list(FOLDERS).index(split), number])
        variety = VARIETIES[recipe.variety]
        arrangement = arrange(recipe.categories(split), recipe.objects, seed, variety)
        views = photograph(arrangement, count, recipe.sensor, recipe.resolution, seed, variety)
        names = [shape.category for shape in arrangement.shapes]
        category_of = np.zeros(256, dtype=np.uint8)
        category_of[1] = TABLE_CATEGORY
        # Packaging and made-up objects have no category.
        category_of[2 : 2 + len(names)] = [
            TOD_CATEGORIES.index(name) + 1 if name in TOD_CATEGORIES else 0 for name in names
        ]
        for k, view in enumerate(views):
            ending = f"{FIRST_VIEW + k:05d}"
            Image.fromarray(view.rgb).save(temporary / f"rgb_{ending}.jpeg", quality=95, subsampling=0)
            Image.fromarray(view.depth).save(temporary / f"depth_{ending}.png", compress_level=2)
            Image.fromarray(view.segmentation).save(temporary / f"segmentation_{ending}.png", compress_level=2)
            Image.fromarray(category_of[view.segmentation]).save(temporary / f"semseg_{ending}.png", compress_level=2)
        description = _description(recipe, split, number, arrangement, views)
        (temporary / "scene_description.txt").write_text(json.dumps(description, indent=1), encoding="utf-8")
        temporary.replace(target)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    return target


def _generate_locked(root: Path, recipe: Recipe, workers: int, progress: bool) -> None:
    stored = _stored_recipe(root)
    if stored is not None and stored != recipe.as_dict():
        raise GenerationError(f"{root} holds frames of another recipe ({root / RECIPE_FILE}); choose another folder")
    write_whole(root / RECIPE_FILE, (json.dumps(recipe.as_dict(), indent=1) + "\n").encode())
    tasks = []
    for split, folder in FOLDERS.items():
        (root / folder).mkdir(exist_ok=True)
        for leftover in (root / folder).glob(".scene_*"):
            shutil.rmtree(leftover, ignore_errors=True)
        tasks += [(split, k) for k, (scene, _) in enumerate(recipe.scenes(split)) if not (root / scene).is_dir()]
    views = [recipe.scenes(split)[number][1] for split, number in tasks]
    total = sum(recipe.frames(split) for split in FOLDERS)
    with ProgressBar(
        total=total, initial=total - sum(views), desc="generating frames", unit="frame", disable=not progress
    ) as bar:
        scenes = map_in_order(partial(_write_task, root, recipe, tasks), range(len(tasks)), workers, chunk_size=1)
        for count, _ in zip(views, scenes, strict=True):
            bar.update(count)
    for split, name in LISTS.items():
        write_whole(root / name, "".join(f"{line}\n" for line in recipe.listed(split)).encode())


def _write_task(root: Path, recipe: Recipe, tasks: list[tuple[str, int]], index: int) -> Path:
    split, number = tasks[index]
    try:
        return write_scene(root, recipe, split, number)
    except (OSError, MemoryError):
        raise
    except Exception as error:
        raise GenerationError(
            f"scene {number} of split {split!r} in {root}: {type(error).__name__}: {error}"
        ) from error


def _description(recipe: Recipe, split: str, number: int, arrangement: Any, views: list[Any]) -> dict[str, Any]:
    objects = []
    for k, (shape, pose) in enumerate(zip(arrangement.shapes, arrangement.poses, strict=True)):
        objects.append(
            {
                "instance": 2 + k,
                "category": shape.category,
                "synset": next((synset for synset, name in TOD_SYNSETS.items() if name == shape.category), None),
                "position": np.round(pose.position, 6).tolist(),
                "rotation": np.round(pose.turn, 6).tolist(),
                "size": np.round(shape.extents, 4).tolist(),
                "visible_pixels": [int((view.segmentation == 2 + k).sum()) for view in views],
            }
        )
    return {
        "seed": [recipe.seed, list(FOLDERS).index(split), number],
        "redrawn": arrangement.attempt,
        "intrinsics": asdict(views[0].camera.intrinsics),
        "table": {
            "round": arrangement.table.round,
            "size": np.round(arrangement.table.size, 4).tolist(),
            "height": round(arrangement.table.height, 4),
        },
        "object_descriptions": objects,
        "views": [
            {
                "view": FIRST_VIEW + k,
                "camera_position": np.round(view.camera.position, 6).tolist(),
                "camera_rotation": np.round(view.camera.turn, 6).tolist(),
            }
            for k, view in enumerate(views)
        ],
    }


def _stored_recipe(root: Path) -> Any:
    try:
        return json.loads((root / RECIPE_FILE).read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return None
