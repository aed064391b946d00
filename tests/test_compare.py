"""python -m sgbd.compare, from files to files."""

from __future__ import annotations

import json
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pandas as pd
import pytest

from tests.test_commands import Command, command, frames, trained  # noqa: F401
from tests.test_evaluate import label_images  # noqa: F401

BASELINES = "baseline=[threshold_cut,plane_removal]"


def test_models_baselines_and_label_images_side_by_side(
    command: Command,  # noqa: F811
    frames: Path,  # noqa: F811
    trained: Path,  # noqa: F811
    label_images: Path,  # noqa: F811
    tmp_path: Path,
) -> None:
    here = (
        "dataset=folder", f"dataset.root={frames}", BASELINES, "superpixels.n_segments=12", "workers=0", "pictures=1",
        f"checkpoints={{untrained: {trained}}}", f"predictions={{other one: {label_images}}}",
        "sections=[scores,failures,pictures]",
    )  # fmt: skip
    assert command("compare", *here, "hydra.run.dir=out") == 0
    out = tmp_path / "out"
    rows = pd.read_csv(out / "comparison.csv", index_col="method")
    assert rows["kind"].to_dict() == {
        "untrained": "model",
        "threshold_cut": "baseline",
        "plane_removal": "baseline",
        "other one": "label images",
    }
    assert rows.loc["other one", "unaided/f75"] == 0.5
    assert np.isnan(rows.loc["threshold_cut", "unaided/f75"])
    # The scores equal those of python -m sgbd.evaluate.
    evaluated = ("dataset=folder", f"dataset.root={frames}", f"checkpoint={trained}", "workers=0", "pictures=0")
    assert command("evaluate", *evaluated, "hydra.run.dir=evaluated") == 0
    for name, score in json.loads((tmp_path / "evaluated/scores.json").read_text()).items():
        assert rows.loc["untrained", name] == pytest.approx(score)
    counts = pd.read_csv(out / "failures.csv", index_col="method")
    assert (counts["objects"] == 6).all()
    assert counts.loc["other one", "found"] == 3
    assert counts.loc["other one", "over-merged"] == 3
    pages = (out / "failures.md").read_text()
    assert "`scene6`, 3 objects: 3 over-merged" in pages
    assert "![scene6](failures/other%20one/scene6.png)" in pages
    for picture in ("failures/other one/scene6.png", "pictures/untrained.png", "pictures/methods.png"):
        assert iio.imread(out / picture).std() > 10


def test_what_methods_cost(
    command: Command,  # noqa: F811
    frames: Path,  # noqa: F811
    trained: Path,  # noqa: F811
    label_images: Path,  # noqa: F811
    tmp_path: Path,
) -> None:
    here = (
        "dataset=folder", f"dataset.root={frames}", "baseline=[threshold_cut]", "superpixels.n_segments=12",
        "workers=0", f"checkpoints={{untrained: {trained}}}", f"predictions={{other: {label_images}}}",
        "sections=[cost]", "cost_frames=1", "cost_repeats=1",
    )  # fmt: skip
    assert command("compare", *here, "hydra.run.dir=out") == 0
    table = json.loads((tmp_path / "out/cost.json").read_text())["tables"]["cost"]
    cost = {row["method"]: row for row in table["rows"]}
    assert list(cost) == ["untrained", "threshold_cut"], "label images have no cost"
    assert cost["untrained"]["parameters"] > 0
    assert cost["untrained"]["kilobytes"] == pytest.approx(trained.stat().st_size / 1000)
    for row in cost.values():
        whole = row["preprocessing_ms"] + row["without_preprocessing_ms"]
        assert row["frame_ms"] == pytest.approx(whole), "one repetition: medians add up"
        assert row["peak_mib"] > 0
    assert not (tmp_path / "out/comparison.csv").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("sections=[speed]",), "sections must be a list of scores, failures, pictures, cost"),
        (("baseline=[]",), "there is nothing to compare"),
        (("predictions={plane_removal: .}",), "two methods are called plane_removal"),
        (("pictures=0",), "pictures must be a number from 1; got 0"),
        (("split=val2",), "val2"),
    ],
)
def test_what_cannot_be_compared(
    command: Command,  # noqa: F811
    frames: Path,  # noqa: F811
    options: tuple[str, ...],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    here = ("dataset=folder", f"dataset.root={frames}", "workers=0", "hydra.run.dir=out")
    assert command("compare", *here, *options) == 1
    assert message in capsys.readouterr().err
