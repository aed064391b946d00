import numpy as np
import pytest

from sgbd.baselines.color_depth_graph import ColorDepthGraph
from sgbd.frame import Frame

LABELS = np.repeat(np.arange(3, dtype=np.int32), 2)[None].repeat(2, 0)  # rows of 0 0 1 1 2 2
RGB = np.where(LABELS == 2, 255, 0)[..., None].repeat(3, -1).astype(np.uint8)
DEPTH = np.where(LABELS == 0, 1.0, 1.5).astype(np.float32)


def test_weights_are_colour_distance_plus_weighted_depth_step() -> None:
    graph = ColorDepthGraph(depth_weight=4)(Frame(RGB, DEPTH), LABELS)
    assert sorted(graph.edges) == [(0, 1), (1, 2)]
    # Black on black with a step of half a metre; black to white without a step.
    assert graph[0][1]["weight"] == pytest.approx(2)
    assert graph[1][2]["weight"] == pytest.approx(1, abs=1e-4)
    assert [graph.nodes[node]["pixels"] for node in range(3)] == [4, 4, 4]


def test_borders_without_depth_have_no_step() -> None:
    depth = DEPTH.copy()
    depth[:, 2:4] = 0
    graph = ColorDepthGraph(depth_weight=4)(Frame(RGB, depth), LABELS)
    assert graph[0][1]["weight"] == pytest.approx(0)
    assert graph[0][1]["known"] == 0


def test_a_negative_weight_is_refused() -> None:
    with pytest.raises(ValueError, match="depth_weight must not be negative; got -1"):
        ColorDepthGraph(-1)
