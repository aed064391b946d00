from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("trimesh", reason="needs the extra sgbd[synthetic]")

from sgbd.sources.synthetic import meshes


def test_a_box_has_the_volume_of_its_lengths_and_lies_where_it_was_put() -> None:
    box = meshes.box((0.2, 0.3, 0.4), (1, 2, 3))
    assert box.is_watertight
    assert box.volume == pytest.approx(0.2 * 0.3 * 0.4)
    np.testing.assert_allclose(box.bounds, [[0.9, 1.85, 2.8], [1.1, 2.15, 3.2]])


def test_a_bevel_cuts_the_edges_but_not_the_faces() -> None:
    plain, cut = meshes.box((0.2, 0.3, 0.4)), meshes.box((0.2, 0.3, 0.4), bevel=0.02)
    assert cut.is_watertight
    np.testing.assert_allclose(cut.bounds, plain.bounds)
    assert 0.9 * plain.volume < cut.volume < plain.volume


def test_a_bevel_larger_than_the_box_is_cut_back() -> None:
    assert meshes.box((0.2, 0.3, 0.01), bevel=1.0).is_watertight


def test_a_block_is_the_hull_of_its_corners() -> None:
    corners = meshes.frustum((0.2, 0.3), (0.1, 0.2), 0.4, (0.05, 0), at=(1, 1, 1))
    block, hull = meshes.block(corners), meshes.hull(corners)
    assert block.is_watertight
    assert hull.is_watertight
    # Prismatoid: height / 6 * (bottom + 4 * middle + top).
    assert block.volume == pytest.approx(0.4 / 6 * (0.06 + 4 * 0.15 * 0.25 + 0.02))
    assert hull.volume == pytest.approx(block.volume)
    np.testing.assert_allclose(block.bounds, hull.bounds)


def test_a_hull_drops_inner_points() -> None:
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.1, 0.1, 0.1]]
    hull = meshes.hull(points)
    assert len(hull.vertices) == 4
    assert hull.volume == pytest.approx(1 / 6)


def test_a_turned_rectangle_is_a_prism_of_as_many_sides() -> None:
    sections = 12
    mesh = meshes.lathe([(0, 0), (0.5, 0), (0.5, 2), (0, 2)], sections)
    area = 0.5 * sections * 0.5**2 * np.sin(2 * np.pi / sections)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(2 * area)


def test_squash_scales_along_y() -> None:
    mesh = meshes.lathe([(0, 0), (0.5, 0), (0, 1)], 32, squash=0.5)
    np.testing.assert_allclose(mesh.extents, [1, 0.5, 1], atol=1e-9)


def test_a_ring_has_a_hole() -> None:
    ring = meshes.ring(0.5, 1.0, 0.2, sections=64)
    assert ring.is_watertight
    assert ring.euler_number == 0
    assert ring.volume == pytest.approx(0.2 * np.pi * (1 - 0.25), rel=0.01)


@pytest.mark.parametrize("axis", ["x", "-x", "y", "-y", "z", "-z"])
def test_axis_rotations_are_rotations_that_take_z_to_the_axis(axis: str) -> None:
    turn = meshes.axis_rotation(axis)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1)
    expected = np.zeros(3)
    expected["xyz".index(axis[-1])] = -1 if axis[0] == "-" else 1
    np.testing.assert_allclose(turn @ [0, 0, 1], expected)


@pytest.mark.parametrize(("axis", "start", "end"), [("x", 1, 2), ("y", 2, 0), ("z", 0, 1)])
def test_a_quarter_turn_takes_one_axis_to_the_next(axis: str, start: int, end: int) -> None:
    np.testing.assert_allclose(meshes.rotation(axis, np.pi / 2) @ np.eye(3)[start], np.eye(3)[end], atol=1e-12)


def test_a_tube_along_a_line_is_a_prism() -> None:
    tube = meshes.tube([[0, 0, 0], [0, 0, 0.5], [0, 0, 1]], 0.1, sections=6)
    assert tube.is_watertight
    assert tube.volume == pytest.approx(0.5 * 6 * 0.1**2 * np.sin(np.pi / 3))


@pytest.mark.parametrize("plane", ["xy", "xz", "yz"])
def test_a_tube_along_an_arc_is_closed_and_as_long_as_the_arc(plane: str) -> None:
    tube = meshes.tube(meshes.arc((0, 0, 0), (1, 1), 0, np.pi, plane, steps=40), 0.05, sections=16)
    assert tube.is_watertight
    assert tube.volume == pytest.approx(np.pi * np.pi * 0.05**2, rel=0.05)


def test_an_arc_starts_and_ends_where_it_is_told() -> None:
    points = meshes.arc((1, 2, 3), (0.5, 0.25), 0, np.pi / 2, "xz", 5)
    np.testing.assert_allclose(points[0], [1.5, 2, 3])
    np.testing.assert_allclose(points[-1], [1, 2, 3.25])


def test_a_cushion_is_thick_in_the_middle_and_thin_at_the_seam() -> None:
    mesh = meshes.cushion((0.4, 0.3, 0.1))
    assert mesh.is_watertight
    assert mesh.volume > 0
    np.testing.assert_allclose(mesh.extents, [0.4, 0.3, 0.1], rtol=1e-6)
    corner = np.abs(mesh.vertices[:, :2] - [0.2, 0.15]).sum(axis=1).argmin()
    assert abs(mesh.vertices[corner, 2]) < 0.005


def test_joined_meshes_keep_their_volumes() -> None:
    parts = [meshes.box((1, 1, 1)), meshes.box((1, 1, 2), (5, 0, 0))]
    assert meshes.joined(parts).volume == pytest.approx(3)
