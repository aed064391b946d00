"""Depth, labels and light of scenes that can be calculated by hand."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("embreex", reason="needs the extra sgbd[synthetic]")
pytest.importorskip("trimesh", reason="needs the extra sgbd[synthetic]")

from sgbd.frame import Intrinsics
from sgbd.sources.synthetic import colors, meshes
from sgbd.sources.synthetic.render import Camera, Light, Rendering, Scene, _corner_normals
from sgbd.sources.synthetic.room import Placed
from sgbd.sources.synthetic.shapes import Part
from sgbd.sources.synthetic.textures import Plain

WIDTH, HEIGHT = 64, 48
WHITE = Plain(np.ones(3, dtype=np.float32), 0.0, gloss=0.0)
RED = Plain(colors.rgb(1, 0, 0), 0.0, gloss=0.0)
DARKNESS = np.zeros((2, 3), dtype=np.float32)
DAYLIGHT = np.ones((2, 3), dtype=np.float32)


def placed(mesh: object, texture: Plain = WHITE) -> Placed:
    return Placed(Part("thing", mesh, texture), np.eye(3), np.zeros(3))  # type: ignore[arg-type]


FLOOR = placed(meshes.box((10, 10, 1), (0, 0, -0.5)))
BLOCK = placed(meshes.box((0.4, 0.4, 0.5), (0, 0, 0.25)), RED)


def from_above(height: float = 2.0) -> Camera:
    """Return a camera that looks straight down: x to the right, the bottom of the image towards -y."""
    turn = np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1]], dtype=np.float64).T
    camera = Intrinsics(60.0, 60.0, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    return Camera(np.array([0, 0, height]), turn, camera, WIDTH, HEIGHT)


def lamp(place: tuple[float, float, float], radius: float = 0.0) -> Light:
    return Light(np.array(place), radius, np.ones(3, dtype=np.float32), float(np.linalg.norm(place)))


def render(scene: Scene, lights: list[Light], ambient: np.ndarray = DARKNESS) -> Rendering:
    return scene.render(from_above(), lights, ambient, np.random.default_rng(0))


def test_depth_is_along_the_optical_axis_and_exact() -> None:
    rendering = render(Scene([FLOOR, BLOCK], [1, 2]), [lamp((0, 0, 3))])
    assert set(np.unique(rendering.label)) == {1, 2}
    np.testing.assert_allclose(rendering.depth[rendering.label == 1], 2.0, atol=1e-5)
    np.testing.assert_allclose(rendering.depth[rendering.label == 2], 1.5, atol=1e-5)
    # Its top, 0.4 m wide at 1.5 m, covers 60 * 0.4 / 1.5 = 16 pixels a side.
    assert (rendering.label == 2).sum() == 16 * 16


def test_facing_is_one_where_the_ray_is_perpendicular_and_falls_off_with_its_angle() -> None:
    rendering = render(Scene([FLOOR], [1]), [lamp((0, 0, 3))])
    x = (np.arange(WIDTH) - (WIDTH - 1) / 2) / 60
    y = (np.arange(HEIGHT) - (HEIGHT - 1) / 2) / 60
    expected = 1 / np.sqrt(1 + x**2 + y[:, None] ** 2)
    np.testing.assert_allclose(rendering.facing, expected, atol=1e-5)


def test_diffuse_light_follows_cosine_and_distance() -> None:
    rendering = render(Scene([FLOOR], [1]), [lamp((0, 0, 3))])
    x = (np.arange(WIDTH) - (WIDTH - 1) / 2) / 30
    y = (np.arange(HEIGHT) - (HEIGHT - 1) / 2) / 30
    square = 9 + x**2 + y[:, None] ** 2
    np.testing.assert_allclose(rendering.color[..., 0], 9 / square * (3 / np.sqrt(square)), rtol=1e-3)


def test_a_block_throws_its_shadow_away_from_the_lamp() -> None:
    rendering = render(Scene([FLOOR, BLOCK], [1, 2]), [lamp((2.0, 0, 1.5))])
    floor = rendering.label == 1
    # Left of the block (x < -0.2) the lamp is hidden as far as 0.2 + 0.5 * 2.2 / 1.0 from the edge.
    left = floor[24, :20], rendering.color[24, :20, 0]
    right = floor[24, 44:], rendering.color[24, 44:, 0]
    assert left[1][left[0]].max() < 0.02
    assert right[1][right[0]].min() > 0.2


def test_a_large_lamp_has_a_soft_shadow() -> None:
    sharp = render(Scene([FLOOR, BLOCK], [1, 2]), [lamp((0.9, 0, 2.5))])
    soft = render(Scene([FLOOR, BLOCK], [1, 2]), [lamp((0.9, 0, 2.5), 0.8)])
    # Between light and dark, relative to an unshaded floor.
    bare = render(Scene([FLOOR], [1]), [lamp((0.9, 0, 2.5))])
    shares = [(r.color[..., 0] / bare.color[..., 0])[(r.label == 1) & (r.depth > 1.9)] for r in (sharp, soft)]
    between = [((share > 0.15) & (share < 0.85)).sum() for share in shares]
    assert between[1] > 1.5 * between[0]


def test_ambient_light_is_dimmed_beside_a_wall() -> None:
    wall = placed(meshes.box((1, 10, 2), (0.8, 0, 1)))
    rendering = render(Scene([FLOOR, wall], [1, 0]), [lamp((-50, 0, 0.001))], DAYLIGHT)
    row = rendering.color[24, :, 0]
    assert row[rendering.label[24] == 1][-1] < 0.75 * row[0]
    assert row[0] == pytest.approx(1, abs=0.02)


def test_surfaces_have_their_own_colours() -> None:
    rendering = render(Scene([FLOOR, BLOCK], [1, 2]), [lamp((0, 0, 3))], DAYLIGHT)
    block = rendering.color[rendering.label == 2]
    assert (block[:, 0] > 0.5).all()
    assert (block[:, 1:] < 0.01).all()


def test_nothing_there_is_depth_zero_and_black() -> None:
    rendering = render(Scene([BLOCK], [2]), [lamp((0, 0, 3))], DAYLIGHT)
    outside = rendering.label == 0
    assert outside.any()
    assert (rendering.depth[outside] == 0).all()
    assert (rendering.color[outside] == 0).all()


def test_a_camera_looks_at_its_target_with_the_sky_up() -> None:
    camera = Camera.looking_at(np.array([1.0, 0, 1]), np.zeros(3), 0.0, Intrinsics(60, 60, 32, 24), 65, 49)
    rays = camera.rays()
    np.testing.assert_allclose(rays[24, 32], np.array([-1, 0, -1]) / np.sqrt(2), atol=1e-6)
    assert rays[0, 32, 2] > rays[48, 32, 2]
    np.testing.assert_allclose(camera.turn @ camera.turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.turn) == pytest.approx(1)


def test_roll_turns_the_picture() -> None:
    place, target = np.array([1.0, 0, 1]), np.zeros(3)
    level, rolled = (
        Camera.looking_at(place, target, roll, Intrinsics(60, 60, 32, 24), 65, 49) for roll in (0.0, np.pi / 2)
    )
    np.testing.assert_allclose(rolled.turn[:, 0], level.turn[:, 1], atol=1e-12)
    np.testing.assert_allclose(rolled.turn[:, 2], level.turn[:, 2], atol=1e-12)


def test_a_preview_is_the_rendering_at_fewer_pixels() -> None:
    scene = Scene([FLOOR, BLOCK], [1, 2])
    full = render(scene, [lamp((0, 0, 3))])
    labels, depth = scene.preview(from_above(), 4)
    np.testing.assert_array_equal(labels, full.label[::4, ::4])
    np.testing.assert_allclose(depth, full.depth[::4, ::4], atol=1e-5)


def test_edges_of_a_box_stay_sharp_and_a_ball_is_smooth() -> None:
    box = meshes.box((1, 1, 1))
    normals = _corner_normals(box.vertices[box.faces], box.faces)
    np.testing.assert_allclose(normals, np.repeat(box.face_normals[:, None], 3, axis=1), atol=1e-9)
    ball = meshes.ellipsoid((1, 1, 1))
    normals = _corner_normals(ball.vertices[ball.faces], ball.faces)
    np.testing.assert_allclose(normals, ball.vertices[ball.faces], atol=0.02)
