"""PCD files in all encodings, organised and not."""

from __future__ import annotations

import builtins
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("pypcd4", reason="needs the extra sgbd[pcd]")

from sgbd.frame import Intrinsics
from sgbd.sources.errors import FrameReadError, MissingExtraError
from sgbd.sources.point_cloud import PointCloud, organized_depth, read_point_cloud
from tests.sources.pcd_files import lzf, pack_colors, write_pcd

CAMERA = Intrinsics(10.0, 12.0, 1.5, 1.0)
DEPTH = np.array([[1, 2, 0, 1], [1.5, 1, 2, 2], [3, 1, 1, 0]], np.float32)
RGB = np.arange(36, dtype=np.uint8).reshape(3, 4, 3) * 7
LABELS = np.arange(12, dtype=np.uint32).reshape(3, 4)


def points_of(depth: np.ndarray, camera: Intrinsics) -> np.ndarray:
    """Return points, float32 [H, W, 3]; NaN if there is no depth."""
    rows, columns = np.indices(depth.shape)
    xyz = np.stack([(columns - camera.cx) / camera.fx * depth, (rows - camera.cy) / camera.fy * depth, depth], axis=2)
    return np.where(depth[..., None] > 0, xyz, np.nan).astype(np.float32)


def columns(color: str = "rgba") -> dict[str, np.ndarray]:
    xyz = points_of(DEPTH, CAMERA)
    packed = pack_colors(RGB)
    return {
        **{name: xyz[..., place] for place, name in enumerate("xyz")},
        color: packed.view(np.float32) if color == "rgb" else packed,
        "label": LABELS,
    }


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_an_organised_cloud_is_an_image(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.pcd"
    write_pcd(path, columns(), 3, 4, encoding)
    cloud = read_point_cloud(path)
    assert cloud.organized
    np.testing.assert_allclose(cloud.depth(), DEPTH)
    assert cloud.rgb is not None
    assert cloud.labels is not None
    np.testing.assert_array_equal(cloud.rgb.reshape(3, 4, 3), RGB)
    np.testing.assert_array_equal(cloud.labels.reshape(3, 4), LABELS)


@pytest.mark.parametrize("encoding", ["binary", "binary_compressed"])
def test_colours_may_be_packed_into_floats_and_fields_be_in_any_order(tmp_path: Path, encoding: str) -> None:
    fields = columns("rgb")
    write_pcd(tmp_path / "a.pcd", {name: fields[name] for name in ("label", "rgb", "z", "y", "x")}, 3, 4, encoding)
    cloud = read_point_cloud(tmp_path / "a.pcd")
    assert cloud.rgb is not None
    np.testing.assert_array_equal(cloud.rgb.reshape(3, 4, 3), RGB)
    np.testing.assert_allclose(cloud.depth(), DEPTH)


@settings(max_examples=30)
@given(
    st.binary(min_size=1, max_size=400)
    | st.builds(bytes.__mul__, st.binary(min_size=1, max_size=2), st.integers(1, 700))
)
def test_compression_of_any_bytes_is_undone(data: bytes) -> None:
    module = pytest.importorskip("lzf")
    assert module.decompress(lzf(data), len(data)) == data


def test_points_without_colours_and_labels(tmp_path: Path) -> None:
    fields = columns()
    write_pcd(tmp_path / "a.pcd", {name: fields[name] for name in "xyz"}, 1, 12)
    cloud = read_point_cloud(tmp_path / "a.pcd")
    assert (cloud.rgb, cloud.labels, cloud.organized) == (None, None, False)


def test_the_camera_is_fitted_to_an_organised_cloud(tmp_path: Path) -> None:
    write_pcd(tmp_path / "a.pcd", columns(), 3, 4)
    fitted = read_point_cloud(tmp_path / "a.pcd").intrinsics()
    assert fitted is not None
    assert [fitted.fx, fitted.fy, fitted.cx, fitted.cy] == pytest.approx([10, 12, 1.5, 1.0], abs=1e-4)
    depth, camera = organized_depth(tmp_path / "a.pcd", None)
    assert camera == fitted
    np.testing.assert_allclose(depth, DEPTH)
    assert organized_depth(tmp_path / "a.pcd", CAMERA)[1] == CAMERA


def test_a_camera_cannot_be_fitted_to_one_row_or_one_point() -> None:
    xyz = np.full((6, 3), np.nan, np.float32)
    xyz[0] = (0.1, 0.2, 1)
    assert PointCloud(xyz, None, None, 2, 3).intrinsics() is None
    xyz[1] = (0.2, 0.2, 1)
    assert PointCloud(xyz, None, None, 2, 3).intrinsics() is None


def test_unorganised_points_return_to_their_pixels_in_any_order() -> None:
    xyz = points_of(DEPTH, CAMERA).reshape(-1, 3)
    order = np.random.default_rng(0).permutation(np.flatnonzero(DEPTH.ravel() > 0))
    cloud = PointCloud(xyz[order], RGB.reshape(-1, 3)[order], LABELS.ravel().astype(np.int32)[order], 1, len(order))
    image = cloud.projected(CAMERA, 3, 4)
    np.testing.assert_allclose(image.depth(), DEPTH)
    assert image.rgb is not None
    assert image.labels is not None
    np.testing.assert_array_equal(image.rgb.reshape(3, 4, 3), np.where(DEPTH[..., None] > 0, RGB, 0))
    np.testing.assert_array_equal(image.labels.reshape(3, 4), np.where(DEPTH > 0, LABELS, 0))


def test_of_several_points_in_a_pixel_the_nearest_is_seen() -> None:
    xyz = np.array([[0, 0, 2], [0, 0, 1], [0, 0, 3], [0, 0, np.nan], [0, 0, -1], [100, 0, 1]], np.float32)
    labels = np.array([20, 30, 40, 50, 60, 70], np.int32)
    image = PointCloud(xyz, None, labels, 1, 6).projected(Intrinsics(1, 1, 1, 0), 1, 3)
    assert image.depth().tolist() == [[0, 1, 0]]
    assert image.labels is not None
    assert image.labels.tolist() == [0, 30, 0]


def test_points_outside_of_the_image_tell_of_a_wrong_camera() -> None:
    cloud = PointCloud(points_of(DEPTH, CAMERA).reshape(-1, 3), None, None, 1, 12)
    with pytest.raises(ValueError, match=r"only 0 of 10 points lie in the 4x3 pixels.*`intrinsics`"):
        cloud.projected(Intrinsics(10, 12, 500, 1), 3, 4)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("kept", [0.97, 0.6])
def test_truncated_files_are_named(tmp_path: Path, encoding: str, kept: float) -> None:
    path = tmp_path / "a.pcd"
    write_pcd(path, columns(), 3, 4, encoding)
    content = path.read_bytes()
    start = content.index(b"DATA")
    # Cutting within the last number of an ascii row would leave a shorter, undetectable number.
    path.write_bytes(content[: start + int(kept * (len(content) - start)) - 10])
    with pytest.raises(FrameReadError, match=r"a\.pcd"):
        read_point_cloud(path)


@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n\xff\xfe", b"VERSION 0.7\nFIELDS x\nDATA ascii\n"])
def test_other_files_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.pcd").write_bytes(content)
    with pytest.raises(FrameReadError, match=r"a\.pcd: this is no point cloud"):
        read_point_cloud(tmp_path / "a.pcd")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FrameReadError, match=r"a\.pcd: the file does not exist"):
        read_point_cloud(tmp_path / "a.pcd")


