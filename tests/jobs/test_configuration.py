from __future__ import annotations

import errno
import functools
import inspect
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import InstantiationException
from hydra.types import RunMode
from hydra.utils import get_object, instantiate
from omegaconf import OmegaConf
from omegaconf.errors import MissingMandatoryValue

from sgbd.features import EDGE_GROUPS, NODE_GROUPS, edge_columns, node_columns
from sgbd.frame import FrameError
from sgbd.jobs import configuration
from sgbd.jobs.configuration import ConfigurationError, config_folder, count_workers, explain
from sgbd.node_block import split_groups
from sgbd.sources import DatasetNotFoundError
from sgbd.sources.categories import TOD_GROUPS, TODZ_SEEN

CONF = Path(__file__).parents[2] / "conf"
ENTRIES = sorted(path.stem for path in CONF.glob("*.yaml"))
EXPERIMENTS = sorted(path.stem for path in (CONF / "experiment").glob("*.yaml"))
OPTIONS = sorted(
    (path.parent.relative_to(CONF).as_posix(), path.stem)
    for path in CONF.glob("*/**/*.yaml")
    if path.parts[len(CONF.parts)] not in ("experiment", "hydra")
)
SOURCES = "".join(path.read_text() for path in (CONF.parent / "sgbd").rglob("*.py"))


def entry_of(experiment: str) -> str:
    """Return the command of an experiment, as shown in its comment."""
    return re.search(r"python -m sgbd\.(\w+)", (CONF / "experiment" / f"{experiment}.yaml").read_text())[1]


@functools.cache
def composed(entry: str, *overrides: str, hydra: bool = False):
    with initialize_config_dir(str(CONF), version_base="1.3", job_name=entry):
        return compose(entry, list(overrides), return_hydra_config=hydra)


def objects(node: object, path: str = "") -> Iterator[tuple[str, dict]]:
    """Yield every node that names a class, with its path."""
    if isinstance(node, dict):
        if node.get("_target_"):
            yield path, node
        for key, value in node.items():
            yield from objects(value, f"{path}.{key}".lstrip("."))


def check_targets(config) -> None:
    """Check that every `_target_` exists and accepts all arguments given with it."""
    for path, node in objects(OmegaConf.to_container(config, resolve=False)):
        target = get_object(node["_target_"])
        names = {key for key in node if not re.fullmatch("_[a-z]+_", key)}
        signature = inspect.signature(target)
        try:
            signature.bind_partial(**dict.fromkeys(names))
        except TypeError as error:
            pytest.fail(f"{path}: {node['_target_']}: {error}")


# --- every shipped file


def test_the_folder_of_a_checkout():
    assert config_folder() == CONF
    assert {"train", "prepare"} <= set(ENTRIES)


@pytest.mark.parametrize("entry", ENTRIES)
def test_every_entry_composes_and_its_targets_take_its_arguments(entry):
    check_targets(composed(entry))


@pytest.mark.parametrize(("group", "option"), OPTIONS)
def test_every_option_composes_and_its_target_takes_its_arguments(group, option):
    value = f"[{option}]" if group in ("logger", "baseline") else option
    # The first stage is a file; a digest is used in its place.
    needed = ["graph.first_stage=sha256:0"] if (group, option) == ("graph", "agglomerated") else []
    config = composed("compare" if group == "baseline" else "train", f"{group}={value}", *needed)
    node = config[group]
    check_targets(config)
    if group == "features":
        assert set(node) == {"node", "edge"}
        stored, others = split_groups(node.node)
        assert others in ([], ["dino"])
        assert node_columns(stored) or others
        edge_columns(node.edge)
    elif group in ("superpixels", "graph", "sampler", "partition"):
        assert callable(instantiate(node))


@pytest.mark.parametrize("entry", ENTRIES)
def test_every_key_is_read(entry):
    options = "".join(path.read_text() for path in (CONF / "dataset").glob("*.yaml"))
    text = SOURCES + options + (CONF / f"{entry}.yaml").read_text()
    for key in composed(entry):
        used = re.search(rf"config\.{key}\b|\$\{{{key}\}}|\[\"{key}\"\]|\b{key}=", text)
        assert used, f"nothing reads the key {key} of {entry}.yaml"


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_experiment_composes_under_its_own_name(experiment):
    entry = entry_of(experiment)
    config = composed(entry, f"+experiment={experiment}", hydra=True)
    assert config.name == experiment
    check_targets(composed(entry, f"+experiment={experiment}"))
    # Experiments that vary something start a sweep without -m.
    assert (config.hydra.mode == RunMode.MULTIRUN) == bool(config.hydra.sweeper.params)


SWEEPS = [name for name in EXPERIMENTS if name.startswith(("ablate_", "generalization_"))]


