"""Objects come to rest where expected, and diverging simulations are detected."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="needs the extra sgbd[synthetic]")
pytest.importorskip("trimesh", reason="needs the extra sgbd[synthetic]")

import mujoco
from scipy.spatial.transform import Rotation

from sgbd.sources.synthetic import colors, meshes, physics
from sgbd.sources.synthetic.shapes import Part, Shape
from sgbd.sources.synthetic.shapes.part import solid_box
from sgbd.sources.synthetic.table import Table, random_floor, random_table
from sgbd.sources.synthetic.textures import Plain
from sgbd.sources.synthetic.variety import Variety

GRAY = Plain(colors.rgb(0.5, 0.5, 0.5))


def cube(side: float = 0.1) -> Shape:
    mesh = meshes.box((side, side, side))
    return Shape("cube", (Part("cube", mesh, GRAY),), (solid_box((side, side, side)),), upright=1.0)


def table(is_round: bool = False) -> Table:
    return Table(is_round, (1.2, 1.2), 0.7, ())


def state(shapes: list[Shape]) -> tuple[mujoco.MjModel, mujoco.MjData]:
    starts = physics.drop_poses(shapes, table(), np.random.default_rng(0))
    model = physics._model(shapes, starts, table())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_a_cube_comes_to_rest_flat_on_the_table() -> None:
    (pose,) = physics.settle([cube(0.1)], table(), np.random.default_rng(0))
    assert pose is not None
    assert pose.position[2] == pytest.approx(0.75, abs=0.003)
    np.testing.assert_allclose(np.abs(pose.turn[2, 2]), 1, atol=0.01)
    np.testing.assert_allclose(pose.turn @ pose.turn.T, np.eye(3), atol=1e-6)


@pytest.mark.parametrize("is_round", [False, True])
def test_many_cubes_rest_on_the_table_or_on_each_other_and_not_in_the_air(is_round: bool) -> None:
    shapes = [cube(0.12) for _ in range(12)]
    poses = physics.settle(shapes, table(is_round), np.random.default_rng(3))
    kept = [pose for pose in poses if pose is not None]
    assert len(kept) >= 8
    for pose in kept:
        lowest = pose.position[2] + (np.abs(pose.turn) @ [0.06, 0.06, 0.06])[2] * -1
        others = [other for other in kept if other is not pose]
        touches = [np.linalg.norm(other.position - pose.position) < 0.12 * np.sqrt(3) for other in others]
        assert lowest < 0.705 or any(touches)
        assert lowest > 0.69


def test_the_same_seed_gives_the_same_poses() -> None:
    first, again = (physics.settle([cube(), cube(), cube()], table(), np.random.default_rng(5)) for _ in range(2))
    for one, other in zip(first, again, strict=True):
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one.position, other.position)
        np.testing.assert_array_equal(one.turn, other.turn)


def test_objects_start_above_the_table_and_apart() -> None:
    shapes = [cube(0.2) for _ in range(10)]
    for shape in shapes:
        assert shape.upright == 1.0
    poses = physics.drop_poses(shapes, table(), np.random.default_rng(1))
    for k, pose in enumerate(poses):
        assert pose.position[2] > 0.8
        for other in poses[:k]:
            # Their balls inside the cubes never overlap.
            assert np.linalg.norm(pose.position - other.position) > 0.2


def test_stacked_objects_start_upright_on_another() -> None:
    shapes = [cube(0.1) for _ in range(6)]
    poses = physics.drop_poses(shapes, table(), np.random.default_rng(4), Variety(stacked=1.0))
    np.testing.assert_allclose(poses[0].position[2], 0.756)
    for k, pose in enumerate(poses[1:], start=1):
        np.testing.assert_allclose(pose.turn[2], [0, 0, 1], atol=1e-12)
        aside = min(np.linalg.norm(pose.position[:2] - other.position[:2]) for other in poses[:k])
        assert aside < 0.06
    # Each object is above all objects below it, with the gaps of both bounding boxes.
    heights = sorted(pose.position[2] for pose in poses)
    np.testing.assert_allclose(heights, 0.756 + 0.112 * np.arange(6), atol=1e-9)


def test_aligned_objects_of_a_stack_are_parallel_to_the_one_below() -> None:
    shapes = [cube(0.1) for _ in range(6)]
    poses = physics.drop_poses(shapes, table(), np.random.default_rng(4), Variety(stacked=1.0, aligned=1.0))
    for pose in poses[1:]:
        # The axes of a cube are parallel if they agree up to order and sign.
        np.testing.assert_allclose(np.sort(np.abs(poses[0].turn.T @ pose.turn), axis=None)[6:], 1, atol=1e-12)


def test_the_heading_is_that_of_the_most_horizontal_axis() -> None:
    yaw = Rotation.from_euler("z", 0.3)
    assert physics._heading(yaw.as_matrix()) == pytest.approx(0.3)
    leaning = yaw * Rotation.from_euler("x", 0.2)
    assert physics._heading(leaning.as_matrix()) == pytest.approx(0.3)


def test_an_object_beside_another_is_parallel_to_it_and_a_few_millimeters_away() -> None:
    shapes = [cube(0.1), cube(0.06)]
    kind = Variety(beside=1.0)
    for number in range(20):
        first, second = physics.drop_poses(shapes, table(), np.random.default_rng(number), kind)
        np.testing.assert_array_equal(second.turn, first.turn)
        x, y, _ = first.turn.T @ (second.position - first.position)
        along, across = sorted((abs(x), abs(y)))
        assert 0.081 - 1e-9 <= across <= 0.088 + 1e-9
        assert along < 0.05
        assert second.position[2] == pytest.approx(0.7 + 0.03 + 0.006)


def test_a_row_of_cubes_comes_to_rest_on_the_table() -> None:
    poses = physics.settle([cube(0.1)] * 2, table(), np.random.default_rng(0), Variety(beside=1.0))
    for pose in poses:
        assert pose is not None
        assert pose.position[2] == pytest.approx(0.75, abs=0.004)


def test_a_stack_of_cubes_stands() -> None:
    poses = physics.settle([cube(0.1)] * 3, table(), np.random.default_rng(0), Variety(stacked=1.0))
    heights = sorted(pose.position[2] for pose in poses if pose is not None)
    np.testing.assert_allclose(heights, [0.75, 0.85, 0.95], atol=0.004)


def test_the_spread_is_that_of_the_variety() -> None:
    shapes = [cube(0.05) for _ in range(8)]

    def width(spread: float, log_spread: bool) -> float:
        kind = Variety(spread=(spread, spread), log_spread=log_spread)
        poses = physics.drop_poses(shapes, table(), np.random.default_rng(2), kind)
        places = np.stack([pose.position[:2] for pose in poses])
        return float(np.linalg.norm(places - places.mean(axis=0), axis=1).max())

    assert width(4.0, True) == pytest.approx(width(4.0, False))
    assert width(4.0, True) > 2 * width(0.5, True)


def test_what_falls_off_has_no_pose(monkeypatch: pytest.MonkeyPatch) -> None:
    beside = [physics.Pose(np.array([0.0, 0.0, 0.8]), np.eye(3)), physics.Pose(np.array([2.0, 0.0, 0.8]), np.eye(3))]
    monkeypatch.setattr(physics, "drop_poses", lambda *_: beside)
    on, off = physics.settle([cube(), cube()], table(), np.random.default_rng(0))
    assert on is not None
    assert off is None


def test_values_that_are_not_finite_are_noticed() -> None:
    _, data = state([cube()])
    physics.check_stability(data, 1)
    data.qvel[0] = np.nan
    with pytest.raises(physics.UnstableSimulationError, match="not finite"):
        physics.check_stability(data, 1)


def test_absurd_speeds_are_noticed() -> None:
    _, data = state([cube()])
    data.qvel[2] = 80.0
    with pytest.raises(physics.UnstableSimulationError, match="80 m/s"):
        physics.check_stability(data, 1)


def test_absurd_places_are_noticed() -> None:
    model, data = state([cube()])
    data.qpos[0] = 500.0
    mujoco.mj_kinematics(model, data)
    with pytest.raises(physics.UnstableSimulationError, match="500 m away"):
        physics.check_stability(data, 1)


def test_a_warning_of_the_solver_is_noticed() -> None:
    model, data = state([cube()])
    data.qvel[:] = 1e30
    with physics._warnings_are_debugging_messages():
        mujoco.mj_step(model, data)  # resets the state and counts a warning
    with pytest.raises(physics.UnstableSimulationError):
        physics.check_stability(data, 1)


def test_deep_penetration_is_noticed() -> None:
    model, data = state([cube(), cube()])
    data.qpos[:3] = [0, 0, 0.75]
    data.qpos[7:10] = [0, 0, 0.83]
    mujoco.mj_forward(model, data)
    with pytest.raises(physics.UnstableSimulationError, match="20 mm inside"):
        physics.check_penetration(data, table())


def test_touching_is_no_penetration() -> None:
    model, data = state([cube(), cube()])
    data.qpos[:3] = [0, 0, 0.7499]
    data.qpos[7:10] = [0, 0, 0.8498]
    mujoco.mj_forward(model, data)
    assert data.ncon > 0
    physics.check_penetration(data, table())


@pytest.mark.parametrize(
    ("position", "square", "disc"),
    [
        ([0, 0, 0.8], True, True),
        ([0.55, 0.55, 0.8], True, False),
        ([0.7, 0, 0.8], False, False),
        ([0, 0, 0.5], False, False),
    ],
)
def test_a_table_holds_what_is_above_its_top(position: list[float], square: bool, disc: bool) -> None:
    assert table(False).holds(np.array(position)) == square
    assert table(True).holds(np.array(position)) == disc


def test_random_tables_stand_on_the_floor_and_end_at_their_height() -> None:
    kinds = set()
    for seed in range(12):
        drawn = random_table(np.random.default_rng(seed))
        kinds.add(drawn.round)
        bounds = np.array([part.mesh.bounds for part in drawn.parts])
        assert bounds[:, 0, 2].min() == pytest.approx(0, abs=1e-6)
        assert bounds[:, 1, 2].max() == pytest.approx(drawn.height, abs=1e-6)
        np.testing.assert_allclose(drawn.parts[0].mesh.extents[:2], drawn.size, rtol=1e-3)
    assert kinds == {True, False}


def test_random_floors_are_thin_and_lie_on_the_ground() -> None:
    for seed in range(6):
        drawn = random_floor(np.random.default_rng(seed))
        bounds = np.array([part.mesh.bounds for part in drawn.parts])
        assert not drawn.round
        assert 0.005 <= drawn.height <= 0.02
        assert bounds[:, 0, 2].min() == pytest.approx(0, abs=1e-9)
        assert bounds[:, 1, 2].max() == pytest.approx(drawn.height, abs=1e-9)
        np.testing.assert_allclose(drawn.parts[0].mesh.extents[:2], drawn.size, rtol=1e-9)
        assert min(drawn.size) >= 2.2
