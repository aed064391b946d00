"""python -m sgbd.evaluate predictions=…: another system's label images, from files to files."""

from __future__ import annotations

import json
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pandas as pd
import pytest

from tests.scenes import scene
from tests.test_commands import Command, command, frames  # noqa: F401


@pytest.fixture
def label_images(tmp_path: Path) -> Path:
    """Write the ground truth of one test frame, and that of the other one with its objects merged."""
    folder = tmp_path / "other_system"
    folder.mkdir()
    iio.imwrite(folder / "scene5.png", np.maximum(scene(5).instances - 1, 0).astype(np.uint16))
    iio.imwrite(folder / "scene6_labels.png", (scene(6).instances > 1).astype(np.uint8))
    return folder


def test_label_images_of_another_system(
    command: Command,  # noqa: F811
    frames: Path,  # noqa: F811
    label_images: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    here = ("dataset=folder", f"dataset.root={frames}", f"predictions={label_images}", "workers=0")
    assert command("evaluate", *here, "hydra.run.dir=all") == 0
    table = pd.read_csv(tmp_path / "all/frames.csv", index_col="name")
    assert table["unaided_overlap_f_measure"]["scene5"] == 1
    assert table["unaided_overlap_f_measure"]["scene6"] < 0.6
    scores = json.loads((tmp_path / "all/scores.json").read_text())
    assert scores["unaided/f75"] == 0.5
    assert f"predictions: {label_images}" in (tmp_path / "all/config.yaml").read_text(), "what was scored on what"
    assert "2 frames of test, per cent" in capsys.readouterr().out
    (label_images / "scene6_labels.png").unlink()
    assert command("evaluate", *here, "hydra.run.dir=one") == 0
    told = capsys.readouterr()
    assert "left out: 1 of 2 frames. scene6: " in told.err
    assert "1 frame of test (1 more left out, see above), per cent" in told.out
    assert json.loads((tmp_path / "one/scores.json").read_text())["unaided/overlap_f"] == 1
    assert command("evaluate", *here, "on_error=fail", "hydra.run.dir=strict") == 1
    assert "frame scene6: " in capsys.readouterr().err
    assert command("evaluate", *here, "checkpoint=a", "hydra.run.dir=both") == 1
    assert "not both" in capsys.readouterr().err
    assert command("evaluate", *here[:2], "predictions=nowhere", "hydra.run.dir=none") == 1
    assert "there is no folder nowhere" in capsys.readouterr().err
