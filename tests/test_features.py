import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sgbd.features import (
    EDGE_NAMES,
    NODE_NAMES,
    Geometry,
    edge_columns,
    edge_features,
    node_columns,
    node_features,
    sums_of_pairs,
)
from sgbd.frame import Frame, Intrinsics
from sgbd.regions import VALID, Borders, region_and_border_sums
from tests import feature_oracle
from tests.label_maps import frames, label_maps


def _node(frame: Frame, label_map: npt.NDArray[np.int32]) -> dict[str, npt.NDArray[np.float32]]:
    regions, borders = region_and_border_sums(frame, label_map)
    features = node_features(frame, regions, Geometry(regions, borders, frame.camera))
    return dict(zip(NODE_NAMES, features.T, strict=True))


def _edge(frame: Frame, label_map: npt.NDArray[np.int32]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the features of the first edge in both directions."""
    regions, borders = region_and_border_sums(frame, label_map)
    both = edge_features(borders.pairs, borders, regions, Geometry(regions, borders, frame.camera))
    return tuple(dict(zip(EDGE_NAMES, features[0].tolist(), strict=True)) for features in both)  # type: ignore


def _ridge(towards_camera: bool) -> tuple[Frame, npt.NDArray[np.int32]]:
    """Return two planes that meet in a vertical edge in the middle, at 45 degrees to either side."""
    height, width = 40, 80
    camera = Intrinsics(400.0, 400.0, (width - 1) / 2, (height - 1) / 2)
    slope = (np.arange(width) - camera.cx) / camera.fx
    # z = 1 +- |x| with x = slope * z.
    sign = 1.0 if towards_camera else -1.0
    z = 1 / (1 - sign * np.abs(slope))
    depth = np.tile(z, (height, 1)).astype(np.float32)
    label_map = np.zeros((height, width), np.int32)
    label_map[:, width // 2 :] = 1
    return Frame(np.zeros((height, width, 3), np.uint8), depth, camera), label_map


def test_groups_select_columns_in_the_declared_order() -> None:
    assert node_columns(["normal", "rgb"]) == [0, 1, 2, 6, 7, 8]
    assert node_columns() == list(range(len(NODE_NAMES)))
    assert node_columns([]) == []
    assert edge_columns(["distance", "border"]) == [0, 9, 10]


def test_an_unknown_group_lists_the_choices() -> None:
    with pytest.raises(ValueError, match="unknown node feature group colour; choose from rgb, position"):
        node_columns(["rgb", "colour"])
    with pytest.raises(ValueError, match="unknown edge feature group rgb; choose from border"):
        edge_columns(["rgb"])


def test_paper_features_of_a_flat_frame() -> None:
    rgb = np.zeros((2, 4, 3), np.uint8)
    rgb[:, :2] = (255, 51, 0)
    rgb[1, 0] = (255, 0, 0)
    depth = np.array([[1, 1, 3, 3], [1, 1, 3, 0]], np.float32)
    label_map = np.array([[0, 0, 1, 1], [0, 0, 1, 1]], np.int32)
    x = _node(Frame(rgb, depth), label_map)
    assert x["red"].tolist() == [1, 0]
    assert x["green"][0] == pytest.approx(0.15)
    assert x["green_spread"][0] == pytest.approx(np.std([0.2, 0.2, 0.2, 0]))
    assert x["centroid_x"].tolist() == [0.5 / 4, 2.5 / 4]
    assert x["centroid_y"].tolist() == [0.25, 0.25]
    assert x["depth"].tolist() == [0, 1]
    assert x["missing_depth"].tolist() == [0, 0.25]
    assert x["log_area"] == pytest.approx(np.log([0.5, 0.5]))
    assert x["scene_z"] == pytest.approx([-1, 1])


def test_normal_at_the_centroid_of_a_slanted_plane() -> None:
    # z = 1 + x in metres: the paper's normal (-dz/dx, -dz/dy, 1) is (-1, 0, 1) / sqrt(2).
    camera = Intrinsics(500.0, 500.0, 20.0, 15.0)
    slope = (np.arange(41) - camera.cx) / camera.fx
    depth = np.tile(1 / (1 - slope), (31, 1)).astype(np.float32)
    frame = Frame(np.zeros((31, 41, 3), np.uint8), depth, camera)
    x = _node(frame, np.zeros((31, 41), np.int32))
    normal = [x[name][0] for name in ("normal_x", "normal_y", "normal_z")]
    assert normal == pytest.approx([-np.sqrt(0.5), 0, np.sqrt(0.5)], abs=1e-2)
    plane = [x[name][0] for name in ("plane_normal_x", "plane_normal_y", "plane_normal_z")]
    # The fitted plane's normal faces the camera.
    assert plane == pytest.approx([np.sqrt(0.5), 0, -np.sqrt(0.5)], abs=1e-3)
    assert x["roughness"][0] == pytest.approx(0, abs=1e-2)


def test_a_superpixel_without_depth_takes_its_neighbours_depth() -> None:
    depth = np.zeros((4, 6), np.float32)
    depth[:, :2] = 2.0
    depth[:, 4:] = 4.0
    label_map = np.repeat(np.array([[0, 0, 1, 1, 2, 2]], np.int32), 4, axis=0)
    x = _node(Frame(np.zeros((4, 6, 3), np.uint8), depth), label_map)
    assert x["depth"] == pytest.approx([0, 0.5, 1])
    assert x["missing_depth"].tolist() == [0, 1, 0]


def test_convexity_is_positive_on_a_ridge_and_negative_in_a_valley() -> None:
    ridge, _ = _edge(*_ridge(towards_camera=True))
    valley, _ = _edge(*_ridge(towards_camera=False))
    assert ridge["convexity"] == pytest.approx(np.sqrt(2), abs=0.01)
    assert valley["convexity"] == pytest.approx(-np.sqrt(2), abs=0.01)
    assert ridge["normal_agreement"] == pytest.approx(0, abs=0.01)
    # At a convex edge the other side lies behind the plane, at a concave edge in front of it.
    assert ridge["plane_distance"] < 0 < valley["plane_distance"]
    assert ridge["log_border_length"] == pytest.approx(np.log1p(40))


def test_steps_across_a_border() -> None:
    depth = np.array([[1.0, 1.1], [1.0, 1.0], [0.0, 1.0]], np.float32)
    rgb = np.zeros((3, 2, 3), np.uint8)
    rgb[:, 1] = (255, 0, 0)
    forward, backward = _edge(Frame(rgb, depth), np.array([[0, 1], [0, 1], [0, 1]], np.int32))
    assert forward["mean_depth_step"] == pytest.approx(np.log1p(0.05 / 0.005), rel=1e-5)
    assert forward["min_depth_step"] == 0
    assert forward["missing_depth_step"] == pytest.approx(1 / 3)
    assert forward["color_step"] == pytest.approx(1)
    assert forward["color_distance"] == pytest.approx(1)
    assert backward["mean_depth_step"] == forward["mean_depth_step"]


@given(label_maps(), st.data())
def test_features_are_finite_and_edges_the_same_both_ways(
    label_map: npt.NDArray[np.int32], data: st.DataObject
) -> None:
    frame = data.draw(frames(label_map.shape))
    regions, borders = region_and_border_sums(frame, label_map)
    geometry = Geometry(regions, borders, frame.camera)
    assert np.isfinite(node_features(frame, regions, geometry)).all()
    forward, backward = edge_features(borders.pairs, borders, regions, geometry)
    assert np.isfinite(forward).all()
    # The features of the reversed pairs equal those returned as backward features.
    reversed_borders = Borders(borders.pairs[::-1], borders.sums)
    again, _ = edge_features(borders.pairs[::-1], reversed_borders, regions, geometry)
    np.testing.assert_allclose(again, backward, atol=1e-5)


def test_pairs_without_a_border_have_zero_sums() -> None:
    borders = Borders(np.array([[0, 1], [1, 2]]), np.array([[3.0, 1, 2, 1, 0.5], [4.0, 0, 4, 2, 0.1]]))
    sums = sums_of_pairs(np.array([[0, 0, 1], [1, 2, 2]]), borders)
    assert sums.tolist() == [borders.sums[0].tolist(), [0] * 5, borders.sums[1].tolist()]


@given(label_maps(), st.data())
def test_features_equal_those_of_numpy(label_map: npt.NDArray[np.int32], data: st.DataObject) -> None:
    frame = data.draw(frames(label_map.shape))
    regions, borders = region_and_border_sums(frame, label_map)
    geometry = Geometry(regions, borders, frame.camera)
    expected = feature_oracle.node_features(frame, regions, geometry)
    np.testing.assert_allclose(node_features(frame, regions, geometry), expected, rtol=1e-5, atol=1e-6)
    compiled = edge_features(borders.pairs, borders, regions, geometry)
    for got, wanted in zip(
        compiled, feature_oracle.edge_features(borders.pairs, borders, regions, geometry), strict=True
    ):
        np.testing.assert_allclose(got, wanted, rtol=1e-5, atol=1e-6)


@given(label_maps(), st.data())
def test_planes_equal_those_of_lapack(label_map: npt.NDArray[np.int32], data: st.DataObject) -> None:
    frame = data.draw(frames(label_map.shape))
    regions, borders = region_and_border_sums(frame, label_map)
    geometry = Geometry(regions, borders, frame.camera)
    covariance = feature_oracle.covariances(regions)
    variances = np.linalg.eigvalsh(covariance)
    fitted = regions.sums[:, VALID] >= 3
    scale = np.maximum(variances[:, 2], 1e-9)
    np.testing.assert_allclose(np.linalg.norm(geometry.normal, axis=1), 1, atol=1e-12)
    assert ((geometry.normal * geometry.centroid).sum(1) <= 1e-12).all(), "normals face the camera"
    smallest = np.where(fitted, np.maximum(variances[:, 0], 0), 0)
    np.testing.assert_allclose(geometry.residual**2 / scale, smallest / scale, atol=1e-12)
    # If two variances are equal, any direction in their plane is correct: check that it is an eigenvector.
    along = np.einsum("nab,nb->na", covariance, geometry.normal) - variances[:, :1] * geometry.normal
    np.testing.assert_allclose((along / scale[:, None])[fitted], 0, atol=1e-9)
