"""Drop objects on a table with a rigid-body simulation until they are at rest.

E. Todorov, T. Erez, Y. Tassa, "MuJoCo: a physics engine for model-based control", IROS 2012,
doi:10.1109/IROS.2012.6386109.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from sgbd.sources.synthetic.log_uniform import log_uniform
from sgbd.sources.synthetic.shapes.part import Shape, Solid
from sgbd.sources.synthetic.table import Table
from sgbd.sources.synthetic.variety import VARIETIES, Variety

log = logging.getLogger(__name__)

Floats = npt.NDArray[np.float64]

TIME_STEP = 0.004
LONGEST = 2.6
"""Maximum simulated time, seconds; objects that still move then are discarded."""
RESTING_SPEED = 0.08
"""Speed in metres per second below which an object counts as at rest."""
WILDEST_SPEED = 15.0
"""Speed in metres per second above which the simulation is unstable: no fall in a room reaches half of it."""
AIR = 60.0
"""Density of the air, kg/m³; high drag makes objects sink and pile up instead of bouncing and scattering."""
DEEPEST = 0.012
"""Maximum penetration between objects at rest, metres."""


class UnstableSimulationError(RuntimeError):
    """The simulation diverged, and its result is unusable."""


@dataclass(frozen=True, eq=False)
class Pose:
    """Position and orientation of an object.

    Attributes:
        position: float64 [3], origin of the object in the room, metres.
        turn: float64 [3, 3], rotation from the object's frame to the room's.
    """

    position: Floats
    turn: Floats


@contextmanager
def _warnings_are_debugging_messages() -> Iterator[None]:
    """Log MuJoCo's warnings instead of writing them to a file in the working folder; `check_stability` handles them."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(log.debug)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


@_warnings_are_debugging_messages()
def settle(
    shapes: list[Shape], table: Table, rng: np.random.Generator, variety: Variety = VARIETIES["tabletop"]
) -> list[Pose | None]:
    """Drop objects on a table and simulate until they are at rest.

    Args:
        shapes: The objects.
        table: The table.
        rng: Random generator for positions and orientations.
        variety: How the objects are spread and stacked.

    Returns:
        The pose of each object; None if it fell off the table or still moves.

    Raises:
        UnstableSimulationError: If the simulation diverged.
    """
    starts = drop_poses(shapes, table, rng, variety)
    model = _model(shapes, starts, table)
    data = mujoco.MjData(model)
    count = len(shapes)
    for step in range(int(LONGEST / TIME_STEP)):
        mujoco.mj_step(model, data)
        if step % 25 == 24:
            check_stability(data, count)
            speed = _speeds(data, count)
            on_table = data.xpos[1:][:, 2] > table.height - 0.02
            if step > 100 and (speed[on_table] < 0.25 * RESTING_SPEED).all():
                break
    mujoco.mj_forward(model, data)
    check_stability(data, count)
    check_penetration(data, table)
    speed = _speeds(data, count)
    poses: list[Pose | None] = []
    for k in range(count):
        position, turn = data.xpos[k + 1].copy(), data.xmat[k + 1].reshape(3, 3).copy()
        rests = speed[k] < RESTING_SPEED and table.holds(position)
        poses.append(Pose(position, turn) if rests else None)
    return poses


def drop_poses(
    shapes: list[Shape], table: Table, rng: np.random.Generator, variety: Variety = VARIETIES["tabletop"]
) -> list[Pose]:
    """Draw start poses: close together, above the table and without overlap.

    Of several random positions, each object takes the lowest one above the bounding boxes of the objects placed before
    it. An object drawn to be stacked is placed upright on one of them; one drawn to be a neighbour, right beside one.
    """
    footprint = sum(float(np.prod(np.sort(shape.extents)[1:])) for shape in shapes)
    low, high = variety.spread
    spread = log_uniform(rng, low, high) if variety.log_spread else rng.uniform(low, high)
    reach = min(0.38 * min(table.size), 0.5 * np.sqrt(footprint) * spread)
    center = rng.uniform(-0.06, 0.06, 2) * np.asarray(table.size)
    halves: list[Floats] = []
    poses: list[Pose] = []
    for shape in shapes:
        turn, support, neighbor = _companion(shape, poses, variety, rng)
        half = np.abs(turn) @ (shape.extents / 2) + 0.006
        places = []
        for _ in range(1 if support is not None or neighbor is not None else 8):
            # Drawn even if it is not used, because existing frames depend on the order of all draws.
            angle, radius = rng.uniform(0, 2 * np.pi), reach * np.sqrt(rng.random())
            place = center + radius * np.array([np.cos(angle), np.sin(angle)])
            if support is not None:
                place = support.position[:2] + rng.normal(0, 0.015, 2)
            elif neighbor is not None:
                place = _beside(poses[neighbor], shapes[neighbor], shape, rng)
            below = [
                pose.position[2] + size[2]
                for k, (pose, size) in enumerate(zip(poses, halves, strict=True))
                if k != neighbor and (np.abs(pose.position[:2] - place) < (half + size)[:2]).all()
            ]
            places.append(np.array([*place, max([table.height, *below]) + half[2]]))
        halves.append(half)
        poses.append(Pose(min(places, key=lambda place: place[2]), turn))
    return poses


