from pathlib import Path

import pytest
from omegaconf import DictConfig, OmegaConf

from sgbd.jobs.configuration import ConfigurationError
from sgbd.jobs.pipeline import frame_source, prepare_splits
from tests.scenes import Scenes

generated_with: list[int] = []


class Generated(Scenes):
    """A dataset that is generated before reading."""

    def generate(self, workers: int) -> None:
        generated_with.append(workers)


@pytest.mark.parametrize("workers", [0, 3])
def test_a_dataset_is_generated_with_the_configured_workers(workers: int) -> None:
    generated_with.clear()
    source = frame_source(OmegaConf.create({"_target_": f"{__name__}.Generated"}), workers, "val")
    assert source.split == "val"
    assert generated_with == [workers]


def test_a_value_that_a_dataset_within_another_one_lacks_is_named() -> None:
    inner = {"_target_": "sgbd.sources.Folder", "_partial_": True, "root": "???"}
    config = OmegaConf.create({"dataset": {"_target_": "sgbd.sources.Augmented", "source": inner}})
    with pytest.raises(ConfigurationError, match=r"^dataset.source.root is not set. .* dataset.source.root=<value>$"):
        frame_source(config.dataset, 0)


class RootOfSplit(Scenes):
    """A dataset whose root is the folder of its split."""

    @property
    def root(self) -> str:
        return f"/data/{self.split}"


def preparation(folder: Path, dataset: str) -> DictConfig:
    return OmegaConf.create(
        {
            "dataset": {"_target_": dataset},
            "superpixels": {"_target_": "sgbd.superpixels.Slic", "n_segments": 16},
            "graph": {"_target_": "sgbd.graph.GraphBuilder"},
            "cache_dir": str(folder),
            "workers": 0,
            "on_error": "fail",
        }
    )


def test_splits_that_would_not_share_a_folder_are_refused(tmp_path: Path) -> None:
    config = preparation(tmp_path / "graphs", f"{__name__}.RootOfSplit")
    with pytest.raises(
        ConfigurationError,
        match=r"from val to test its root is /data/val and /data/test\. .* must not depend on the split",
    ):
        prepare_splits(config, ["val", "test"])
    assert not (tmp_path / "graphs").exists()


def test_all_splits_share_a_folder(tmp_path: Path) -> None:
    folder = prepare_splits(preparation(tmp_path, "tests.scenes.Scenes"), ["val", "test"])
    assert folder.parent == tmp_path
    assert sorted(path.parent.name for path in folder.glob("*/index.json")) == ["test", "val"]
