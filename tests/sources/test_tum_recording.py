import logging
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from sgbd.frame import Intrinsics
from sgbd.sources import DatasetNotFoundError, FrameReadError, TumRecording
from sgbd.sources.mosd import KINECT

START = 1305031102


def write_recording(root: Path, colors: list[float], depths: list[float], shape: tuple[int, int] = (6, 8)) -> Path:
    """Write a recording; colour image k is gray of value 10 k, depth image k is 1 + k / 10 metres away."""
    for folder, times in {"rgb": colors, "depth": depths}.items():
        (root / folder).mkdir(parents=True)
        lines = ["# images", "# timestamp filename"]
        for place, time in enumerate(times):
            name = f"{folder}/{START + time:.6f}.png"
            lines.append(f"{START + time:.6f} {name}")
            image = (
                np.full((*shape, 3), 10 * place, np.uint8)
                if folder == "rgb"
                else np.full(shape, 5000 + 500 * place, np.uint16)
            )
            iio.imwrite(root / name, image)
        (root / f"{folder}.txt").write_text("\n".join(lines) + "\n")
    return root


def test_frames_are_paired_by_time_and_units_are_a_five_thousandth(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    # The second colour image is 25 ms from the nearest depth image, and the last depth image has no partner.
    frames = TumRecording(write_recording(tmp_path, [0.0, 0.05, 0.1], [0.015, 0.075, 0.11, 0.5]))
    assert frames.names == (f"{START}.000000", f"{START}.100000")
    assert frames[1].rgb[0, 0].tolist() == [20, 20, 20]
    assert frames[1].depth == pytest.approx(np.full((6, 8), 1.2), abs=1e-6)
    assert frames[1].name == f"{START}.100000"
    assert frames[1].intrinsics is None
    told = caplog.text
    assert "2 frames of colour and depth at most 20 ms apart" in told
    assert "1 of 3 colour and 2 of 4 depth images have no partner" in told
    assert "5000 units a metre (option: depth_scale, now 0.0002)" in told


def test_tolerance_and_scale_are_options(tmp_path: Path) -> None:
    root = write_recording(tmp_path, [0.0, 0.05, 0.1], [0.015, 0.072, 0.11])
    frames = TumRecording(root, tolerance=0.03, depth_scale=0.001)
    assert len(frames) == 3
    assert frames[0].depth[0, 0] == pytest.approx(5.0)
    assert frames.fingerprint() != TumRecording(root).fingerprint()


def test_the_camera_is_that_of_the_benchmark_at_its_size_only(tmp_path: Path) -> None:
    root = write_recording(tmp_path, [0.0], [0.0], (480, 640))
    assert TumRecording(root)[0].intrinsics == KINECT
    mine = Intrinsics(517.3, 516.5, 318.6, 255.3)
    assert TumRecording(root, mine)[0].intrinsics == mine


@pytest.mark.parametrize("first", ["depth", "rgb"])
def test_a_list_of_pairs_is_taken_as_it_is(tmp_path: Path, first: str) -> None:
    root = write_recording(tmp_path, [0.0, 0.1], [0.0, 0.1])
    for name in ("rgb.txt", "depth.txt"):
        (root / name).unlink()
    other = "rgb" if first == "depth" else "depth"
    (root / "associations.txt").write_text(f"1 {first}/{START}.100000.png 7 {other}/{START}.000000.png\n")
    frames = TumRecording(root)
    assert TumRecording.recognizes(root)
    assert [path.relative_to(root).as_posix() for path in frames.files(0)] == (
        [f"rgb/{START}.000000.png", f"depth/{START}.100000.png"]
        if first == "depth"
        else [f"rgb/{START}.100000.png", f"depth/{START}.000000.png"]
    )


def test_clocks_that_disagree_are_told_with_their_difference(tmp_path: Path) -> None:
    with pytest.raises(FrameReadError, match=r"none of the 2 colour .* 20 ms; the least difference is 1\.900 s"):
        len(TumRecording(write_recording(tmp_path, [0.0, 0.1], [2.0, 2.1])))


def test_a_missing_image_is_the_error_of_its_frame(tmp_path: Path) -> None:
    frames = TumRecording(write_recording(tmp_path, [0.0, 0.1], [0.0, 0.1]))
    (tmp_path / f"depth/{START}.000000.png").unlink()
    with pytest.raises(FrameReadError, match=rf"{START}\.000000\.png: the file does not exist"):
        frames[0]
    assert frames[1].depth[0, 0] == pytest.approx(1.1)


def test_lists_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    root = write_recording(tmp_path, [0.0], [0.0])
    text = (root / "rgb.txt").read_text()
    (root / "rgb.txt").write_text(text, encoding="utf-8-sig")
    assert TumRecording(root)[0].depth[0, 0] == pytest.approx(1.0)


def test_what_is_wrong_in_a_list_is_named(tmp_path: Path) -> None:
    root = write_recording(tmp_path, [0.0], [0.0])
    assert TumRecording.recognizes(root)
    for line, reason in {
        "yesterday rgb/1.png": r"rgb\.txt: line 2 should be `timestamp filename`; it is 'yesterday rgb/1\.png'",
        "5": "line 2 should be",
        "nan a.png": "line 2 should be",
        "# nothing": "no image is listed in it",
    }.items():
        (root / "rgb.txt").write_text(f"# images\n{line}\n")
        with pytest.raises(FrameReadError, match=reason):
            len(TumRecording(root))
    (root / "depth.txt").unlink()
    with pytest.raises(DatasetNotFoundError, match=r"there is no depth\.txt"):
        len(TumRecording(root))
    (root / "associations.txt").write_text("1 a/1.png 1 b/1.png\n")
    with pytest.raises(FrameReadError, match="should lie in the folder depth"):
        len(TumRecording(root))


def test_an_image_listed_twice_would_be_written_twice(tmp_path: Path) -> None:
    root = write_recording(tmp_path, [0.0, 0.1], [0.0, 0.1])
    (root / "rgb.txt").write_text(f"{START} rgb/a.png\n{START}.1 rgb/a.png\n")
    with pytest.raises(FrameReadError, match="the colour image 'a' is listed more than once"):
        len(TumRecording(root))


def test_options_out_of_range_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="depth_scale must be positive"):
        TumRecording(tmp_path, depth_scale=0)
    with pytest.raises(ValueError, match="0 or more, in seconds"):
        TumRecording(tmp_path, tolerance=-1)
    with pytest.raises(DatasetNotFoundError, match="the folder does not exist"):
        len(TumRecording(tmp_path / "nowhere"))
