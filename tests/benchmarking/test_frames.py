from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from sgbd.benchmarking.dataset import IGNORED, write_dataset
from sgbd.benchmarking.frames import RawFrame, made_up_scene, raw_frames
from sgbd.jobs.configuration import ConfigurationError
from sgbd.sources import DatasetNotFoundError


@settings(max_examples=15)
@given(st.integers(8, 70), st.integers(8, 70), st.integers(0, 50))
def test_scenes_of_any_size_are_valid_frames(width, height, seed):
    raw = made_up_scene(width, height, seed)
    frame = raw.frame()
    assert (frame.width, frame.height) == (width, height)
    assert frame.instances is not None
    assert {0, 1} <= set(np.unique(frame.instances))
    again = made_up_scene(width, height, seed)
    assert np.array_equal(raw.rgb, again.rgb)
    assert np.array_equal(raw.depth, again.depth)


def test_a_scene_has_objects_that_stand_out_and_holes():
    frame = made_up_scene(320, 240, 1).frame()
    assert frame.instances is not None
    objects = np.unique(frame.instances[frame.instances > 1])
    assert len(objects) >= 8
    assert 0.005 < (frame.depth == 0).mean() < 0.2
    assert 0.5 < frame.depth[frame.depth > 0].min() < frame.depth.max() < 3
    assert not np.array_equal(frame.rgb, made_up_scene(320, 240, 2).rgb)


def write_frame(folder, name: str, width: int, height: int) -> None:
    rgb = np.arange(height * width * 3).reshape(height, width, 3) % 256
    Image.fromarray(rgb.astype(np.uint8)).save(folder / f"{name}_rgb.png")
    Image.fromarray(np.full((height, width), 1234, np.uint16)).save(folder / f"{name}_depth.png")


def test_a_folder_is_sampled_evenly_and_resampled(tmp_path):
    for number in range(5):
        write_frame(tmp_path, f"f{number}", 8, 6)
    frames = raw_frames(str(tmp_path), None, 3, seed=0)
    assert [raw.name for raw in frames] == ["f0", "f2", "f4"]
    assert frames[0].depth.dtype == np.uint16
    assert (frames[0].depth == 1234).all()
    (half,) = raw_frames(str(tmp_path), (4, 3), 1, seed=0)
    assert np.array_equal(half.rgb, frames[0].rgb[1::2, 1::2])


def test_frames_of_several_sizes_need_one(tmp_path):
    write_frame(tmp_path, "a", 8, 6)
    write_frame(tmp_path, "b", 6, 8)
    with pytest.raises(ConfigurationError, match=r"6x8, 8x6.*size=\[640,480\]"):
        raw_frames(str(tmp_path), None, 2, seed=0)
    assert len(raw_frames(str(tmp_path), (6, 6), 2, seed=0)) == 2


def test_impossible_frames(tmp_path):
    with pytest.raises(ConfigurationError, match="frame_count must be at least 1; got 0"):
        raw_frames(None, None, 0, seed=0)
    with pytest.raises(ConfigurationError, match=r"size must be \[width, height\].*got \[640\]"):
        raw_frames(None, (640,), 1, seed=0)  # type: ignore[arg-type]
    with pytest.raises(DatasetNotFoundError):
        raw_frames(str(tmp_path / "nowhere"), None, 1, seed=0)


def test_a_written_dataset_reads_as_the_frames(tmp_path):
    first, second = made_up_scene(40, 30, 0), made_up_scene(40, 30, 1)
    assert first.instances is not None
    first.instances[:2] = -1
    source = write_dataset([first, second], 5, tmp_path)
    assert len(source) == 5
    for index, raw in enumerate([first, second, first, second, first]):
        frame, expected = source[index], raw.frame()
        assert np.array_equal(frame.rgb, expected.rgb)
        np.testing.assert_allclose(frame.depth, expected.depth, atol=1e-6)
        assert np.array_equal(frame.instances, expected.instances)
    assert expected.instances.max() < IGNORED
    # Only two frames take space on the disk.
    assert sorted(path.name for path in tmp_path.iterdir() if not path.is_symlink()) == [
        f"00000{number}_{kind}.png" for number in (0, 1) for kind in ("depth", "labels", "rgb")
    ]


def test_training_and_evaluation_need_truth(tmp_path):
    raw = made_up_scene(40, 30, 0)
    without = RawFrame(raw.rgb, raw.depth, None, None, "mine")
    with pytest.raises(ConfigurationError, match="frame 'mine' has no label image.*frames=null"):
        write_dataset([without], 1, tmp_path)
