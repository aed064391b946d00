from pathlib import Path

import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from sgbd.features import EDGE_GROUPS, NODE_GROUPS
from sgbd.jobs.configuration import ConfigurationError, config_folder
from sgbd.jobs.untrained import trusted_packages, untrained_checkpoint
from sgbd.segmenter import Segmenter
from tests.scenes import scene


def composed(*overrides: str) -> DictConfig:
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        return compose("train", list(overrides))


def test_the_recipe_is_all_that_a_segmenter_needs() -> None:
    checkpoint = untrained_checkpoint(composed("features=all", "superpixels.n_segments=16"))
    assert checkpoint.recipe["features"] == {"node": list(NODE_GROUPS), "edge": list(EDGE_GROUPS)}
    assert checkpoint.recipe["superpixels"]["n_segments"] == 16
    assert checkpoint.model.edge_channels == checkpoint.recipe["model"]["edge_channels"] == 11
    checkpoint.to_bytes()
    assert Segmenter(checkpoint).segment_frame(scene(0)).superpixels.max() > 0


def test_the_global_generator_decides_on_the_weights() -> None:
    weights = []
    for seed in (0, 0, 1):
        torch.manual_seed(seed)
        weights.append(torch.cat([value.flatten() for value in untrained_checkpoint(composed()).model.parameters()]))
    assert torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])


def test_both_stages_need_the_same_superpixels(tmp_path: Path) -> None:
    first = untrained_checkpoint(composed("superpixels.n_segments=16", "superpixels.threads=1"))
    second = ("graph=agglomerated", f"graph.first_stage={first.save(tmp_path / 'first.safetensors')}")
    assert untrained_checkpoint(composed(*second, "superpixels.n_segments=16")).first_stage is not None
    with pytest.raises(ConfigurationError, match=r"first stage.* other superpixels: n_segments was 16, now 32\."):
        untrained_checkpoint(composed(*second, "superpixels.n_segments=32"))


def test_without_a_head() -> None:
    checkpoint = untrained_checkpoint(composed("objectness=none"))
    assert checkpoint.objectness is None
    assert checkpoint.recipe["objectness"] is None
    assert trusted_packages(composed("objectness=none")) == ("sgbd",)


@pytest.mark.parametrize(
    "override",
    [
        "model._target_=theirs.models.Model",
        "objects._target_=theirs.Rule",
        "+graph.adjacency={_target_: theirs.pairs, _partial_: true}",
        "+trust=[theirs]",
    ],
)
def test_packages_that_the_configuration_names_are_trusted(override: str) -> None:
    assert trusted_packages(composed(override)) == ("sgbd", "theirs")
