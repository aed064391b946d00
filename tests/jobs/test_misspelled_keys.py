"""Suggestions for misspelled configuration keys."""

from __future__ import annotations

import pytest

from sgbd.jobs.configuration import config_folder
from sgbd.jobs.misspelled_keys import other_command, suggestions

EXPERIMENTS = sorted(file.stem for file in (config_folder() / "experiment").glob("*.yaml"))
OF_COMPARE = {"comparison", "computational", "qualitative", "real"}


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


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_an_experiment_of_compare_is_none_of_train(experiment: str) -> None:
    right = "compare" if experiment in OF_COMPARE else "train"
    assert other_command(config_folder(), right, experiment) is None
    if right == "compare":
        assert other_command(config_folder(), "train", experiment) == (
            f"experiment={experiment} sets sections, which python -m sgbd.train does not have. "
            "It is an experiment of python -m sgbd.compare."
        )


def test_the_right_command_is_told_where_hydra_refuses_an_experiment() -> None:
    assert suggestions(config_folder(), "evaluate", ["checkpoint=pretrained", "+experiment=graph"]) == [
        "experiment=graph sets features, model, name, superpixels, trainer, which python -m sgbd.evaluate "
        "does not have. "
        "It is an experiment of python -m sgbd.train."
    ]


def test_experiments_of_ones_own_may_set_any_key() -> None:
    assert other_command(config_folder(), "train", "mine") is None