@pytest.mark.parametrize("experiment", SWEEPS)
def test_ablations_sweep_over_values_that_compose(experiment):
    config = composed("train", f"+experiment={experiment}", hydra=True)
    params = [f"{key}={value}" for key, value in config.hydra.sweeper.params.items()]
    for override in OverridesParser.create().parse_overrides(params):
        values = list(override.sweep_string_iterator())
        assert len(values) >= 2
        for value in values:
            check_targets(composed("train", f"+experiment={experiment}", f"{override.get_key_element()}={value}"))


def swept(experiment: str) -> dict[str, str]:
    config = composed("train", f"+experiment={experiment}", hydra=True)
    return OmegaConf.to_container(config.hydra.sweeper.params)


def test_the_papers_ablations():
    assert swept("ablate_sampling") == {"sampler.positive_share": "null,0.5,0.25,0.1"}
    assert swept("ablate_patches") == {"superpixels.n_segments": "32,64,128,256"}


def test_feature_rows_are_the_papers_then_more_then_every_group_alone():
    names = [row.strip() for row in swept("ablate_features")["features"].split(",")]
    rows = {name: composed("train", f"features={name}").features for name in names}
    groups = {name: (row.node and sorted(row.node), row.edge) for name, row in rows.items()}
    explicit = ["depth", "normal", "position", "rgb"]
    assert names[:8] == ["rgb", "depth", "rgb_depth", "paper", "paper_dino", "dino", "rgb_dino", "depth_dino"]
    assert groups["depth"] == (["depth", "position"], []), "the paper's Z comes with its X and Y"
    assert groups["paper"] == (explicit, [])
    assert groups["paper_dino"] == (sorted([*explicit, "dino"]), [])
    assert groups["dino"] == (["dino"], [])
    assert groups["all"] == (None, None)
    assert {node[0] for node, edge in groups.values() if node and len(node) == 1} == {*NODE_GROUPS, "dino"}
    assert {edge[0] for node, edge in groups.values() if edge and len(edge) == 1 and node == explicit} == {*EDGE_GROUPS}


def classes_of(experiment: str) -> dict[str, dict]:
    names = swept(experiment)["classes"].split(",")
    rows = {name: composed("train", f"+experiment={experiment}", f"classes={name}") for name in names}
    assert all(row.dataset.unseen_objects == "ignore" for row in rows.values())
    return {name: OmegaConf.to_container(row.dataset, resolve=False) | {"seen": list(row.dataset.seen),
            "max_train_frames": row.dataset.max_train_frames} for name, row in rows.items()}  # fmt: skip


def test_studies_of_generalization_choose_classes_of_one_dataset():
    number = [set(row["seen"]) for row in classes_of("generalization_number").values()]
    assert [len(seen) for seen in number] == [15, 20, 23]
    assert number[0] > TODZ_SEEN
    assert number[2] > number[1] > number[0]
    variance = classes_of("generalization_variance").values()
    assert [(len(row["seen"]), row["max_train_frames"]) for row in variance] == [(5, 400), (10, 200), (20, 100)]
    types = [frozenset(row["seen"]) for row in classes_of("generalization_types").values()]
    assert len(set(types)) == 3
    for seen in types:
        assert [len(seen & set(names)) for names in TOD_GROUPS.values()] == [5, 2, 5, 3]
    groups = {name: set(row["seen"]) for name, row in classes_of("generalization_groups").items()}
    assert groups == {name: set(names) for name, names in TOD_GROUPS.items()}


def test_models_are_compared_at_equal_parameters():
    sizes = {}
    for model in swept("ablate_models")["model"].split(","):
        config = composed("train", "+experiment=ablate_models", f"model={model}")
        network = instantiate(config.model, node_channels=len(node_columns()), edge_channels=len(edge_columns()))
        sizes[model] = sum(parameter.numel() for parameter in network.parameters())
    assert max(sizes.values()) < 1.1 * min(sizes.values()), sizes


def test_ablations_of_our_best_model_differ_from_the_papers_in_the_model():
    best, graph = (composed("train", f"+experiment={name}") for name in ("ablate_sampling_best", "graph"))
    assert best.model == graph.model
    assert best.superpixels == graph.superpixels
    assert swept("ablate_sampling_best") == swept("ablate_sampling")
    assert swept("ablate_patches_best") == {"superpixels.n_segments": "128,256,512,1024"}
    assert swept("ablate_features_best") == swept("ablate_features")
    features, papers = composed("train", "+experiment=ablate_features_best"), composed("train")
    assert (features.model, features.superpixels) == (graph.model, papers.superpixels)


