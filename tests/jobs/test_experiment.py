import json
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from sgbd import Segmenter, __version__
from sgbd.adjacency import LabelMap, Pairs, border_pairs
from sgbd.checkpoint import CheckpointError
from sgbd.jobs.configuration import ConfigurationError, config_folder
from sgbd.jobs.experiment import run_experiment
from sgbd.reporting.panels import read_index
from tests.scenes import Scenes, scene


def own_pairs(label_map: LabelMap) -> Pairs:
    """A user-defined adjacency."""
    return border_pairs(label_map)


class TestOnly(Scenes):
    __test__ = False

    @property
    def splits(self) -> tuple[str, ...]:
        return ("test",)


def small(folder: Path, dataset: str = "tests.scenes.Scenes", logger: str = "csv") -> DictConfig:
    overrides = ["superpixels.n_segments=16", "trainer.epochs=1", "trainer.progress=false", "pictures=1", "workers=0"]
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        config = compose("train", [*overrides, f"logger={logger}", f"cache_dir={folder / 'graphs'}"])
    config.dataset = {"_target_": dataset}
    return config


def test_what_an_experiment_leaves(tmp_path: Path) -> None:
    """From frames to scores, with a user-defined component that must be trusted when the checkpoint is loaded."""
    config = small(tmp_path)
    config.graph = {
        "_target_": "sgbd.graph.GraphBuilder",
        "adjacency": {"_target_": f"{__name__}.own_pairs", "_partial_": True},
    }
    folder = tmp_path / "out"
    result = run_experiment(config, folder)
    assert {"all/overlap_f", "hm/overlap_f", "oracle/overlap_f", "edges/cut_f"} <= set(result["scores"])
    assert json.loads((folder / "scores.json").read_text()) == result["scores"]
    assert {"curves.png", "frames.csv", "history.csv", "scores.md"} <= {path.name for path in folder.iterdir()}
    assert len(list((folder / "pictures").glob("*.png"))) == 1
    (shown,) = read_index(folder / "gallery")
    assert all((folder / "gallery" / file).is_file() for file in shown.panels.values())
    checkpoint = folder / result["checkpoint"]
    with pytest.raises(CheckpointError, match=r"own_pairs, which is not in sgbd"):
        Segmenter.load(checkpoint)
    segmenter = Segmenter.load(checkpoint, trust=["tests"])
    assert segmenter.recipe["seed"] == 0
    assert segmenter.recipe["dataset"]["name"] == "scenes"
    assert np.isfinite(segmenter.segment_frame(scene(0)).edge_probability).all()


def test_a_folder_that_was_not_installed_trains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def of_installed(package: str) -> str:
        if package == "sgbd":
            raise PackageNotFoundError(package)
        return version(package)

    monkeypatch.setattr("sgbd.jobs.experiment.version", of_installed)
    folder = tmp_path / "out"
    result = run_experiment(small(tmp_path), folder)
    versions = Segmenter.load(folder / result["checkpoint"]).recipe["versions"]
    assert versions == {"sgbd": __version__, "torch": version("torch"), "torch-geometric": version("torch-geometric")}


def test_no_logger_is_needed(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    run_experiment(small(tmp_path, logger="[]"), folder)
    assert (folder / "history.csv").is_file()
    assert not (folder / "csv").exists()


def test_tuned_thresholds_are_in_the_checkpoint(tmp_path: Path) -> None:
    config = small(tmp_path)
    config.tuning = {
        "_target_": "sgbd.tuning.Tuning",
        "threshold": [0.3, 0.7],
        "min_objectness": [0.2, 0.6],
        "min_area": [0],
        "rounds": 0,
    }
    folder = tmp_path / "out"
    result = run_experiment(config, folder)
    table = pd.read_csv(folder / "tuning.csv")
    recipe = Segmenter.load(folder / result["checkpoint"]).recipe
    assert recipe["partition"]["threshold"] == table["threshold"][0]
    assert recipe["objects"]["min_objectness"] == table["min_objectness"][0]
    assert recipe["tuning"]["frames"] == 2
    assert recipe["tuning"]["before"] <= recipe["tuning"]["after"] == pytest.approx(table["mean"][0])
    # Continued after the training, the experiment gives the same results, not those of a search started from there.
    before = (folder / result["checkpoint"]).read_bytes()
    assert run_experiment(config, folder)["scores"] == result["scores"]
    assert (folder / result["checkpoint"]).read_bytes() == before


def test_a_dataset_without_training_frames_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"no training frames, only test.*sgbd\.evaluate"):
        run_experiment(small(tmp_path, f"{__name__}.TestOnly"), tmp_path / "out")
