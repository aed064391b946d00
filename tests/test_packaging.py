"""The package installed from a wheel, outside any checkout."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from omegaconf import OmegaConf

ROOT = Path(__file__).parents[1]
ENTRIES = sorted(path.stem for path in (ROOT / "conf").glob("*.yaml"))


def run(*command: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        command, cwd=cwd, env={**os.environ, **environment}, capture_output=True, text=True, timeout=600, check=False
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    built = run(
        sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT), cwd=folder
    )
    assert built.returncode == 0, built.stdout + built.stderr
    (path,) = folder.glob("sgbd-*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """Folder with the installed wheel; dependencies come from the test environment."""
    folder = tmp_path_factory.mktemp("installed")
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", str(folder))
    done = run(*pip, str(wheel), cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


def test_the_wheel_holds_package_configuration_and_licence(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    tracked = {path.relative_to(ROOT).as_posix() for path in (ROOT / "conf").rglob("*.yaml")}
    assert {f"sgbd/{path}" for path in tracked} <= names
    assert {path.relative_to(ROOT).as_posix() for path in (ROOT / "sgbd").rglob("*.py")} <= names
    assert "sgbd/py.typed" in names
    assert "sgbd/pretrained/sgbd.safetensors" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert {name.split("/")[0] for name in names} == {"sgbd", next(n for n in names if "dist-info" in n).split("/")[0]}


@pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")
def test_make_repairs_an_environment_without_pip(tmp_path):
    # Debian's Python leaves such a one behind if the package python3-venv is missing.
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tmp_path)
    scripts = {".venv/bin/python": "exit 1", "python3": "if [ $2 = venv ]; then echo '#!/bin/sh' >.venv/bin/python; fi"}
    for name, script in scripts.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
    done = run("make", "install", f"PYTHON={tmp_path / 'python3'}", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


MODEL = """
from sgbd.models import EdgeClassifier

class Difference(EdgeClassifier):
    def __init__(self, node_channels, edge_channels, power):
        super().__init__(node_channels, edge_channels)
        self.power = power

    def score(self, source, target, edge):
        return -(source - target).abs().pow(self.power).sum(-1)
"""

# One process for all commands: most of a command's time is spent on importing PyTorch.
PROGRAM = """
import contextlib, io, json, runpy, sys
import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf
import sgbd.jobs.configuration

def output_of(entry, *arguments):
    sys.argv = [entry, *arguments]
    with contextlib.redirect_stdout(io.StringIO()) as text, contextlib.suppress(SystemExit):
        runpy.run_module(f"sgbd.{entry}", run_name="__main__", alter_sys=True)
    return text.getvalue()

shown = {entry: output_of(entry, "--cfg", "job") for entry in sys.argv[1:]}
shown |= {
    "file": sgbd.jobs.configuration.__file__,
    "folder": str(sgbd.jobs.configuration.config_folder()),
    "help": output_of("train", "--help"),
    "own": output_of("train", "--config-dir", "options", "model=difference", "model.power=2", "--cfg", "job"),
}
from sgbd import Segmenter
from sgbd.checkpoint import find_checkpoint
shown["pretrained"] = str(find_checkpoint("pretrained", "nowhere"))
shown["pretrained_model"] = Segmenter.pretrained().recipe["model"]["_target_"]
model = instantiate(OmegaConf.create(shown["own"]).model, node_channels=2, edge_channels=0)
shown["score"] = model.score(torch.tensor([[1.0, 2.0]]), torch.tensor([[3.0, 2.0]]), torch.zeros(1, 0)).item()
print(json.dumps(shown))
"""


@pytest.fixture(scope="module")
def outputs(installed, tmp_path_factory) -> dict:
    """Output of the installed commands, run in a folder unrelated to the checkout."""
    folder = tmp_path_factory.mktemp("elsewhere")
    (folder / "my_models.py").write_text(MODEL)
    (folder / "options" / "model").mkdir(parents=True)
    (folder / "options" / "model" / "difference.yaml").write_text("_target_: my_models.Difference\npower: 3\n")
    before = sorted(folder.rglob("*"))
    environment = {"PYTHONPATH": str(installed), "PYTHONDONTWRITEBYTECODE": "1"}
    done = run(sys.executable, "-c", PROGRAM, *ENTRIES, cwd=folder, **environment)
    assert done.returncode == 0, done.stderr
    assert sorted(folder.rglob("*")) == before
    return json.loads(done.stdout)


def test_the_installed_package_finds_its_own_configuration(installed, outputs):
    assert Path(outputs["file"]) == installed / "sgbd" / "jobs" / "configuration.py"
    assert Path(outputs["folder"]) == installed / "sgbd" / "conf"


@pytest.mark.parametrize("entry", ENTRIES)
def test_commands_run_outside_of_a_checkout(outputs, entry):
    file = OmegaConf.load(ROOT / "conf" / f"{entry}.yaml")
    groups = {key for default in file.defaults if default != "_self_" for key in default if " " not in key}
    assert set(OmegaConf.create(outputs[entry])) == set(file) - {"defaults", "hydra"} | groups


def test_help_lists_the_choices(outputs):
    assert outputs["help"].startswith("python -m sgbd.train [group=option] [key=value] ...")
    options = sorted(path.stem for path in (ROOT / "conf" / "model").glob("*.yaml"))
    assert f"\n    or {', '.join(option for option in options if option != 'mlp')}\n" in outputs["help"]
    assert "model.dropout=0.0" in outputs["help"]


def test_a_model_of_ones_own_plugs_in(outputs):
    assert OmegaConf.create(outputs["own"]).model == {"_target_": "my_models.Difference", "power": 2}
    assert outputs["score"] == -4.0


def test_the_installed_package_brings_its_pretrained_model(installed, outputs):
    assert Path(outputs["pretrained"]) == installed / "sgbd" / "pretrained" / "sgbd.safetensors"
    assert outputs["pretrained_model"].startswith("sgbd.")
    assert OmegaConf.create(outputs["predict"]).checkpoint == "pretrained"
