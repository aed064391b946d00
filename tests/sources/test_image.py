"""Image files: all supported kinds are read exactly, all others are rejected with the file name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from PIL import Image, ImageFile

from sgbd.frame import FrameError
from sgbd.sources.errors import FrameReadError
from sgbd.sources.image import image_files, read_depth, read_labels, read_rgb

RNG = np.random.default_rng(0)
COLORS = RNG.integers(0, 256, (24, 32, 3), dtype=np.uint8)
GRAY = COLORS[..., 0]
DEPTH = RNG.integers(0, 65536, (24, 32), dtype=np.uint16)


def saved(path: Path, array: npt.NDArray[np.generic], **options: object) -> Path:
    Image.fromarray(array).save(path, **options)  # type: ignore[arg-type]
    return path


def test_images_of_a_folder_are_sorted_and_hidden_ones_left_out(tmp_path: Path) -> None:
    for name in ("b.png", "a.JPG", "c.jpeg", "._b.png", ".hidden.png", "d.txt"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "folder.png").mkdir()
    assert [path.name for path in image_files(tmp_path)] == ["a.JPG", "b.png", "c.jpeg"]


def test_rgb_png_is_exact(tmp_path: Path) -> None:
    read = read_rgb(saved(tmp_path / "a.png", COLORS))
    assert read.dtype == np.uint8
    assert np.array_equal(read, COLORS)
    assert read.flags.writeable


def test_rgb_jpeg_is_close(tmp_path: Path) -> None:
    smooth = np.repeat(np.linspace(0, 255, 32).astype(np.uint8)[None, :, None], 24, axis=0).repeat(3, axis=2)
    read = read_rgb(saved(tmp_path / "a.jpeg", smooth, quality=95))
    assert np.abs(read.astype(int) - smooth).max() <= 6


def test_grey_is_repeated(tmp_path: Path) -> None:
    assert np.array_equal(read_rgb(saved(tmp_path / "a.png", GRAY)), np.repeat(GRAY[..., None], 3, axis=2))


def test_alpha_is_dropped_without_blending(tmp_path: Path) -> None:
    half = np.dstack([COLORS, np.full(GRAY.shape, 10, np.uint8)])
    assert np.array_equal(read_rgb(saved(tmp_path / "a.png", half)), COLORS)


def test_palette_colours_are_looked_up(tmp_path: Path) -> None:
    image = Image.fromarray(np.array([[0, 1], [2, 1]], np.uint8))
    image.putpalette([255, 0, 0, 0, 255, 0, 0, 0, 255])
    image.save(tmp_path / "a.png")
    assert read_rgb(tmp_path / "a.png").tolist() == [[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [0, 255, 0]]]
    assert read_labels(tmp_path / "a.png").tolist() == [[0, 1], [2, 1]]


def test_depth_is_metres(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.png", DEPTH)
    read = read_depth(path)
    assert read.dtype == np.float32
    assert np.array_equal(read, DEPTH.astype(np.float32) * np.float32(0.001))
    assert np.array_equal(read_depth(path, scale=0.0002), DEPTH.astype(np.float32) * np.float32(0.0002))


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from([np.uint8, np.uint16]).flatmap(
        lambda dtype: arrays.arrays(dtype, st.tuples(st.integers(1, 9), st.integers(1, 9)))
    )
)
def test_labels_are_exact(tmp_path: Path, labels: npt.NDArray[np.unsignedinteger]) -> None:
    read = read_labels(saved(tmp_path / "a.png", labels))
    assert read.dtype == np.int32
    assert np.array_equal(read, labels)


def test_the_content_and_not_the_name_decides(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.png", COLORS).rename(tmp_path / "a.jpeg")
    assert np.array_equal(read_rgb(path), COLORS)


@pytest.mark.parametrize("reader", [read_rgb, read_depth, read_labels])
def test_a_missing_file_is_named(tmp_path: Path, reader: object) -> None:
    with pytest.raises(FrameReadError, match=r"gone\.png: the file does not exist"):
        reader(tmp_path / "gone.png")  # type: ignore[operator]


@pytest.mark.parametrize(
    "content", [b"hello, world", b"\x89PNG\r\n\x1a\n", b"\x89PNG\r\n\x1a\nIEND\xaeB`\x82", b"GIF89a"]
)
def test_what_is_no_image_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(FrameReadError, match=r"a\.png: (this is neither a PNG nor a JPEG|the image is damaged)"):
        read_rgb(tmp_path / "a.png")


def test_an_empty_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").touch()
    with pytest.raises(FrameReadError, match="empty"):
        read_rgb(tmp_path / "a.png")


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FrameReadError, match="cannot be read"):
        read_rgb(tmp_path)


@pytest.mark.parametrize("lenient", [False, True], ids=["strict", "pillow-told-to-pad"])
@pytest.mark.parametrize("suffix", ["png", "jpeg"])
def test_a_truncated_file_is_never_padded(
    tmp_path: Path, suffix: str, lenient: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ImageFile, "LOAD_TRUNCATED_IMAGES", lenient)
    path = saved(tmp_path / f"a.{suffix}", COLORS)
    whole = path.read_bytes()
    for size in (*range(30, len(whole), 97), len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(FrameReadError, match=rf"a\.{suffix}: (the (PNG|JPEG) file is|.*) ?(truncated|neither)"):
            read_rgb(path)


def test_truncated_depth_and_labels_are_refused(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.png", DEPTH)
    path.write_bytes(path.read_bytes()[:-200])
    for reader in (read_depth, read_labels):
        with pytest.raises(FrameReadError, match="truncated"):
            reader(path)


def test_damaged_pixels_are_refused(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.png", DEPTH)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(FrameReadError, match=r"a\.png: the image is damaged"):
        read_depth(path)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (GRAY, "8 bits a pixel"),
        (GRAY > 127, "8 bits a pixel"),
        (COLORS, r"3 channels \(RGB\)"),
        (np.dstack([COLORS, GRAY]), r"4 channels \(RGBA\)"),
        (np.dstack([GRAY, GRAY]), r"2 channels \(LA\)"),
    ],
)
def test_a_picture_of_the_depth_is_no_depth(tmp_path: Path, array: npt.NDArray[np.generic], message: str) -> None:
    with pytest.raises(FrameReadError, match=message):
        read_depth(saved(tmp_path / "a.png", array))


@pytest.mark.parametrize("reader", [read_depth, read_labels])
def test_jpeg_is_refused_where_values_count(tmp_path: Path, reader: object) -> None:
    with pytest.raises(FrameReadError, match="must not be stored as JPEG"):
        reader(saved(tmp_path / "a.jpeg", GRAY))  # type: ignore[operator]


def test_depth_given_as_colours_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FrameReadError, match="swapped"):
        read_rgb(saved(tmp_path / "a.png", DEPTH))


def test_label_colours_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FrameReadError, match=r"has 3 \(RGB\)"):
        read_labels(saved(tmp_path / "a.png", COLORS))


def test_a_read_error_is_a_frame_error_and_survives_a_process_border(tmp_path: Path) -> None:
    import pickle

    error = FrameReadError(tmp_path / "a.png", "broken")
    copy = pickle.loads(pickle.dumps(error))
    assert isinstance(copy, FrameError)
    assert str(copy) == f"{tmp_path / 'a.png'}: broken"
