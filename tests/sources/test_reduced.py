from functools import partial
from pathlib import Path

import numpy as np
import pytest

from sgbd.reduction import reduced
from sgbd.sources import Reduced
from tests.scenes import Scenes


def scenes(split: str) -> Scenes:
    return Scenes(split)


def test_frames_are_those_of_the_dataset_at_a_fraction_of_their_size() -> None:
    source, plain = Reduced(scenes, "train", factor=3), Scenes("train")
    assert source.names == plain.names
    assert source.splits == plain.splits
    assert source.category_names == plain.category_names
    assert source.seen == plain.seen
    assert source.split == "train"
    for found, frame in zip(source, plain, strict=True):
        expected = reduced(frame, 3)
        for field in ("rgb", "depth", "instances"):
            np.testing.assert_array_equal(getattr(found, field), getattr(expected, field))
        assert found.intrinsics == expected.intrinsics
        assert found.categories == frame.categories


def test_the_factor_and_the_dataset_are_part_of_the_recipe() -> None:
    source = Reduced(scenes, factor=2)
    assert source.options() == {
        "factor": 2,
        "source": {"_target_": "tests.scenes.Scenes", **Scenes("test").options()},
    }
    assert source.fingerprint() != Reduced(scenes, factor=4).fingerprint()
    assert source.files(0) == Scenes("test").files(0)


@pytest.mark.parametrize("factor", [0, 1.5, True])
def test_factors_are_positive_integers(factor: float) -> None:
    with pytest.raises(ValueError, match="factor must be a positive integer"):
        Reduced(scenes, factor=factor)


def test_a_synthetic_dataset_is_generated(tmp_path: Path) -> None:
    calls = []

    class Made(Scenes):
        root = tmp_path

        def generate(self, workers: int, progress: bool) -> None:
            calls.append((workers, progress))

    source = Reduced(partial(Made))
    source.generate(workers=3, progress=False)
    assert calls == [(3, False)]
    assert source.root == tmp_path
    Reduced(scenes).generate()
