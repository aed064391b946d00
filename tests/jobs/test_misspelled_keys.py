"""Suggestions for keys that a configuration does not have."""

from __future__ import annotations

from sgbd.jobs.configuration import config_folder
from sgbd.jobs.misspelled_keys import suggestions


def test_the_nearest_key_is_suggested() -> None:
    given = ["modle=mlp", "seed=1", "trainer.epoch=3", "--multirun", "partition=multicut", "dataset.root=x"]
    assert suggestions(config_folder(), "train", given) == [
        "modle is no key of this command; did you mean model?",
        "trainer.epoch is no key of this command; did you mean trainer.epochs?",
    ]


def test_what_is_like_nothing_added_removed_or_hydras_is_passed_over() -> None:
    given = ["quux=1", "+modle=mlp", "~sed", "hydra.run.dri=x", "hydra/launchr=joblib", "my_folder"]
    assert suggestions(config_folder(), "predict", given) == []


def test_keys_are_those_of_the_chosen_options() -> None:
    given = ["dataset=augmented", "dataset.source.root=x", "dataset.copis=4", "model=gated_gcn", "model.num_layers=2"]
    assert suggestions(config_folder(), "train", given) == [
        "dataset.copis is no key of this command; did you mean dataset.copies?"
    ]


def test_a_choice_that_does_not_exist_is_passed_over() -> None:
    given = ["model=mine", "+experiment=none", "sed=1"]
    assert suggestions(config_folder(), "train", given) == ["sed is no key of this command; did you mean seed?"]
