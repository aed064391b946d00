"""Every shipped model, head and sampler is composed as by a user and trained for a step."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.utils import instantiate
from torch.nn.functional import binary_cross_entropy_with_logits

from sgbd.models import EdgeClassifier, ObjectnessHead
from sgbd.sampling import AllEdges, BalancedEdgeSampler
from tests.graph_samples import grid_graph

CONF = Path(__file__).parents[2] / "conf"


def choices(group: str) -> list[str]:
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


@pytest.fixture(autouse=True)
def configuration() -> Iterator[None]:
    with initialize_config_dir(str(CONF), version_base="1.3"):
        yield
    GlobalHydra.instance().clear()


@pytest.mark.parametrize("sampler", choices("sampler"))
@pytest.mark.parametrize("name", choices("model"))
def test_model_and_sampler_take_a_step(name: str, sampler: str) -> None:
    config = compose("train", overrides=[f"model={name}", f"sampler={sampler}"])
    torch.manual_seed(0)
    model = instantiate(config.model, node_channels=3, edge_channels=2)
    assert isinstance(model, EdgeClassifier)
    graph = instantiate(config.sampler)(grid_graph(6, 8), torch.Generator().manual_seed(0))
    optimizer = torch.optim.SGD(model.parameters(), lr=0.01)

    def loss() -> torch.Tensor:
        return binary_cross_entropy_with_logits(model(graph), graph.edge_label)

    before = loss()
    before.backward()
    optimizer.step()
    assert loss() < before


def test_samplers() -> None:
    made = {name: instantiate(compose("train", overrides=[f"sampler={name}"]).sampler) for name in choices("sampler")}
    assert isinstance(made["all"], AllEdges)
    assert isinstance(made["balanced"], BalancedEdgeSampler)
    assert (made["balanced"].pairs_per_graph, made["balanced"].positive_share) == (128, 0.25)
    assert (made["natural"].pairs_per_graph, made["natural"].positive_share) == (128, None)


def test_objectness_can_be_left_out() -> None:
    assert isinstance(instantiate(compose("train").objectness, node_channels=3), ObjectnessHead)
    assert compose("train", overrides=["objectness=none"]).objectness is None
