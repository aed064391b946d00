from __future__ import annotations

import re
from pathlib import Path
from string import Template

import pytest
from hydra import compose, initialize_config_dir
from hydra.conf import ConfigSourceInfo
from omegaconf import DictConfig, OmegaConf

from sgbd.jobs.command_help import COLUMN, WIDTH, command_help, explained_keys, explained_option, rows
from sgbd.jobs.configuration import config_folder

COMMANDS = sorted(path.stem for path in config_folder().glob("*.yaml"))
ROW = re.compile(r"( {2}| {4})(?P<key>[\w.@]+)=(?P<rest>.*)")
FAR = " " * COLUMN


def composed(command: str, *overrides: str) -> DictConfig:
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose(command, list(overrides), return_hydra_config=True)
    OmegaConf.set_readonly(config, False)
    OmegaConf.set_struct(config, False)
    config.hydra.job.name = command
    return config


def page(command: str, *overrides: str) -> list[str]:
    return Template(composed(command, *overrides).hydra.help.template).substitute().splitlines()


def unexplained(lines: list[str]) -> list[str]:
    """Return the keys of a help page that have no explanation next to them or in the line below."""
    found = []
    for place, line in enumerate(lines):
        row = ROW.fullmatch(line)
        below = "".join(lines[place + 1 : place + 2])
        if row is not None and "  " not in row["rest"] and not below.startswith(FAR):
            found.append(row["key"])
    return found


def test_comments_above_and_beside_keys_explain_them() -> None:
    purpose, explained = explained_keys(
        "# @package _global_\n# What it\n#   python -m sgbd.train this=that\n# is for.\n_target_: some.Class\n"
        "# Above,\n# in two lines.\none: 1\ntwo: 2  # beside\nthree:\n  # Deeper.\n  four: [a,\n    b]\n"
        "# Of nothing.\n\nfive: '#'\n\n# Both:\nsix: 6   # sides\n"
    )
    assert purpose == "What it is for."
    assert explained == {
        "one": "Above, in two lines.", "two": "beside", "three.four": "Deeper.", "six": "Both: sides",
    }  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_every_key_of_every_command_is_explained(command: str) -> None:
    lines = page(command)
    assert lines[0] == f"python -m sgbd.{command} [group=option] [key=value] ..."
    assert unexplained(lines) == []
    assert {row["key"] for row in map(ROW.fullmatch, lines) if row} >= set(composed(command)) - {"hydra"}
    assert max(map(len, lines[:-4])) <= WIDTH  # without the folder's name at the end


def test_every_key_of_every_option_is_explained() -> None:
    found = []
    for file in sorted(config_folder().glob("*/*.yaml")):
        group = file.parent.name
        purpose, explained = explained_option([config_folder()], group, file.stem)
        values = OmegaConf.to_container(OmegaConf.load(file))
        assert purpose
        if group not in ("baseline", "experiment") and file.stem != "none":
            values.pop("defaults", None)
            found += [f"{group}={file.stem}: {key}" for key in unexplained(list(rows(values, "", explained)))]
    assert "\n".join(found) == ""


def test_another_option_shows_its_keys_and_the_others() -> None:
    text = "\n".join(page("evaluate", "dataset=mosd", "dataset.root=/frames", "partition=multicut"))
    assert "\n  dataset=mosd  " in text
    assert "\n    dataset.root=/frames  " in text
    assert "\n    dataset.labels={background: [], support: [1-9], ignore: [0] …\n" in text
    assert "\n  partition=multicut  " in text
    assert "\n    or average_linkage, components, kernighan_lin, mutex_watershed\n" in text
    assert "train_frames" not in text


@pytest.mark.parametrize("loggers", ["[csv,tensorboard]", "[csv]"])
def test_each_of_several_options_is_explained_by_its_purpose(loggers: str) -> None:
    text = re.sub(r"\s+", " ", "\n".join(page("train", f"logger={loggers}")))
    assert " Losses and scores as CSV files, csv/version_<n>/metrics.csv;" in text


def test_experiments_are_listed_with_the_command_that_runs_them() -> None:
    listed = "\n".join(page("compare")).partition("Prepared experiments")[2].replace("\n", " ").split("   ")[1]
    assert listed.split(",")[0].strip() == "comparison"
    assert "ablate" not in listed
    assert "Prepared experiments" not in "\n".join(page("predict"))


def test_options_of_ones_own_are_explained_by_their_comments(tmp_path: Path) -> None:
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "mine.yaml").write_text("# A model of mine.\n_target_: my.Model\nwidth: 7  # of it\n")
    config = composed("train")
    config.hydra.runtime.config_sources.append(ConfigSourceInfo(str(tmp_path), "file", "mine"))
    config.hydra.runtime.choices.model = "mine"
    config.model = {"_target_": "my.Model", "width": 7}
    lines = [line.split() for line in command_help(config).splitlines()]
    assert ["model=mine", "A", "model", "of", "mine."] in lines
    assert ["model.width=7", "of", "it"] in lines
