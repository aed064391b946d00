from __future__ import annotations

import numpy as np
import pytest

from sgbd.benchmark import run_benchmark
from sgbd.benchmarking.checkpoints import configured_checkpoint
from sgbd.benchmarking.frames import made_up_scene
from sgbd.benchmarking.methods import make_method, with_option
from sgbd.jobs.configuration import ConfigurationError
from tests.benchmarking.configured import small_benchmark


def test_every_method_takes_a_frame():
    raw = made_up_scene(64, 48, 0)
    with small_benchmark() as config:
        ours = make_method("ours", config, 16)(raw)
        slic = make_method("superpixels/slic_reference", config, 16)(raw)
        gated = make_method("model/gated_gcn", config, 16)(raw)
        reference = make_method("reference", config, 16)(raw)
        rgb, depth = make_method("scikit_image", config, 16)(raw)
    assert ours.instances.shape == reference.shape == rgb.shape == depth.shape == (48, 64)
    assert np.array_equal(gated.superpixels, ours.superpixels)
    assert not np.array_equal(gated.edge_probability, ours.edge_probability)
    assert not np.array_equal(slic.superpixels, ours.superpixels)


def test_one_option_changes_and_all_else_stays():
    with small_benchmark("features=all", "superpixels.min_size=9") as config:
        changed = with_option(config, "model/attention")
        assert changed.model._target_.endswith("EdgeTransformer")
        assert {**changed, "model": None} == {**config, "model": None}


@pytest.mark.parametrize("name", ["fastest", "superpixels/voronoi", "dataset/tod", "superpixels"])
def test_an_unknown_method_lists_the_choices(name):
    with small_benchmark() as config, pytest.raises(ConfigurationError, match=f"no method '{name}'.*ours, reference"):
        make_method(name, config, 16)


def test_unknown_options_list_those_of_the_group():
    with small_benchmark() as config, pytest.raises(ConfigurationError, match="slic_fast"):
        make_method("superpixels/voronoi", config, 16)


def test_a_checkpoint_is_measured_as_it_is(tmp_path):
    path = tmp_path / "checkpoint.safetensors"
    with small_benchmark("model=gated_gcn", "model.hidden_channels=8", "superpixels=slic_reference") as config:
        configured_checkpoint(config).save(path)
    for given in (path, tmp_path):
        with small_benchmark(f"checkpoint={given}") as config:
            checkpoint = configured_checkpoint(config, 20)
            assert checkpoint.recipe["model"]["hidden_channels"] == 8
            assert checkpoint.recipe["superpixels"]["_target_"].endswith("Slic")
            assert checkpoint.recipe["superpixels"]["n_segments"] == 20
            with pytest.raises(ConfigurationError, match="leave checkpoint at null"):
                with_option(config, "model/mlp")


def test_other_superpixels_take_the_place_of_a_checkpoints(tmp_path):
    raw, path = made_up_scene(64, 48, 0), tmp_path / "checkpoint.safetensors"
    with small_benchmark("features=all") as config:
        expected = make_method("slic_reference", config, 16)(raw).superpixels
        configured_checkpoint(config).save(path)
    with small_benchmark(f"checkpoint={path}") as config:
        assert np.array_equal(make_method("slic_reference", config, 16)(raw).superpixels, expected)
        assert not np.array_equal(make_method("ours", config, 16)(raw).superpixels, expected)


def test_untrained_weights_are_fixed_by_the_seed():
    weights = []
    for seed in (0, 0, 1):
        with small_benchmark(f"seed={seed}") as config:
            weights.append(next(configured_checkpoint(config).model.parameters()).detach().numpy())
    assert np.array_equal(weights[0], weights[1])
    assert not np.array_equal(weights[0], weights[2])


def test_superpixels_without_a_number():
    with small_benchmark() as config:
        config.superpixels = {"_target_": "tests.boxes.Grid", "size": 8}
        with pytest.raises(ConfigurationError, match=r"tests\.boxes\.Grid has no n_segments"):
            configured_checkpoint(config, 16)
        # The same without n: asking for it would lead back here.
        with pytest.raises(ConfigurationError, match=r"tests\.boxes\.Grid has no n_segments"):
            run_benchmark(config)
