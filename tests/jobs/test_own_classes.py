from __future__ import annotations

import pytest
from torch import nn

from sgbd.jobs.configuration import ConfigurationError
from sgbd.jobs.own_classes import require_call, require_kind
from sgbd.models import EdgeClassifier, SharedMLP
from sgbd.partition import GreedyMulticut, Partitioner


class FourArguments:
    def __call__(self, num_nodes, pairs, probability, border_length):
        return None


def test_classes_and_objects_of_a_kind_pass() -> None:
    require_kind(SharedMLP, EdgeClassifier, "model")
    require_kind(SharedMLP(3, 2), EdgeClassifier, "model")


@pytest.mark.parametrize("made", [nn.Linear, nn.Linear(1, 1)])
def test_another_kind_is_told_with_what_is_expected(made: object) -> None:
    with pytest.raises(ConfigurationError, match=r"^model: torch.nn.modules.linear.Linear is no sgbd.*EdgeClassifier"):
        require_kind(made, EdgeClassifier, "model")


def test_what_takes_the_arguments_passes() -> None:
    require_call(GreedyMulticut(), Partitioner, "partition")
    require_call(lambda *anything: None, Partitioner, "partition")


@pytest.mark.parametrize("made", [FourArguments(), object()])
def test_what_cannot_be_called_so_is_told_with_the_arguments(made: object) -> None:
    with pytest.raises(
        ConfigurationError, match=r"\(num_nodes, pairs, probability, border_length, objectness\), as sg"
    ):
        require_call(made, Partitioner, "partition")
