from __future__ import annotations

from sgbd.sources.categories import TABLE_CATEGORY, TOD_CATEGORIES, TOD_GROUPS, TOD_SYNSETS, TODZ_SEEN, TODZ_UNSEEN
from sgbd.sources.shapenet import SHAPENET_SYNSETS


def test_there_are_25_categories_and_the_table_comes_after_them() -> None:
    assert len(set(TOD_CATEGORIES)) == 25
    assert TABLE_CATEGORY == 26


def test_the_order_is_that_of_the_synsets_and_of_the_names() -> None:
    assert list(TOD_SYNSETS) == sorted(TOD_SYNSETS)
    assert list(TOD_CATEGORIES) == sorted(TOD_CATEGORIES)
    assert tuple(TOD_SYNSETS.values()) == TOD_CATEGORIES
    assert (TOD_SYNSETS["03797390"], TOD_SYNSETS["02747177"], TOD_SYNSETS["04401088"]) == ("mug", "ashcan", "telephone")


def test_shapenet_core_has_55_categories() -> None:
    assert len(SHAPENET_SYNSETS) == len(set(SHAPENET_SYNSETS.values())) == 55
    assert list(SHAPENET_SYNSETS) == sorted(SHAPENET_SYNSETS)
    assert list(SHAPENET_SYNSETS.values()) == sorted(SHAPENET_SYNSETS.values())
    assert all(len(synset) == 8 and synset.isdigit() for synset in SHAPENET_SYNSETS)


def test_seen_and_unseen_divide_the_categories_as_in_the_paper() -> None:
    assert len(TODZ_SEEN) == 12
    unseen = {
        "bowl", "bottle", "jar", "pot", "dishwasher", "printer", "telephone", "computer_keyboard", "display", "laptop",
        "helmet", "knife", "birdhouse",
    }  # fmt: skip
    assert unseen == TODZ_UNSEEN
    assert set(TOD_CATEGORIES) == TODZ_SEEN | TODZ_UNSEEN


def test_the_groups_divide_the_categories_and_about_half_of_each_is_seen() -> None:
    members = [name for group in TOD_GROUPS.values() for name in group]
    assert sorted(members) == sorted(TOD_CATEGORIES)
    seen = {group: len(TODZ_SEEN & set(names)) for group, names in TOD_GROUPS.items()}
    assert seen == {"containers": 4, "cubics": 2, "electronics": 4, "miscellaneous": 2}
