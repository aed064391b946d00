from __future__ import annotations

import json
import math
import re
import threading
from pathlib import Path

import pytest
from omegaconf import OmegaConf

from sgbd.jobs.job import config_hash, job_folder, run_once

CONFIG = {"name": "a", "seed": 0, "data_dir": "data", "dataset": {"root": "${data_dir}/tabletop"}, "rate": 0.1}


def config(**changes):
    return OmegaConf.create({**CONFIG, **changes})


# --- the identity of a job


@pytest.mark.parametrize("change", [{"name": "b"}, {"workers": 3}, {"output_dir": "x"}, {"data_dir": "/elsewhere"}])
def test_hash_ignores_what_cannot_change_the_result(change):
    assert config_hash(config(**change)) == config_hash(config(**{key: None for key in change if key not in CONFIG}))


def test_hash_ignores_how_the_trainer_reads_and_reports():
    plain, talkative = ({"epochs": 3, "progress": shown, "num_workers": 2 * shown} for shown in (False, True))
    assert config_hash(config(trainer=plain)) == config_hash(config(trainer=talkative))
    assert config_hash(config(trainer=plain)) != config_hash(config(trainer={**plain, "epochs": 4}))


@pytest.mark.parametrize("change", [{"seed": 1}, {"rate": 0.2}, {"dataset": {"root": "${data_dir}/other"}}, {"new": 1}])
def test_hash_sees_everything_else(change):
    assert config_hash(config(**change)) != config_hash(config())


def test_hash_leaves_the_configuration_alone():
    given = config()
    config_hash(given)
    assert OmegaConf.to_container(given) == CONFIG


def test_job_folder_is_one_path_component():
    assert job_folder("features=rgb,model=mlp") == "features=rgb,model=mlp"
    assert re.fullmatch(r"dataset\.root=_a_b_c-[0-9a-f]{10}", job_folder("dataset.root=/a/b c"))
    assert re.fullmatch(r"_x-[0-9a-f]{10}", job_folder("../x"))
    assert job_folder("") == "base"


def test_job_folders_that_differ_in_separators_stay_apart():
    assert len({job_folder(f"dataset.root={root}") for root in ("/a/b", "/a_b", "/a b", "_a_b")}) == 4


def test_an_experiment_under_another_name_is_part_of_the_folder():
    assert job_folder("model=mlp", "graph", "graph") == "model=mlp"
    assert job_folder("model=mlp", "train", None) == "model=mlp"
    assert job_folder("model=mlp", "train", "mine") == "experiment=mine,model=mlp"
    assert job_folder("", "train", "mine") == "experiment=mine"


def test_long_job_folders_stay_apart():
    first, second = job_folder("a=" + "x" * 300 + "1"), job_folder("a=" + "x" * 300 + "2")
    assert first != second
    assert len(first) == len(second) == 150


# --- a job in its folder


def count(folder: Path, log: list) -> dict:
    log.append(folder)
    (folder / "weights").write_text(str(len(log)))
    return {"scores": {"f": 50.0 + len(log)}}


def test_a_finished_job_is_not_repeated(tmp_path):
    log: list = []
    first = run_once(tmp_path, config(), lambda _, folder: count(folder, log))
    second = run_once(tmp_path, config(data_dir="/moved"), lambda _, folder: count(folder, log))
    assert len(log) == 1
    assert first == second
    assert first["scores"] == {"f": 51.0}
    assert json.loads((tmp_path / "result.json").read_text()) == first
    assert OmegaConf.load(tmp_path / "config.yaml").rate == 0.1


def test_another_configuration_moves_the_earlier_job_aside(tmp_path):
    log: list = []
    for rate in (0.1, 0.2, 0.3):
        run_once(tmp_path, config(rate=rate), lambda _, folder: count(folder, log))
    assert (tmp_path / "weights").read_text() == "3"
    for number, rate in ((1, 0.1), (2, 0.2)):
        earlier = tmp_path / f"earlier-{number}"
        assert (earlier / "weights").read_text() == str(number)
        assert json.loads((earlier / "result.json").read_text())["scores"] == {"f": 50.0 + number}
        assert OmegaConf.load(earlier / "config.yaml").rate == rate
    assert not (tmp_path / "earlier-3").exists()


def test_files_that_were_there_before_any_job_stay(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    for rate in (0.1, 0.2):
        run_once(tmp_path, config(rate=rate), lambda _, folder: count(folder, []))
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert not (tmp_path / "earlier-1" / "notes.txt").exists()


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_interrupted_job_finds_its_files_again(tmp_path, error):
    def interrupted(_, folder):
        (folder / "state").write_text("epoch 3")
        raise error

    with pytest.raises(error):
        run_once(tmp_path, config(), interrupted)
    assert not (tmp_path / "result.json").exists()
    result = run_once(tmp_path, config(), lambda _, folder: {"state": (folder / "state").read_text()})
    assert result["state"] == "epoch 3"


def test_an_interrupted_job_of_another_configuration_is_not_gone_on_with(tmp_path):
    def interrupted(_, folder):
        (folder / "state").write_text("epoch 3")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_once(tmp_path, config(), interrupted)
    result = run_once(tmp_path, config(rate=1), lambda _, folder: {"resumed": (folder / "state").exists()})
    assert result["resumed"] is False
    assert (tmp_path / "earlier-1" / "state").read_text() == "epoch 3"


def test_of_two_at_once_one_works_and_the_other_waits(tmp_path):
    log: list = []
    inside, go_on = threading.Event(), threading.Event()

    def slow(_, folder):
        inside.set()
        assert go_on.wait(10)
        return count(folder, log)

    results: list = []
    threads = [threading.Thread(target=lambda: results.append(run_once(tmp_path, config(), slow))) for _ in range(2)]
    threads[0].start()
    assert inside.wait(10)
    threads[1].start()
    go_on.set()
    for thread in threads:
        thread.join(10)
    assert len(log) == 1
    assert results[0] == results[1]


def test_numbers_that_json_lacks_become_null(tmp_path):
    result = run_once(tmp_path, config(), lambda *_: {"scores": {"f": math.nan}, "where": Path("x")})
    assert math.isnan(result["scores"]["f"])
    text = (tmp_path / "result.json").read_text()
    assert json.loads(text, parse_constant=pytest.fail)["scores"] == {"f": None}
