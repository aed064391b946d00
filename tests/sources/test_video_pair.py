import builtins
import logging
import pickle
from pathlib import Path

import numpy as np
import pytest

from sgbd.sources import FrameReadError, MissingExtraError, VideoPair
from tests.video_files import colors, depths, write_video


def pair(folder: Path, n_colors: int, n_depths: int, **options: object) -> VideoPair:
    rgb = write_video(folder / "clip_rgb.mp4", colors(n_colors), "mpeg4", "yuv420p")
    return VideoPair(rgb, write_video(folder / "depth.mkv", depths(n_depths), "ffv1", "gray16le"), **options)


def gray(frames: VideoPair, index: int) -> int:
    """Return the number of the colour image, derived from its gray value."""
    return round(float(frames[index].rgb.mean()) / 20)


@pytest.fixture(autouse=True)
def _needs_pyav(request: pytest.FixtureRequest) -> None:
    if "monkeypatch" not in request.fixturenames:
        pytest.importorskip("av", reason="videos are written and read with PyAV: pip install 'sgbd[video]'")


def test_frames_are_decoded_in_their_order(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    frames = pair(tmp_path, 4, 4)
    assert frames.names == ("clip_000000", "clip_000001", "clip_000002", "clip_000003")
    for index, frame in enumerate(frames):
        assert frame.depth[1:] == pytest.approx(np.full((31, 48), 1 + index / 10), abs=1e-6)
        assert frame.depth[0, 0] == 0
        assert round(float(frame.rgb.mean()) / 20) == index
    assert "4 and 4 frames; the depth (ffv1, gray16le) has 1000 units a metre (option: depth_scale" in caplog.text


def test_an_earlier_frame_is_found_again(tmp_path: Path) -> None:
    frames = pair(tmp_path, 5, 5, depth_scale=0.0001)
    assert [gray(frames, index) for index in (3, 3, 1, 4, 0)] == [3, 3, 1, 4, 0]
    assert frames[2].depth[5, 5] == pytest.approx(0.12)
    frames.close()
    assert gray(frames, 1) == 1


def test_only_one_file_each_is_open_and_none_leaves_the_process(tmp_path: Path) -> None:
    frames = pair(tmp_path, 3, 3)
    assert gray(frames, 1) == 1
    assert gray(pickle.loads(pickle.dumps(frames)), 2) == 2


def test_b_frames_are_in_the_order_of_presentation(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    if "libx264" not in av.codecs_available:
        pytest.skip("this PyAV has no x264, the encoder with B-frames")
    rgb = write_video(tmp_path / "b.mp4", colors(9), "libx264", "yuv420p")
    frames = VideoPair(rgb, write_video(tmp_path / "d.mkv", depths(9), "ffv1", "gray16le"))
    assert [gray(frames, index) for index in range(9)] == list(range(9))


def test_another_length_is_reported_and_what_is_of_one_time_used(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frames = pair(tmp_path, 6, 4)
    assert len(frames) == 4
    assert "clip_rgb.mp4 has 6 frames (30 a second)" in caplog.text
    assert "4 pairs of equal time are used" in caplog.text
    assert frames[3].depth[5, 5] == pytest.approx(1.3)


def test_a_frame_that_was_never_recorded_shifts_nothing(tmp_path: Path) -> None:
    rgb = write_video(tmp_path / "clip.mp4", colors(6), "mpeg4", "yuv420p")
    depth = write_video(tmp_path / "d.mkv", depths(5), "ffv1", "gray16le", moments=[0, 1, 3, 4, 5])
    frames = VideoPair(rgb, depth)
    assert frames.names == tuple(f"clip_00000{place}" for place in (0, 1, 3, 4, 5))
    assert [gray(frames, index) for index in range(5)] == [0, 1, 3, 4, 5]
    assert [round(float(frame.depth[5, 5]), 4) for frame in frames] == [1.0, 1.1, 1.2, 1.3, 1.4]


def test_equally_many_frames_are_paired_by_order_and_other_times_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rgb = write_video(tmp_path / "clip.mp4", colors(5), "mpeg4", "yuv420p", rate=30)
    frames = VideoPair(rgb, write_video(tmp_path / "d.mkv", depths(5), "ffv1", "gray16le", rate=10))
    assert len(frames) == 5
    assert "up to 0.27 s apart" in caplog.text
    assert frames[4].depth[5, 5] == pytest.approx(1.4)


def test_a_damaged_frame_is_its_own_error(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    noise = np.random.default_rng(0)
    images = [noise.integers(500, 4000, (32, 48)).astype(np.uint16) for _ in range(5)]
    # PNG has checksums, so that its decoder reports damage.
    path = write_video(tmp_path / "d.mov", images, "png", "gray16be")
    with av.open(str(path)) as container:
        packet = [bytes(packet) for packet in container.demux(video=0)][2]
    data = bytearray(path.read_bytes())
    start = data.find(packet)
    assert start > 0
    for place in range(start + len(packet) // 2, start + len(packet) // 2 + 20):
        data[place] ^= 255
    path.write_bytes(data)
    frames = VideoPair(write_video(tmp_path / "c.mp4", colors(5), "mpeg4", "yuv420p"), path)
    for index in (*range(5), *range(5)):
        if index == 2:
            with pytest.raises(FrameReadError, match=rf"d\.mov: frame {index} is damaged"):
                frames[index]
        else:
            assert frames[index].depth == pytest.approx(images[index] / 1000, abs=1e-6)


def test_the_other_byte_order(tmp_path: Path) -> None:
    rgb = write_video(tmp_path / "c.mp4", colors(2), "mpeg4", "yuv420p")
    path = write_video(tmp_path / "d.mov", depths(2), "png", "gray16be")
    assert VideoPair(rgb, path)[1].depth[5, 5] == pytest.approx(1.1)


def test_what_is_no_depth_is_refused(tmp_path: Path) -> None:
    rgb = write_video(tmp_path / "c.mp4", colors(2), "mpeg4", "yuv420p")
    depth = write_video(tmp_path / "d.mkv", depths(2), "ffv1", "gray16le")
    with pytest.raises(FrameReadError, match=r"c\.mp4: the depth needs one channel .* this video has yuv420p"):
        len(VideoPair(rgb, rgb))
    with pytest.raises(FrameReadError, match=r"d\.mkv: .*are rgb and depth swapped"):
        len(VideoPair(depth, rgb))
    small = write_video(tmp_path / "s.mkv", depths(2, (16, 24)), "ffv1", "gray16le")
    with pytest.raises(FrameReadError, match="the depth has 24x16 pixels and the colours 48x32"):
        len(VideoPair(rgb, small))
    with pytest.raises(ValueError, match="depth_scale must be positive"):
        VideoPair(rgb, depth, depth_scale=-1)


def test_what_is_no_video_is_refused(tmp_path: Path) -> None:
    rgb = write_video(tmp_path / "c.mp4", colors(2), "mpeg4", "yuv420p")
    (tmp_path / "text.mkv").write_text("no video")
    with pytest.raises(FrameReadError, match=r"text\.mkv: this is no video"):
        len(VideoPair(rgb, tmp_path / "text.mkv"))
    with pytest.raises(FrameReadError, match="does not exist"):
        len(VideoPair(tmp_path / "nowhere.mp4", rgb))


def test_without_the_extra_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    real = builtins.__import__

    def without(name: str, *args: object, **kwargs: object) -> object:
        if name == "av":
            raise ImportError("No module named 'av'")
        return real(name, *args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match=r"pip install 'sgbd\[video\]'"):
        len(VideoPair(tmp_path / "a.mp4", tmp_path / "b.mkv"))
