"""Splits of hand-made catalogues and of a dataset on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.sources.categories import TOD_CATEGORIES, TOD_GROUPS
from sgbd.sources.split_report import split_report
from sgbd.sources.tod import Tod
from sgbd.sources.zero_shot_split import (
    SETS,
    Catalog,
    SplitError,
    ZeroShotSplit,
    balanced_choice,
    catalog,
    draw_seen,
    zero_shot_split,
)
from tests.sources.test_tod import masks, write_view

NAMES = ("a", "b", "c", "d")
SHARES = {"train": 0.5, "val": 0.25, "test": 0.25}


def made(objects: list[list[int]], scenes: list[int], unknown: list[int] | None = None) -> Catalog:
    counts = np.array(objects, np.int64)
    return Catalog(
        files=tuple(f"training_set/scene_{scene:05d}/rgb_{place:05d}.jpeg" for place, scene in enumerate(scenes)),
        scenes=tuple(f"training_set/scene_{scene:05d}" for scene in scenes),
        category_names=NAMES,
        objects=counts,
        visible=counts > 0,
        unknown=np.array(unknown or [0] * len(scenes)),
        background_views=0,
    )


def random_catalog(seed: int = 0, scenes: int = 40, views: int = 5) -> Catalog:
    rng = np.random.default_rng(seed)
    objects = rng.poisson([2.0, 0.8, 0.2, 0.2], (scenes * views, 4))
    return made(objects.tolist(), np.repeat(np.arange(scenes), views).tolist())


def split_of(frames: Catalog, **changes: object) -> ZeroShotSplit:
    options = {"seen": {"a", "b"}, "sizes": dict.fromkeys(SETS), "shares": SHARES, "seed": 0, **changes}
    return zero_shot_split(frames, **options)  # type: ignore[arg-type]


def test_half_of_each_group_is_drawn_and_the_seed_fixes_which() -> None:
    drawn = [draw_seen(TOD_GROUPS, seed) for seed in range(10)]
    for seen in drawn:
        assert [len(seen & set(names)) for names in TOD_GROUPS.values()] == [4, 2, 4, 2]
    assert drawn[3] == draw_seen(TOD_GROUPS, 3)
    assert len(set(drawn)) > 5


def test_no_scene_and_no_frame_is_in_two_sets_and_each_holds_what_it_may() -> None:
    frames = random_catalog()
    split = split_of(frames)
    pools = {key: {frames.scenes[index] for index in split.sets[key]} for key in SETS}
    assert not pools["train"] & (pools["val"] | pools["test_open"] | pools["test_closed"])
    assert not pools["val"] & (pools["test_open"] | pools["test_closed"])
    everything = np.concatenate([split.sets[key] for key in SETS])
    assert len(set(everything.tolist())) == len(everything)
    for key in SETS:
        shown = frames.visible[split.sets[key]]
        assert len(shown) == split.candidates[key] > 0
        assert shown[:, 2:].any(axis=1).all() if key == "test_open" else not shown[:, 2:].any()
    assert split.scenes == {"train": 20, "val": 10, "test": 10}
    assert len(everything) + sum(split.left_out.values()) == len(frames.files)


def test_one_visible_pixel_of_an_unseen_category_keeps_a_frame_from_training() -> None:
    frames = made([[1, 0, 0, 0]] * 4, [0, 0, 0, 0])
    frames.visible[2, 3] = True
    split = split_of(frames, shares={"train": 1, "val": 0, "test": 0})
    assert split.sets["train"].tolist() == [0, 1, 3]
    assert split.left_out == {"near_empty": 0, "unknown_category": 0, "mixed_in_training": 1}


def test_near_empty_frames_and_unknown_objects_are_left_out_and_counted() -> None:
    frames = made([[2, 0, 0, 0], [1, 0, 0, 0], [2, 0, 0, 0], [0, 2, 0, 0]], [0, 1, 2, 3], unknown=[0, 0, 1, 0])
    split = split_of(frames, min_objects=2, shares={"train": 1, "val": 0, "test": 0})
    assert split.sets["train"].tolist() == [0, 3]
    assert split.left_out == {"near_empty": 1, "unknown_category": 1, "mixed_in_training": 0}


def test_the_seed_fixes_the_split() -> None:
    frames = random_catalog()
    sizes = dict.fromkeys(SETS, 5)
    first, again, other = (split_of(frames, seed=seed, sizes=sizes) for seed in (1, 1, 2))
    assert all(np.array_equal(first.sets[key], again.sets[key]) for key in SETS)
    assert not all(np.array_equal(first.sets[key], other.sets[key]) for key in SETS)


def test_numbers_of_objects_are_made_equal() -> None:
    # Frames of one object each: 50 a, 12 b, 4 c. Of 12 frames 4 must show each.
    objects = np.repeat(np.eye(3, dtype=np.int64), [50, 12, 4], axis=0)
    chosen = balanced_choice(objects, 12, np.random.default_rng(0))
    assert objects[chosen].sum(axis=0).tolist() == [4, 4, 4]
    # When c is used up, a and b share the rest.
    chosen = balanced_choice(objects, 20, np.random.default_rng(0))
    assert objects[chosen].sum(axis=0).tolist() == [8, 8, 4]


@settings(max_examples=50)
@given(
    st.lists(st.lists(st.integers(0, 4), min_size=3, max_size=3), min_size=1, max_size=12),
    st.integers(1, 12),
    st.integers(0, 5),
)
def test_every_choice_is_the_best_next_one(objects: list[list[int]], size: int, seed: int) -> None:
    counts = np.array(objects)
    chosen = balanced_choice(counts, size, np.random.default_rng(seed)).tolist()
    assert len(set(chosen)) == len(chosen) == min(size, len(objects))
    if size >= len(objects):
        return

    def unevenness(members: list[int]) -> float:
        total = counts[members].sum(axis=0)
        return float((total**2).sum() / total.sum() ** 2) if total.any() else np.inf

    for step, frame in enumerate(chosen):
        # A frame without objects does not affect the balance and comes after frames that do not worsen it.
        rest = [other for other in range(len(objects)) if other not in chosen[:step]]
        best = min(unevenness([*chosen[:step], other]) for other in rest)
        assert unevenness([*chosen[:step], frame]) == pytest.approx(best)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seen": {"a", "z"}}, r"some of a, b, c, d; got \['a', 'z'\]"),
        ({"seen": set()}, "some of a, b, c, d"),
        ({"shares": {"train": 0.5, "val": 0.2, "test": 0.2}}, "add up to 1"),
        ({"shares": {"train": 1.0}}, "add up to 1"),
        ({"min_objects": 100}, "200 frames are near-empty"),
    ],
)
def test_impossible_splits_say_why(changes: dict[str, object], message: str) -> None:
    with pytest.raises(SplitError, match=message):
        split_of(random_catalog(), **changes)


def test_the_report_counts_what_is_there() -> None:
    frames = random_catalog()
    split = split_of(frames, sizes={**dict.fromkeys(SETS), "train": 7})
    report = split_report(frames, split, {"one": ["a", "c"], "two": ["b", "d"]})
    assert "- one: seen a; unseen c" in report
    rows = {line.split("|")[1].strip(): [cell.strip() for cell in line.split("|")[2:-1]] for line in report.splitlines() if line.startswith("|")}  # fmt: skip # noqa: E501
    assert rows["train"][:3] == ["7", str(split.candidates["train"]), "20"]
    assert rows["a"][:2] == ["one", "seen"]
    assert rows["c"][2:5] == ["0", "0", "0"]
    numbers = frames.objects[split.sets["test_open"]].sum(axis=0)
    assert [int(rows[name][5]) for name in NAMES] == numbers.tolist()


def test_a_catalogue_of_a_tree_on_disk(tmp_path: Path) -> None:
    segmentation, semseg = masks()
    for scene in ("training_set/scene_00000", "test_set/scene_00003"):
        write_view(tmp_path / scene, 0, np.zeros_like(segmentation), np.zeros_like(semseg))
        write_view(tmp_path / scene, 2, segmentation, semseg)
    # Existing lists are ignored.
    (tmp_path / "train.txt").write_text("training_set/scene_00000/rgb_00002.jpeg\n")
    frames = catalog(Tod(tmp_path), min_object_pixels=5, progress=False)
    assert frames.files == ("training_set/scene_00000/rgb_00002.jpeg", "test_set/scene_00003/rgb_00002.jpeg")
    assert frames.scenes == ("training_set/scene_00000", "test_set/scene_00003")
    assert frames.background_views == 2
    mug, bowl = TOD_CATEGORIES.index("mug"), TOD_CATEGORIES.index("bowl")
    assert frames.objects[:, [mug, bowl]].tolist() == [[1, 0], [1, 0]], "the bowl has 4 pixels"
    assert frames.visible[:, [mug, bowl]].all()
    assert frames.objects.sum() == 2
    assert frames.unknown.tolist() == [0, 0]
