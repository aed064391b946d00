"""Augmented graphs: changes are consistent across features, and nothing else changes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch_geometric.data import Data
from torch_geometric.loader import DataLoader

from sgbd.augmentation import GraphAugmentation
from sgbd.features import EDGE_GROUPS, EDGE_NAMES, NODE_GROUPS, NODE_NAMES
from sgbd.frame import Frame, Intrinsics
from sgbd.graph import build_graph
from tests.graph_samples import grid_graph
from tests.label_maps import frames, label_maps

STILL = {"mirror": 0.0, "gain": 0.0, "brightness": 0.0, "gray": 0.0, "noise": 0.0}
COLORS = [NODE_NAMES.index(name) for name in ("red", "green", "blue")]
SPREADS = [NODE_NAMES.index(f"{name}_spread") for name in ("red", "green", "blue")]
DISTANCE, STEP = EDGE_NAMES.index("color_distance"), EDGE_NAMES.index("color_step")
SIDEWAYS = [NODE_NAMES.index(name) for name in ("normal_x", "scene_x", "plane_normal_x")]


def graph(seed: int = 0) -> Data:
    """Return a grid with all features; colours lie well inside their range and match the colour distances."""
    data = grid_graph(3, 4, len(NODE_NAMES), len(EDGE_NAMES), seed=seed)
    generator = torch.Generator().manual_seed(seed)
    data.x[:, COLORS] = 0.3 + 0.3 * torch.rand(12, 3, generator=generator)
    data.x[:, SPREADS] = 0.05 + 0.1 * torch.rand(12, 3, generator=generator)
    source, target = data.edge_index
    data.edge_attr[:, DISTANCE] = (data.x[source][:, COLORS] - data.x[target][:, COLORS]).norm(dim=1)
    return data


def batch_of(count: int) -> Data:
    return next(iter(DataLoader([graph(seed) for seed in range(count)], batch_size=count)))


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_without_strength_nothing_changes() -> None:
    batch = batch_of(2)
    same = GraphAugmentation(**STILL)(batch, generator())
    assert torch.equal(same.x, batch.x)
    torch.testing.assert_close(same.edge_attr, batch.edge_attr)


def test_the_mirror_turns_what_points_sideways_and_twice_gives_the_graph_back() -> None:
    data, mirror = graph(), GraphAugmentation(**{**STILL, "mirror": 1.0})
    once = mirror(data, generator())
    centroid = NODE_NAMES.index("centroid_x")
    assert torch.equal(once.x[:, SIDEWAYS], -data.x[:, SIDEWAYS])
    width = int(data.image_size[0, 1])
    torch.testing.assert_close(once.x[:, centroid], 1 - 1 / width - data.x[:, centroid])
    others = [k for k in range(len(NODE_NAMES)) if k not in (*SIDEWAYS, centroid)]
    assert torch.equal(once.x[:, others], data.x[:, others])
    torch.testing.assert_close(once.edge_attr, data.edge_attr)
    twice = mirror(once, generator())
    torch.testing.assert_close(twice.x, data.x)


@given(label_maps(), st.data())
def test_a_mirrored_graph_is_the_graph_of_the_mirrored_frame(
    label_map: npt.NDArray[np.int32], data: st.DataObject
) -> None:
    frame = data.draw(frames(label_map.shape))
    camera = Intrinsics(20.0, 24.0, 0.4 * frame.width, 0.6 * frame.height)
    turned_camera = Intrinsics(camera.fx, camera.fy, frame.width - 1 - camera.cx, camera.cy)
    plain = build_graph(Frame(frame.rgb, frame.depth, camera), label_map)
    turned = build_graph(Frame(frame.rgb[:, ::-1], frame.depth[:, ::-1], turned_camera), label_map[:, ::-1].copy())
    mirrored = GraphAugmentation(**{**STILL, "mirror": 1.0})(plain, generator())
    # Leave out superpixels whose normal is that of a single pixel, or undefined because the points are collinear.
    kept = [k for k, name in enumerate(NODE_NAMES) if "normal" not in name]
    torch.testing.assert_close(mirrored.x[:, kept], turned.x[:, kept], rtol=0, atol=1e-5)


def test_gain_and_brightness_change_mean_spread_and_distance_of_colors_together() -> None:
    data = graph()
    bright = GraphAugmentation(**{**STILL, "gain": 0.1, "brightness": 0.03})(data, generator())
    source, target = data.edge_index
    gain = bright.x[:, SPREADS] / data.x[:, SPREADS]
    torch.testing.assert_close(gain, gain[:1].expand_as(gain))
    assert len(set(gain[0].tolist())) == 3
    shift = bright.x[:, COLORS] - gain * data.x[:, COLORS]
    torch.testing.assert_close(shift, shift[:1, :1].expand_as(shift), rtol=0, atol=1e-6)
    assert abs(float(shift[0, 0])) > 1e-3
    distance = (bright.x[source][:, COLORS] - bright.x[target][:, COLORS]).norm(dim=1)
    torch.testing.assert_close(bright.edge_attr[:, DISTANCE], distance)
    torch.testing.assert_close(bright.edge_attr[:, STEP], gain[0].mean() * data.edge_attr[:, STEP])
    others = [k for k in range(len(EDGE_NAMES)) if k not in (DISTANCE, STEP)]
    assert torch.equal(bright.edge_attr[:, others], data.edge_attr[:, others])


def test_gray_graphs_have_gray_distances() -> None:
    data = graph()
    gray = GraphAugmentation(**{**STILL, "gray": 1.0})(data, generator())
    mean = data.x[:, COLORS].mean(1, keepdim=True)
    torch.testing.assert_close(gray.x[:, COLORS], mean.expand(-1, 3))
    source, target = data.edge_index
    torch.testing.assert_close(gray.edge_attr[:, DISTANCE], (mean[source] - mean[target]).abs()[:, 0] * 3**0.5)


def test_colors_stay_in_their_range() -> None:
    light = GraphAugmentation(**{**STILL, "gain": 3.0, "brightness": 1.0})
    for seed in range(5):
        changed = light(batch_of(3), generator(seed))
        colors = changed.x[:, [*COLORS, *SPREADS]]
        assert colors.min() >= 0
        assert colors.max() <= 1


def test_every_graph_of_a_batch_is_drawn_for_itself_and_changed_as_a_whole() -> None:
    batch = batch_of(40)
    changed = GraphAugmentation(**{**STILL, "mirror": 0.5})(batch, generator())
    turned = (changed.x[:, SIDEWAYS[0]] != batch.x[:, SIDEWAYS[0]]).view(40, 12)
    assert torch.equal(turned.all(1), turned.any(1))
    assert 8 < int(turned.all(1).sum()) < 32


def test_noise_is_a_share_of_each_columns_spread() -> None:
    batch = batch_of(60)
    noisy = GraphAugmentation(**{**STILL, "noise": 0.1})(batch, generator())
    for before, after in ((batch.x, noisy.x), (batch.edge_attr, noisy.edge_attr)):
        ratio = (after - before).std(0) / before.std(0)
        # Standard deviations of the estimate: 2.6 % from 720 nodes, less from more edges.
        torch.testing.assert_close(ratio, torch.full_like(ratio, 0.1), rtol=0.12, atol=0)


def test_the_generator_alone_decides() -> None:
    batch, augmentation = batch_of(3), GraphAugmentation()
    torch.manual_seed(0)
    first = augmentation(batch, generator(5))
    torch.manual_seed(1)
    again, other = augmentation(batch, generator(5)), augmentation(batch, generator(6))
    assert torch.equal(first.x, again.x)
    assert torch.equal(first.edge_attr, again.edge_attr)
    assert not torch.equal(first.x, other.x)


def test_labels_and_the_given_batch_stay_as_they_are() -> None:
    batch = batch_of(2)
    before = batch.clone()
    changed = GraphAugmentation()(batch, generator())
    for field in before.keys():  # noqa: SIM118 (Data is no mapping)
        if torch.is_tensor(before[field]):
            assert torch.equal(batch[field], before[field]), field
            if field not in ("x", "edge_attr"):
                assert torch.equal(changed[field], before[field]), field
    assert not torch.equal(changed.x, before.x)


@pytest.mark.parametrize(
    ("node", "edge"),
    [(["rgb"], []), (["normal", "rgb"], ["distance"]), (["depth", "xyz"], ["gradient"]), ([], ["distance"])],
)
def test_selected_groups_change_as_they_do_among_all(node: list[str], edge: list[str]) -> None:
    options = {**STILL, "mirror": 1.0, "gain": 0.1, "brightness": 0.03}
    data = graph()
    whole = GraphAugmentation(**options)(data, generator())
    # The order is the declared one, not that of the selection.
    nodes = [NODE_NAMES.index(name) for group in NODE_GROUPS if group in node for name in NODE_GROUPS[group]]
    edges = [EDGE_NAMES.index(name) for group in EDGE_GROUPS if group in edge for name in EDGE_GROUPS[group]]
    part = data.clone()
    part.x, part.edge_attr = data.x[:, nodes], data.edge_attr[:, edges]
    changed = GraphAugmentation(node, edge, **options)(part, generator())
    torch.testing.assert_close(changed.x, whole.x[:, nodes])
    if "distance" in edge and "rgb" not in node:
        # Without colour features, colour distances are scaled by the mean gain.
        ratio = changed.edge_attr[:, -1] / part.edge_attr[:, -1]
        torch.testing.assert_close(ratio, ratio[:1].expand_as(ratio))
        edges, changed.edge_attr = edges[:-1], changed.edge_attr[:, :-1]
    torch.testing.assert_close(changed.edge_attr, whole.edge_attr[:, edges])


def test_too_few_columns_for_the_groups_are_refused() -> None:
    data = graph()
    data.x = data.x[:, :9]
    with pytest.raises(ValueError, match=rf"x has 9 columns, the chosen groups have {len(NODE_NAMES)}.*features\.node"):
        GraphAugmentation()(data, generator())
    data = graph()
    data.edge_attr = data.edge_attr[:, :0]
    with pytest.raises(ValueError, match=rf"edge_attr has 0 columns, the chosen groups have {len(EDGE_NAMES)}"):
        GraphAugmentation()(data, generator())
    with pytest.raises(ValueError, match="unknown node feature group colour"):
        GraphAugmentation(["colour"])
    # All groups of a model with a node block; those that the message names do.
    with pytest.raises(ValueError, match=r"group dino; .*leave its group out: .*node_features=\[rgb,depth\]"):
        GraphAugmentation(["rgb", "depth", "dino"])


def test_a_builders_own_columns_get_noise_only() -> None:
    data, wide = graph(), graph()
    own = torch.randn(12, 2, generator=generator())
    wide.x = torch.cat([data.x, own], dim=1)
    options = {"mirror": 1.0, "gain": 0.1, "gray": 1.0}
    changed = GraphAugmentation(noise=0.0, **options)(wide, generator())
    assert torch.equal(changed.x[:, -2:], own)
    assert torch.equal(changed.x[:, :-2], GraphAugmentation(noise=0.0, **options)(data, generator()).x)
    assert not torch.equal(GraphAugmentation(noise=0.1)(wide, generator()).x[:, -2:], own)


@pytest.mark.parametrize(
    "option", [{"mirror": 1.1}, {"mirror": -0.1}, {"gray": 2.0}, {"gain": -1.0}, {"brightness": -1.0}, {"noise": -0.1}]
)
def test_impossible_numbers_are_refused(option: dict[str, float]) -> None:
    name, value = next(iter(option.items()))
    with pytest.raises(ValueError, match=f"{name}={value}"):
        GraphAugmentation(**option)


def test_a_graph_without_edges() -> None:
    data = graph()
    data.edge_index, data.edge_attr = torch.empty(2, 0, dtype=torch.int64), data.edge_attr[:0]
    changed = GraphAugmentation()(data, generator())
    assert changed.edge_attr.shape == (0, len(EDGE_NAMES))
    assert torch.isfinite(changed.x).all()