def _companion(
    shape: Shape, poses: Sequence[Pose], variety: Variety, rng: np.random.Generator
) -> tuple[Floats, Pose | None, int | None]:
    """Draw the orientation of an object, and whether it goes on or beside one that is already placed.

    Returns:
        Its rotation [3, 3]; the pose of the object to stack it on, or None; the index of the object that it goes right
        beside, or None.
    """
    turn = _orientation(shape, rng)
    if poses and variety.stacked > 0 and rng.random() < variety.stacked:
        yaw = rng.uniform(0, 2 * np.pi)
        support = poses[int(rng.integers(len(poses)))]
        if variety.aligned > 0 and rng.random() < variety.aligned:
            yaw = _heading(support.turn)
        return Rotation.from_euler("z", yaw).as_matrix(), support, None
    if poses and variety.beside > 0 and rng.random() < variety.beside:
        neighbor = int(rng.integers(len(poses)))
        return poses[neighbor].turn, None, neighbor
    return turn, None, None


def _heading(turn: Floats) -> float:
    """Return the direction of the most horizontal axis of a rotated object, radians."""
    axis = turn[:, np.argmin(np.abs(turn[2]))]
    return float(np.arctan2(axis[1], axis[0]))


def _beside(pose: Pose, there: Shape, shape: Shape, rng: np.random.Generator) -> Floats:
    """Draw a position [2] beside an object for another one with the same orientation, a few millimetres away."""
    side, along = rng.permutation(np.argsort(np.abs(pose.turn[2]))[:2])
    gap = (there.extents[side] + shape.extents[side]) / 2 + rng.uniform(0.001, 0.008)
    offset = rng.choice([-1, 1]) * gap * pose.turn[:, side] + rng.normal(0, 0.01) * pose.turn[:, along]
    return np.asarray(pose.position + offset)[:2]


def check_stability(data: mujoco.MjData, count: int) -> None:
    """Raise UnstableSimulationError for non-finite values, implausible positions or speeds, or solver warnings."""
    bad = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
    if any(data.warning[int(kind)].number for kind in bad):
        raise UnstableSimulationError("the solver met values that are not finite")
    if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
        raise UnstableSimulationError("a position or a speed is not finite")
    fastest = float(_speeds(data, count).max(initial=0.0))
    if fastest > WILDEST_SPEED:
        raise UnstableSimulationError(f"an object moves at {fastest:.0f} m/s")
    farthest = float(np.abs(data.xpos).max(initial=0.0))
    if farthest > 20.0:
        raise UnstableSimulationError(f"an object is {farthest:.0f} m away")


def check_penetration(data: mujoco.MjData, table: Table) -> None:
    """Raise UnstableSimulationError if objects on the table penetrate each other or the table too deeply."""
    if data.ncon == 0:
        return
    contact = data.contact
    above = contact.pos[:, 2] > table.height - 0.05
    deepest = -float(contact.dist[above].min(initial=0.0))
    if deepest > DEEPEST:
        raise UnstableSimulationError(f"an object is {1000 * deepest:.0f} mm inside another")


def _speeds(data: mujoco.MjData, count: int) -> Floats:
    return np.linalg.norm(data.qvel.reshape(count, 6)[:, :3], axis=1)


def _orientation(shape: Shape, rng: np.random.Generator) -> Floats:
    yaw = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
    if rng.random() < shape.upright:
        return yaw.as_matrix()
    if rng.random() < 0.6:
        # On its side or upside down.
        side = Rotation.from_euler(
            "xyz", [(90, 0, 0), (-90, 0, 0), (0, 90, 0), (0, -90, 0), (180, 0, 0)][rng.integers(5)], degrees=True
        )
        return (yaw * side).as_matrix()
    return Rotation.random(rng=rng).as_matrix()


def _model(shapes: list[Shape], poses: list[Pose], table: Table) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.option.timestep = TIME_STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.iterations = 30
    spec.option.density = AIR
    world = spec.worldbody
    surface = {"friction": [0.8, 0.01, 0.002], "condim": 4, "solref": [0.012, 1.0]}
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], **surface)
    if table.round:
        kind, size = mujoco.mjtGeom.mjGEOM_CYLINDER, [table.size[0] / 2, 0.1, 0]
    else:
        kind, size = mujoco.mjtGeom.mjGEOM_BOX, [table.size[0] / 2, table.size[1] / 2, 0.1]
    world.add_geom(type=kind, size=size, pos=[0, 0, table.height - 0.1], **surface)
    for k, (shape, pose) in enumerate(zip(shapes, poses, strict=True)):
        body = world.add_body(name=f"object{k}", pos=pose.position, quat=_quaternion(pose.turn))
        body.add_freejoint()
        for j, solid in enumerate(shape.solids):
            _add_solid(spec, body, solid, f"hull{k}_{j}", surface)
    return spec.compile()


def _add_solid(spec: mujoco.MjSpec, body: mujoco.MjsBody, solid: Solid, name: str, surface: dict[str, object]) -> None:
    density = 300.0
    if solid.kind == "hull":
        # Round, because coordinates that differ only by rounding errors would create sliver faces.
        spec.add_mesh(
            name=name, uservert=np.round(solid.size, 6).ravel(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        )
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, density=density, **surface)
        return
    kinds = {"box": mujoco.mjtGeom.mjGEOM_BOX, "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER}
    size = np.zeros(3)
    size[: len(solid.size)] = solid.size
    body.add_geom(
        type=kinds[solid.kind], size=size, pos=solid.center, quat=_quaternion(solid.turn), density=density, **surface
    )


def _quaternion(turn: Floats) -> Floats:
    """Convert a rotation matrix to a quaternion (w, x, y, z)."""
    return np.roll(Rotation.from_matrix(turn).as_quat(), 1)