def test_fields_that_are_needed(tmp_path: Path) -> None:
    fields = columns()
    write_pcd(tmp_path / "a.pcd", {"x": fields["x"], "y": fields["y"]}, 3, 4)
    with pytest.raises(FrameReadError, match="need the fields x, y and z; the file has x, y"):
        read_point_cloud(tmp_path / "a.pcd")
    write_pcd(tmp_path / "a.pcd", {**fields, "rgba": RGB[..., 0]}, 3, 4)
    with pytest.raises(FrameReadError, match=r"\(rgba\) must have 4 bytes; they have 1"):
        read_point_cloud(tmp_path / "a.pcd")


def test_an_unorganised_cloud_is_no_depth_image(tmp_path: Path) -> None:
    write_pcd(tmp_path / "a.pcd", columns(), 1, 12)
    with pytest.raises(FrameReadError, match="12 points are in no order of rows"):
        organized_depth(tmp_path / "a.pcd", CAMERA)


def test_without_the_extra_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    real = builtins.__import__

    def without(name: str, *args: object, **kwargs: object) -> object:
        if name == "pypcd4":
            raise ImportError("No module named 'pypcd4'")
        return real(name, *args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtraError, match=r"pip install 'sgbd\[pcd\]'"):
        read_point_cloud(tmp_path / "a.pcd")
