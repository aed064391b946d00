from pathlib import Path

import pytest
from omegaconf import OmegaConf

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


def test_all_splits_share_a_folder(tmp_path: Path) -> None:
    config = OmegaConf.create(
        {
            "dataset": {"_target_": "tests.scenes.Scenes"},
            "superpixels": {"_target_": "sgbd.superpixels.Slic", "n_segments": 16},
            "graph": {"_target_": "sgbd.graph.GraphBuilder"},
            "cache_dir": str(tmp_path),
            "workers": 0,
            "on_error": "fail",
        }
    )
    folder = prepare_splits(config, ["val", "test"])
    assert folder.parent == tmp_path
    assert sorted(path.parent.name for path in folder.glob("*/index.json")) == ["test", "val"]
