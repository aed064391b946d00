from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from sgbd.label_images import LabelImages, LabelImagesError
from sgbd.sources import FrameReadError
from tests.scenes import HEIGHT, WIDTH, scene

LABELS = np.arange(HEIGHT * WIDTH, dtype=np.uint16).reshape(HEIGHT, WIDTH) % 4


def test_both_names_and_both_ways_to_write_a_slash(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    for name in ("a.png", "b_labels.png", "one/c.png", "one_d_labels.png"):
        iio.imwrite(tmp_path / name, LABELS)
    images = LabelImages(tmp_path)
    assert images.missing(["a", "b", "one/c", "one/d"]) == []
    assert images.missing(["a", "e", "one/e"]) == ["e", "one/e"]
    assert images.path("one/d") == tmp_path / "one_d_labels.png"


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_ids_below_the_first_object_are_none(tmp_path: Path, dtype: type) -> None:
    iio.imwrite(tmp_path / "scene3.png", LABELS.astype(dtype))
    labels = LabelImages(tmp_path)(scene(3))
    assert labels.dtype == np.int32
    assert (labels == LABELS).all()
    assert (LabelImages(tmp_path, first_object=2)(scene(3)) == np.where(LABELS == 1, 0, LABELS)).all()


def test_errors_say_what_is_expected(tmp_path: Path) -> None:
    with pytest.raises(LabelImagesError, match=r"no folder .*nowhere.*NAME\.png"):
        LabelImages(tmp_path / "nowhere")
    with pytest.raises(LabelImagesError, match="first_object must be at least 1"):
        LabelImages(tmp_path, 0)
    images = LabelImages(tmp_path)
    with pytest.raises(LabelImagesError, match=r"2 frames \(no PNG files\)\. Expected a\.png or a_labels\.png"):
        images.missing(["a", "b"])
    iio.imwrite(tmp_path / "other.png", LABELS)
    with pytest.raises(LabelImagesError, match=r"it holds other\.png\)"):
        images.missing(["a", "b"])
    with pytest.raises(FrameReadError, match="the frame has no label image"):
        images(scene(3))
    iio.imwrite(tmp_path / "scene3.png", LABELS[:, 1:])
    with pytest.raises(FrameReadError, match=rf"{WIDTH - 1}x{HEIGHT} pixels and its frame {WIDTH}x{HEIGHT}"):
        images(scene(3))
    iio.imwrite(tmp_path / "scene3.png", np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    with pytest.raises(FrameReadError, match="one channel"):
        images(scene(3))
