"""Texture colours at selected points."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sgbd.sources.synthetic.noise import cell_values, fractal_noise
from sgbd.sources.synthetic.textures import (
    Bands,
    Checks,
    Plain,
    Printed,
    Speckled,
    Stripes,
    Tiles,
    Wood,
    face_coordinates,
)

RED, GREEN, BLUE, WHITE = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]
UP = [0.0, 0.0, 1.0]


def color(texture: object, points: list[list[float]], normals: list[list[float]] | None = None) -> list[list[float]]:
    array = np.array(points, dtype=np.float32)
    directions = np.array(normals or [UP] * len(points), dtype=np.float32)
    result: npt.NDArray[np.float32] = texture(array, directions)  # type: ignore[operator]
    return result.tolist()


def rows(*values: list[float]) -> npt.NDArray[np.float32]:
    return np.array(values, dtype=np.float32)


def test_plain_without_grain_is_its_colour() -> None:
    assert color(Plain(rows(RED)[0], grain=0), [[0, 0, 0], [1, 2, 3]]) == [RED, RED]


def test_stripes_follow_each_other_along_their_direction() -> None:
    stripes = Stripes(rows(RED, GREEN, BLUE), rows([1, 0, 0])[0], period=0.3)
    assert color(stripes, [[0.05, 9, 9], [0.15, 0, 0], [0.25, 0, 0], [0.35, 0, 0], [-0.05, 0, 0]]) == [
        RED, GREEN, BLUE, RED, BLUE,
    ]  # fmt: skip


def test_stripes_without_direction_go_around_the_axis() -> None:
    stripes = Stripes(rows(RED, GREEN), None, period=np.pi)
    points = [[np.cos(a), np.sin(a), 5] for a in np.deg2rad([45, 135, 225, 315])]
    assert color(stripes, points) == [RED, GREEN, RED, GREEN]


def test_checks_alternate_on_the_face_that_is_seen() -> None:
    checks = Checks(rows(RED, GREEN), size=1.0)
    assert color(checks, [[0.5, 0.5, 0], [1.5, 0.5, 0], [1.5, 1.5, 0]]) == [RED, GREEN, RED]
    side = [[0.0, 1.0, 0.0]] * 2
    assert color(checks, [[0.5, 0, 0.5], [0.5, 0, 1.5]], side) == [RED, GREEN]


def test_woven_bands_mix_where_one_lies_over_the_ground() -> None:
    woven = Checks(rows(RED, GREEN), size=1.0, woven=True)
    assert color(woven, [[0.5, 0.5, 0], [1.5, 0.5, 0], [1.5, 1.5, 0]]) == [RED, [0.5, 0.5, 0], GREEN]


def test_bands_change_at_their_heights() -> None:
    bands = Bands((Plain(rows(RED)[0], 0), Plain(rows(GREEN)[0], 0)), (0.5,))
    assert color(bands, [[0, 0, 0.4], [0, 0, 0.6]]) == [RED, GREEN]


def test_tiles_have_joints_between_them() -> None:
    tiles = Tiles(rows(RED)[0], rows(BLUE)[0], (1.0, 1.0), joint=0.1, variety=0.0)
    joint, middle = color(tiles, [[1.0, 0.5, 0], [0.5, 0.5, 0]])
    assert joint == BLUE
    assert middle[0] > 0.8
    assert middle[2] == 0


def test_bricks_shift_every_other_row() -> None:
    bricks = Tiles(rows(RED)[0], rows(BLUE)[0], (1.0, 1.0), joint=0.1, offset=0.5)
    assert color(bricks, [[0.5, 1.5, 0]]) == [BLUE]


def test_a_printed_face_shows_its_picture_upright_from_outside() -> None:
    # Seen from the front, the image is red (top left), green (top right), blue (bottom left) and white (bottom right).
    image = np.array([[RED, GREEN], [BLUE, WHITE]], dtype=np.float32).repeat(8, axis=0).repeat(8, axis=1)
    base = Plain(np.zeros(3, dtype=np.float32), 0)
    # The direction to the right on each face, seen from outside.
    for face, axis, right in (("-y", 1, [1, 0, 0]), ("+y", 1, [-1, 0, 0]), ("+x", 0, [0, 1, 0]), ("-x", 0, [0, -1, 0])):
        printed = Printed(image, base, face, (-1, 0), (1, 2))
        normal = np.zeros(3)
        normal[axis] = -1 if face[0] == "-" else 1
        step = 0.5 * np.array(right)
        points = [(np.array([0, 0, z]) + side * step).tolist() for z in (1.5, 0.5) for side in (-1, 1)]
        assert color(printed, points, [normal.tolist()] * 4) == [RED, GREEN, BLUE, WHITE], face
        assert color(printed, points[:1], [(-normal).tolist()]) == [[0, 0, 0]], face


def test_a_label_goes_around_the_outside_only() -> None:
    image = np.full((4, 8, 3), RED, dtype=np.float32)
    label = Printed(image, Plain(rows(BLUE)[0], 0), "around", (-np.pi, 0), (np.pi, 1))
    outside, inside = [[1.0, 0.0, 0.0]], [[-1.0, 0.0, 0.0]]
    assert color(label, [[1, 0, 0.5]], outside) == [RED]
    assert color(label, [[1, 0, 0.5]], inside) == [BLUE]
    assert color(label, [[1, 0, 1.5]], outside) == [BLUE]
    assert color(label, [[1, 0, 0.5]], [UP]) == [BLUE]


def test_wood_has_grain_and_boards() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (400, 3)).astype(np.float32)
    up = np.tile(np.float32(UP), (400, 1))
    wood = Wood(rows([0.6, 0.4, 0.2])[0], board=0.1)(points, up)
    assert 0.03 < wood[:, 0].std() < 0.3
    # The hue of the wood is kept: all channels are shaded equally.
    np.testing.assert_allclose(wood[:, 1] / wood[:, 0], 0.4 / 0.6, rtol=1e-4)


def test_speckles_of_full_contrast_are_nearly_two_colours() -> None:
    points = np.random.default_rng(0).uniform(0, 1, (2000, 3)).astype(np.float32)
    speckled = Speckled(rows(RED, BLUE), (0.01, 0.01, 0.01), contrast=1.0)(points, np.zeros_like(points))
    pure = (speckled[:, 0] < 0.01) | (speckled[:, 0] > 0.99)
    assert pure.mean() > 0.3
    assert 0.3 < speckled[:, 0].mean() < 0.7


def test_noise_is_smooth_repeatable_and_fills_its_range() -> None:
    points = np.random.default_rng(0).uniform(-50, 50, (5000, 3)).astype(np.float32)
    first = fractal_noise(points, 3, seed=1)
    np.testing.assert_array_equal(first, fractal_noise(points, 3, seed=1))
    assert np.abs(first - fractal_noise(points, 3, seed=2)).mean() > 0.05
    assert 0 <= first.min() < 0.25
    assert 0.75 < first.max() <= 1
    assert abs(first.mean() - 0.5) < 0.02
    near = fractal_noise(points + np.float32(0.001), 3, seed=1)
    assert np.abs(near - first).max() < 0.05


def test_noise_on_a_lattice_point_of_one_octave_does_not_depend_on_its_neighbours() -> None:
    point = np.array([[3, 4, 5]], dtype=np.float32)
    shifted = point + np.array([[1e-6, 0, 0]], dtype=np.float32)
    assert abs(float(fractal_noise(point, 1)[0] - fractal_noise(shifted, 1)[0])) < 1e-4


def test_cells_have_their_own_values() -> None:
    i, j = np.mgrid[-8:8, -8:8]
    values = cell_values(i.ravel(), j.ravel(), seed=3)
    assert len(np.unique(values)) > 250
    assert values.min() >= 0
    assert values.max() < 1
    np.testing.assert_array_equal(values[:1], cell_values(np.array([-8]), np.array([-8]), seed=3))


def test_face_coordinates_take_the_axis_of_the_largest_normal() -> None:
    points = np.array([[1, 2, 3]] * 3, dtype=np.float32)
    normals = np.array([[1, 0.2, 0], [0, -1, 0.5], [0.1, 0, -0.9]], dtype=np.float32)
    assert face_coordinates(points, normals).tolist() == [[2, 3], [1, 3], [1, 2]]