def test_values_from_the_command_line_win_over_an_experiment():
    assert composed("train", "+experiment=ablate_sampling", "sampler.positive_share=0.4").sampler.positive_share == 0.4
    assert composed("train", "+experiment=ablate_sampling", "name=mine").name == "mine"


def test_the_baseline_is_the_papers():
    config = composed("train")
    assert config.features == {"node": ["rgb", "position", "depth", "normal"], "edge": []}
    assert config.superpixels.n_segments == 128
    assert (config.sampler.pairs_per_graph, config.sampler.positive_share) == (128, 0.25)
    assert config.partition._target_.endswith("ConnectedComponents")


# --- errors


def test_a_package_without_its_configuration(monkeypatch, tmp_path):
    monkeypatch.setattr(configuration, "__file__", str(tmp_path / "sgbd" / "jobs" / "configuration.py"))
    with pytest.raises(ConfigurationError, match="Install the package with pip"):
        config_folder()
    wheel = tmp_path / "sgbd" / "conf"
    wheel.mkdir(parents=True)
    (wheel / "train.yaml").touch()
    assert config_folder() == wheel


def test_workers():
    assert count_workers(3) == 3
    assert count_workers(0) == 0
    assert 1 <= count_workers(None) <= (os.cpu_count() or 1)
    with pytest.raises(ConfigurationError, match="workers must be null"):
        count_workers(-1)


def raised(call) -> BaseException:
    with pytest.raises(BaseException) as caught:
        call()
    return caught.value


def test_errors_of_the_package_explain_themselves():
    assert explain(FrameError("depth is upside down")) == "depth is upside down"
    assert "Expected layout" in str(explain(DatasetNotFoundError("x", "y", "z", "w")))
    assert "choose from rgb, position" in str(explain(raised(lambda: node_columns(["colour"]))))


def test_faults_of_the_program_keep_their_traceback():
    assert explain(raised(lambda: [][0])) is None
    assert explain(raised(lambda: int("x"))) is None
    assert explain(RuntimeError("mat1 and mat2 shapes cannot be multiplied")) is None


def test_errors_inside_instantiated_objects_are_found():
    node = OmegaConf.create({"_target_": "sgbd.superpixels.Slic", "n_segments": 0})
    error = raised(lambda: instantiate(node))
    assert isinstance(error, InstantiationException)
    assert explain(error) == "superpixels.n_segments must be at least 1; got 0"
    node = OmegaConf.create({"_target_": "sgbd.superpixels.Slic", "bins": 1})
    assert "unexpected keyword argument 'bins'" in str(explain(raised(lambda: instantiate(node))))


def test_missing_values_name_their_key():
    error = raised(lambda: OmegaConf.create({"dataset": {"root": "???"}}).dataset.root)
    assert isinstance(error, MissingMandatoryValue)
    assert explain(error) == "dataset.root is not set. Give it on the command line: dataset.root=<value>"


def test_a_full_disk():
    message = explain(OSError(errno.ENOSPC, "No space left on device", "weights.bin"))
    assert message is not None
    assert "the disk is full while writing weights.bin" in message


def test_a_file_system_that_does_not_take_a_file():
    read_only = OSError(errno.EROFS, "Read-only file system", "weights.bin")
    assert explain(read_only) == f"[Errno {errno.EROFS}] Read-only file system: 'weights.bin'"
    assert explain(OSError(errno.EBADF, "Bad file descriptor")) is None


def test_a_file_in_the_place_of_a_folder(tmp_path):
    (tmp_path / "results").write_text("")
    for error in (raised(lambda: (tmp_path / "results").mkdir()), raised(lambda: (tmp_path / "results" / "x").mkdir())):
        message = explain(error)
        assert message is not None
        assert f"{tmp_path / 'results'}" in message
        assert "a file lies where a folder is needed" in message


PROGRAM = """
import sys, time
from sgbd.jobs.configuration import ConfigurationError, entry_point

@entry_point("prepare")
def main(config):
    if config.on_error == "fail":
        raise ConfigurationError("what it is\\nand what to do")
    if config.on_error == "fault":
        return [][1]
    print("ready", flush=True)
    time.sleep(600)

if __name__ == "__main__":
    main()
"""


@pytest.fixture
def program(tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)

    def start(*arguments: str, **environment: str) -> subprocess.Popen:
        variables = {**os.environ, "HYDRA_FULL_ERROR": "0", **environment}
        command = [sys.executable, "program.py", *arguments]
        pipe = subprocess.PIPE
        return subprocess.Popen(command, cwd=tmp_path, env=variables, stdout=pipe, stderr=pipe, text=True)

    return start


