"""Suggestions for keys that a configuration does not have."""

from __future__ import annotations

from sgbd.configuration import config_folder
from sgbd.misspelled_keys import suggestions


def test_the_nearest_key_is_suggested() -> None:
    given = ["modle=mlp", "seed=1", "trainer.epoch=3", "--multirun", "partition=multicut", "dataset.root=x"]
    assert suggestions(config_folder(), "train", given) == [
        "modle is no key of this command; did you mean model?",
        "trainer.epoch is no key of this command; did you mean trainer.epochs?",
    ]


def test_what_is_like_nothing_added_removed_or_hydras_is_passed_over() -> None:
    given = ["quux=1", "+modle=mlp", "~sed", "hydra.run.dri=x", "hydra/launchr=joblib", "my_folder"]
    assert suggestions(config_folder(), "predict", given) == []
