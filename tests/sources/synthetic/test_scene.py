"""Rejected scenes are redrawn, and views have the expected content."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="needs the extra sgbd[synthetic]")
pytest.importorskip("embreex", reason="needs the extra sgbd[synthetic]")
pytest.importorskip("trimesh", reason="needs the extra sgbd[synthetic]")

from sgbd.sources.categories import TODZ_SEEN
from sgbd.sources.synthetic import scene
from sgbd.sources.synthetic.physics import UnstableSimulationError
from sgbd.sources.synthetic.variety import VARIETIES

SEEN = tuple(sorted(TODZ_SEEN))


def seed(number: int = 0) -> np.random.SeedSequence:
    return np.random.SeedSequence([7, number])


def test_a_blown_up_simulation_is_drawn_again_from_another_seed(monkeypatch: pytest.MonkeyPatch) -> None:
    settle, calls = scene.settle, []

    def explode_once(shapes: list, table: object, *rest: object) -> list:
        calls.append(([shape.category for shape in shapes], table))
        if len(calls) == 1:
            raise UnstableSimulationError("an object moves at 99 m/s")
        return settle(shapes, table, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(scene, "settle", explode_once)
    arrangement = scene.arrange(SEEN, (2, 4), seed())
    assert arrangement.attempt >= 1
    assert calls[0][1].size != calls[1][1].size  # type: ignore[attr-defined]
    assert arrangement.table.size == calls[-1][1].size  # type: ignore[attr-defined]


def test_too_few_objects_on_the_table_are_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    settle, calls = scene.settle, []

    def lose_all_once(shapes: list, table: object, *rest: object) -> list:
        calls.append(table)
        return [None] * len(shapes) if len(calls) == 1 else settle(shapes, table, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(scene, "settle", lose_all_once)
    assert len(scene.arrange(SEEN, (2, 3), seed()).shapes) >= 2
    assert len(calls) >= 2


def test_a_recipe_that_never_works_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def explode(*_: object) -> list:
        raise UnstableSimulationError("a position or a speed is not finite")

    monkeypatch.setattr(scene, "settle", explode)
    with pytest.raises(scene.SceneError, match="2 to 3 objects came to rest in 50 draws; .*not finite"):
        scene.arrange(SEEN, (2, 3), seed())


def test_the_number_of_objects_lies_in_the_range() -> None:
    for number in range(3):
        arrangement = scene.arrange(SEEN, (3, 5), seed(number))
        assert 3 <= len(arrangement.shapes) <= 5
        assert {shape.category for shape in arrangement.shapes} <= TODZ_SEEN


@pytest.fixture(scope="module")
def arrangement() -> scene.Arrangement:
    return scene.arrange(SEEN, (4, 6), seed(1))


def test_pictures_show_the_objects_from_several_sides(arrangement: scene.Arrangement) -> None:
    views = scene.photograph(arrangement, 3, "clean", (160, 120), seed(1))
    assert len(views) == 3
    for view in views:
        assert view.rgb.shape == (120, 160, 3)
        assert view.depth.shape == view.segmentation.shape == (120, 160)
        assert view.segmentation.max() <= 1 + len(arrangement.shapes)
        assert len(np.unique(view.segmentation[view.segmentation > 1])) >= min(4, len(arrangement.shapes))
        assert (view.depth > 0).all()
        assert 25 < view.rgb.mean() < 225
        assert view.rgb.std() > 8
    places = np.stack([view.camera.position for view in views])
    assert np.linalg.norm(places[0] - places[1]) > 0.3


def test_depth_and_pose_agree(arrangement: scene.Arrangement) -> None:
    """Every back-projected table pixel lies on the table top, or below it on its sides or legs."""
    view = scene.photograph(arrangement, 1, "clean", (160, 120), seed(1))[0]
    rays = view.camera.rays()
    points = view.camera.position + rays * (view.depth[..., None] / 1000)
    table = points[view.segmentation == 1]
    assert table[:, 2].max() == pytest.approx(arrangement.table.height, abs=0.003)
    assert (np.abs(table[:, 2] - arrangement.table.height) < 0.003).mean() > 0.5
    for k, (shape, pose) in enumerate(zip(arrangement.shapes, arrangement.poses, strict=True)):
        pixels = points[view.segmentation == 2 + k]
        radius = max(np.linalg.norm(part.mesh.vertices, axis=1).max() for part in shape.parts)
        assert (np.linalg.norm(pixels - pose.position, axis=1) < radius + 0.003).all()


def test_the_structured_light_sensor_loses_some_depth_and_no_labels(arrangement: scene.Arrangement) -> None:
    clean, kinect = (scene.photograph(arrangement, 1, name, (160, 120), seed(1))[0] for name in ("clean", "kinect"))
    np.testing.assert_array_equal(clean.segmentation, kinect.segmentation)
    missing = (kinect.depth == 0).mean()
    assert 0.005 < missing < 0.6
    valid = kinect.depth > 0
    error = np.abs(kinect.depth.astype(float) - clean.depth)[valid]
    assert 0 < np.median(error) < 60


def test_the_same_seed_gives_the_same_pictures(arrangement: scene.Arrangement) -> None:
    first, again = (scene.photograph(arrangement, 1, "kinect", (80, 64), seed(2))[0] for _ in range(2))
    np.testing.assert_array_equal(first.rgb, again.rgb)
    np.testing.assert_array_equal(first.depth, again.depth)
    np.testing.assert_array_equal(first.segmentation, again.segmentation)


WIDE = VARIETIES["wide"]


@pytest.fixture(scope="module")
def wide_arrangements() -> list[scene.Arrangement]:
    return [scene.arrange(SEEN, (1, 25), seed(number), WIDE) for number in range(10)]


def test_wide_scenes_hold_seen_categories_and_packaging(wide_arrangements: list[scene.Arrangement]) -> None:
    names = [shape.category for arrangement in wide_arrangements for shape in arrangement.shapes]
    assert set(names) <= TODZ_SEEN | {"carton", "roll"}
    assert {"carton", "roll"} <= set(names)
    # 35 % of the objects are packaging, within three standard deviations.
    share = sum(name in ("carton", "roll") for name in names) / len(names)
    assert abs(share - 0.35) < 3 * (0.35 * 0.65 / len(names)) ** 0.5


def test_assorted_scenes_hold_made_up_things_too() -> None:
    rng = np.random.default_rng(0)
    names = [scene._random_shape(SEEN, VARIETIES["assorted"], rng).category for _ in range(300)]
    made_up = {"binder", "stand", "tool", "assembly", "tray"}
    assert made_up <= set(names) <= TODZ_SEEN | {"carton", "roll"} | made_up
    # Half of the three quarters that are not packaging are made up, within three standard deviations.
    share = sum(name in made_up for name in names) / len(names)
    assert abs(share - 0.375) < 3 * (0.375 * 0.625 / len(names)) ** 0.5


def test_cartons_replace_a_share_of_the_assemblies() -> None:
    kind = replace(VARIETIES["stacked"], packaging=0.0, sundries=1.0)
    rng = np.random.default_rng(0)
    names = [scene._random_shape(SEEN, kind, rng).category for _ in range(300)]
    assert set(names) == {"binder", "stand", "tool", "assembly", "tray", "carton"}
    # A fifth of all draws are assemblies, of which 40 % remain, within three standard deviations.
    for name, share in (("assembly", 0.08), ("carton", 0.12)):
        assert abs(names.count(name) / 300 - share) < 3 * (share * (1 - share) / 300) ** 0.5


@pytest.mark.parametrize(("repeated", "looks"), [(0.0, 12), (1.0, 1)])
def test_repeated_objects_look_like_an_earlier_one(repeated: float, looks: int) -> None:
    kind = replace(VARIETIES["tabletop"], repeated=repeated)
    shapes = scene.arrange(SEEN, (12, 12), seed(0), kind).shapes
    assert len({id(shape) for shape in shapes}) == looks


def test_wide_scenes_are_few_or_many_on_tables_and_floors(wide_arrangements: list[scene.Arrangement]) -> None:
    counts = [len(arrangement.shapes) for arrangement in wide_arrangements]
    assert min(counts) <= scene.FEW < max(counts)
    heights = [arrangement.table.height for arrangement in wide_arrangements]
    assert min(heights) < 0.03
    assert max(heights) > 0.5


def test_objects_of_wide_scenes_rest_on_their_support(wide_arrangements: list[scene.Arrangement]) -> None:
    for arrangement in wide_arrangements:
        lowest = []
        for shape, pose in zip(arrangement.shapes, arrangement.poses, strict=True):
            np.testing.assert_allclose(pose.turn @ pose.turn.T, np.eye(3), atol=1e-6)
            assert arrangement.table.holds(pose.position)
            points = np.concatenate([part.mesh.vertices for part in shape.parts]) @ pose.turn.T + pose.position
            lowest.append(points[:, 2].min() - arrangement.table.height)
        # Objects may sink in only as far as meshes extend beyond their solids, and at least one touches the support.
        assert min(lowest) > -0.03
        assert min(lowest) < 0.01


def test_the_same_seed_gives_the_same_wide_scene(wide_arrangements: list[scene.Arrangement]) -> None:
    first, again = wide_arrangements[2], scene.arrange(SEEN, (1, 25), seed(2), WIDE)
    assert [shape.category for shape in first.shapes] == [shape.category for shape in again.shapes]
    assert first.table.size == again.table.size
    for one, other in zip(first.poses, again.poses, strict=True):
        np.testing.assert_array_equal(one.position, other.position)
        np.testing.assert_array_equal(one.turn, other.turn)


def test_cameras_of_wide_scenes_have_the_focal_lengths_of_the_variety(
    wide_arrangements: list[scene.Arrangement],
) -> None:
    focal = set()
    for number, arrangement in enumerate(wide_arrangements[:3]):
        views = scene.photograph(arrangement, 2, "clean", (80, 64), seed(number), WIDE)
        for view in views:
            assert view.camera.intrinsics.fx == view.camera.intrinsics.fy
            assert 0.78 <= view.camera.intrinsics.fx / 80 <= 1.08
            assert (view.segmentation > 1).any()
        focal |= {view.camera.intrinsics.fx for view in views}
    assert len(focal) == 3


def test_a_varied_sensor_sees_the_same_scene_and_repeats_itself(arrangement: scene.Arrangement) -> None:
    clean = scene.photograph(arrangement, 3, "clean", (80, 64), seed(3))
    first, again = (scene.photograph(arrangement, 3, "varied", (80, 64), seed(3)) for _ in range(2))
    for exact, view, same in zip(clean, first, again, strict=True):
        assert (view.rgb.dtype, view.depth.dtype, view.segmentation.dtype) == (np.uint8, np.uint16, np.uint8)
        assert view.rgb.shape == (64, 80, 3)
        assert view.depth.shape == view.segmentation.shape == (64, 80)
        np.testing.assert_array_equal(view.segmentation, exact.segmentation)
        np.testing.assert_array_equal(view.rgb, same.rgb)
        np.testing.assert_array_equal(view.depth, same.depth)
        valid = view.depth > 0
        assert valid.mean() > 0.05
        error = np.abs(view.depth.astype(float) - exact.depth)[valid] / exact.depth[valid]
        assert np.median(error) < 0.1
    assert any((view.depth == 0).any() for view in first)