def test_expected_errors_are_printed_without_a_traceback(program):
    process = program("on_error=fail", "dataset=augmented", "dataset.source.root=frames")
    _, stderr = process.communicate(timeout=300)
    assert process.returncode == 1
    assert "what it is\nand what to do\n" in stderr
    assert "Traceback" not in stderr
    assert "did you mean" not in stderr, "every key exists"


def test_the_option_for_sweeps_may_stand_anywhere(program):
    process = program("on_error=fail", "-m", "workers=0,1")
    _, stderr = process.communicate(timeout=300)
    assert "unrecognized arguments" not in stderr
    assert "what it is\nand what to do\n" in stderr


def test_the_traceback_can_be_asked_for(program):
    process = program("on_error=fail", HYDRA_FULL_ERROR="1")
    assert "Traceback" in process.communicate(timeout=300)[1]


def test_faults_are_printed_with_their_traceback(program):
    process = program("on_error=fault")
    _, stderr = process.communicate(timeout=300)
    assert process.returncode == 1
    assert "Traceback" in stderr
    assert "IndexError" in stderr


def test_a_wrong_choice_lists_the_choices(program):
    process = program("superpixels=voronoi")
    _, stderr = process.communicate(timeout=300)
    assert process.returncode == 1
    assert "Could not find 'superpixels/voronoi'" in stderr
    assert all(option in stderr for group, option in OPTIONS if group == "superpixels")
    assert "Traceback" not in stderr


def test_help_explains_keys_and_says_where_the_options_lie(program):
    stdout, _ = program("--help").communicate(timeout=300)
    assert re.search(r"\n  on_error=skip +What to do with a frame", stdout)
    assert f"adds your own options to those in\n{config_folder()}\n" in stdout


@pytest.mark.parametrize(
    ("argument", "told"),
    [
        ("superpixel=slic_fast", "superpixel is no key of this command; did you mean superpixels?"),
        ("my_folder", "my_folder is no key=value"),
    ],
)
def test_a_mistyped_argument_is_told_with_what_it_may_have_meant(program, argument, told):
    process = program(argument)
    _, stderr = process.communicate(timeout=300)
    assert process.returncode == 1
    assert told in stderr
    assert "Traceback" not in stderr


def test_ctrl_c_ends_with_130(program):
    process = program()
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=300)
    assert process.returncode == 130
    assert "Interrupted." in stderr
    assert "Traceback" not in stderr


def test_the_command_to_go_on_with_names_options_and_a_folder_of_ones_own(tmp_path):
    (tmp_path / "mine" / "model").mkdir(parents=True)
    (tmp_path / "mine" / "model" / "own.yaml").write_text("_target_: my_package.MyModel\n")
    told = 'raise OSError(28, "No space left on device", "weights")'
    (tmp_path / "train.py").write_text(PROGRAM.replace('"prepare"', '"train"').replace("time.sleep(600)", told))

    def run(*arguments: str) -> subprocess.CompletedProcess:
        command = [sys.executable, "train.py", *arguments]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)

    failed = run("--config-dir", "mine", "model=own", "output_dir='it\\'s (mine)'")
    assert failed.returncode == 1
    words = shlex.split(failed.stderr.partition("go on with: python -m sgbd.train ")[2].splitlines()[0])
    again = run(*words, "--cfg", "hydra")
    assert again.returncode == 0, again.stderr
    assert OmegaConf.create(again.stdout).hydra.run.dir.startswith(f"{tmp_path}/it's (mine)/train/")


def test_a_prediction_that_broke_off_does_not_claim_to_go_on(tmp_path):
    told = 'raise OSError(28, "No space left on device", "a.json")'
    (tmp_path / "predict.py").write_text(PROGRAM.replace('"prepare"', '"predict"').replace("time.sleep(600)", told))
    command = [sys.executable, "predict.py"]
    failed = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert "while writing a.json. Make room. The results of the frames so far are kept" in failed.stderr
    assert "go on" not in failed.stderr


def test_a_single_name_needs_no_brackets(tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM.replace("time.sleep(600)", "print(list(config.splits))"))
    command = [sys.executable, "program.py", "splits=train"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.stdout == "ready\n['train']\n", done.stderr


def test_options_of_ones_own(program, tmp_path):
    own = tmp_path / "mine" / "superpixels"
    own.mkdir(parents=True)
    (own / "voronoi.yaml").write_text("_target_: my_package.Voronoi\ncells: 7\n")
    process = program("--config-dir", "mine", "superpixels=voronoi", "--cfg", "job")
    stdout, stderr = process.communicate(timeout=300)
    assert process.returncode == 0, stderr
    assert OmegaConf.create(stdout).superpixels == {"_target_": "my_package.Voronoi", "cells": 7}


def test_hydra_is_left_uninitialised():
    assert not HydraConfig.initialized()
