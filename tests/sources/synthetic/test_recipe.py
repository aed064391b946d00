from __future__ import annotations

from dataclasses import replace

import pytest

from sgbd.sources.categories import TOD_CATEGORIES, TODZ_SEEN
from sgbd.sources.synthetic import Recipe

RECIPE = Recipe(
    train_frames=7,
    val_frames=2,
    test_frames=3,
    views_per_scene=3,
    objects=(5, 25),
    resolution=(640, 480),
    sensor="clean",
    seed=0,
)


def test_the_last_scene_has_the_rest_of_the_views() -> None:
    assert RECIPE.scenes("train") == [
        ("training_set/scene_00000", 3),
        ("training_set/scene_00001", 3),
        ("training_set/scene_00002", 1),
    ]


def test_views_are_numbered_from_two() -> None:
    assert RECIPE.listed("test") == [f"test_set/scene_00000/rgb_{view:05d}.jpeg" for view in (2, 3, 4)]
    assert RECIPE.listed("val") == [f"validation_set/scene_00000/rgb_{view:05d}.jpeg" for view in (2, 3)]


def test_a_split_without_frames_has_no_scenes() -> None:
    assert replace(RECIPE, val_frames=0).scenes("val") == []


def test_only_test_frames_hold_unseen_categories() -> None:
    assert set(RECIPE.categories("train")) == set(RECIPE.categories("val")) == TODZ_SEEN
    assert RECIPE.categories("test") == TOD_CATEGORIES


def test_training_categories_can_be_chosen() -> None:
    chosen = replace(RECIPE, train_categories=("mug", "bowl"))
    assert chosen.categories("train") == chosen.categories("val") == ("bowl", "mug")
    assert chosen.categories("test") == TOD_CATEGORIES
    assert chosen.digest() == replace(RECIPE, train_categories=("bowl", "mug")).digest()
    # Datasets generated before the option existed stay valid.
    assert "train_categories" not in RECIPE.as_dict()


@pytest.mark.parametrize(
    "change",
    [
        {"train_categories": ("mug",)},
        {"train_frames": 8},
        {"val_frames": 3},
        {"test_frames": 4},
        {"views_per_scene": 2},
        {"objects": (5, 24)},
        {"resolution": (320, 240)},
        {"sensor": "kinect"},
        {"sensor": "varied"},
        {"variety": "wide"},
        {"seed": 1},
    ],
)
def test_every_value_is_in_the_digest(change: dict[str, object]) -> None:
    assert replace(RECIPE, **change).digest() != RECIPE.digest()  # type: ignore[arg-type]


def test_the_digest_is_that_of_equal_values() -> None:
    assert replace(RECIPE).digest() == RECIPE.digest()
    assert len(RECIPE.digest()) == 10


def test_the_default_datasets_digest_stays_what_it_was() -> None:
    """Options added later must not invalidate existing frames."""
    recipe = replace(RECIPE, train_frames=400, val_frames=50, test_frames=100, views_per_scene=5)
    assert recipe.digest() == "af37f21e24"
    assert "variety" not in recipe.as_dict()
    assert replace(recipe, variety="wide").as_dict()["variety"] == "wide"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"train_frames": -1}, "train_frames must not be negative; got -1"),
        ({"train_categories": ("teapot",)}, r"train_categories must be some of ashcan.*got \['teapot'\]"),
        ({"train_categories": ()}, "train_categories must be some of"),
        ({"views_per_scene": 0}, "views_per_scene must be at least 1; got 0"),
        ({"objects": (9, 3)}, r"objects must be a range .* got \[9, 3\]"),
        ({"objects": (0, 3)}, "objects must be a range"),
        ({"objects": (5, 400)}, "objects must be a range"),
        ({"resolution": (10, 480)}, r"resolution must lie between .* got \[10, 480\]"),
        ({"sensor": "lidar"}, "no sensor 'lidar'; choose from clean, kinect, varied"),
        ({"variety": "narrow"}, "no variety 'narrow'; choose from tabletop, wide"),
        ({"seed": -3}, "seed must not be negative; got -3"),
    ],
)
def test_values_out_of_range_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(RECIPE, **change)  # type: ignore[arg-type]
