import numpy as np
import numpy.typing as npt
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch_geometric.data import Data

from sgbd.graph import build_graph
from sgbd.partition import ConnectedComponents
from sgbd.segmentation import Classification, ObjectRule, Segmentation, classify, paint, partition_graph
from tests.label_maps import frames, label_maps

# Four superpixels in a row; the borders between them are 10, 20 and 30 pixels long.
CHAIN = Data(
    x=torch.zeros(4, 1),
    area=torch.tensor([100, 300, 50, 550]),
    edge_label_index=torch.tensor([[0, 1, 2], [1, 2, 3]]),
    border_length=torch.tensor([10.0, 20.0, 30.0]),
)


def _probabilities(*edges: float, objectness: tuple[float, ...] | None = None) -> Classification:
    nodes = None if objectness is None else np.array(objectness, np.float32)
    return Classification(np.array(edges, np.float32), nodes)


def test_segments_of_a_chain() -> None:
    classification = _probabilities(0.9, 0.2, 0.6, objectness=(0.8, 0.4, 0.1, 0.2))
    segments = partition_graph(CHAIN, classification, ConnectedComponents(), ObjectRule())
    assert segments.segment.tolist() == [0, 0, 1, 1]
    assert segments.area.tolist() == [400, 600]
    assert segments.objectness == pytest.approx([(100 * 0.8 + 300 * 0.4) / 400, (50 * 0.1 + 550 * 0.2) / 600])
    # Inner border of 10 with 0.9, outer border of 20 with 1 - 0.2; then inner 30 with 0.6 and the same outer one.
    confidence = [(10 * 0.9 + 20 * 0.8) / 30, (30 * 0.6 + 20 * 0.8) / 50]
    assert segments.score == pytest.approx(segments.objectness * confidence)
    assert segments.is_object.tolist() == [True, False]


def test_the_rule_asks_for_objectness_and_area() -> None:
    classification = _probabilities(0.0, 0.0, 0.0, objectness=(0.8, 0.4, 0.9, 0.5))
    rule = ObjectRule(min_objectness=0.5, min_area=60)
    segments = partition_graph(CHAIN, classification, ConnectedComponents(), rule)
    assert segments.is_object.tolist() == [True, False, False, True]


def test_without_a_head_everything_is_an_object() -> None:
    segments = partition_graph(CHAIN, _probabilities(1.0, 1.0, 0.0), ConnectedComponents(), ObjectRule())
    assert segments.objectness.tolist() == [1, 1]
    assert segments.score.tolist() == [1, 1]
    assert segments.is_object.all()


def test_a_partitioner_that_leaves_superpixels_out_is_named() -> None:
    def first_two(*graph: object) -> npt.NDArray[np.int64]:
        return np.zeros(2, np.int64)

    with pytest.raises(ValueError, match=r"^function must give the segment of each of 4 superpixels, .*; got \[2\]$"):
        partition_graph(CHAIN, _probabilities(1.0, 1.0, 0.0), first_two, ObjectRule())


def test_one_superpixel_is_one_certain_segment() -> None:
    data = Data(
        x=torch.zeros(1, 1),
        area=torch.tensor([6]),
        edge_label_index=torch.empty(2, 0, dtype=torch.int64),
        border_length=torch.empty(0),
    )
    segments = partition_graph(data, _probabilities(), ConnectedComponents(), ObjectRule())
    assert segments.score.tolist() == [1]
    painted = paint(np.zeros((2, 3), np.int32), data, _probabilities(), segments)
    assert painted.instances.tolist() == [[1, 1, 1], [1, 1, 1]]


def test_painted_objects_are_numbered_by_score() -> None:
    classification = _probabilities(0.1, 0.1, 0.1, objectness=(0.6, 0.9, 0.2, 0.9))
    segments = partition_graph(CHAIN, classification, ConnectedComponents(), ObjectRule())
    superpixels = np.array([[0, 1, 2, 3]], np.int32)
    painted = paint(superpixels, CHAIN, classification, segments)
    # 1 and 3 have one score; 3 is larger. 2 is no object.
    assert painted.instances.tolist() == [[3, 2, 0, 1]]
    assert painted.scores == pytest.approx([0.81, 0.81, 0.54])
    assert painted.objectness == pytest.approx([0.9, 0.9, 0.6])
    assert painted.edge_index.tolist() == [[0, 1, 2], [1, 2, 3]]


@pytest.mark.parametrize("arguments", [{"min_objectness": 1.5}, {"min_objectness": -0.1}, {"min_area": -1}])
def test_impossible_rules_are_refused(arguments: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="min_objectness must lie in"):
        ObjectRule(**arguments)  # type: ignore[arg-type]


def test_classify_gives_probabilities_without_gradients() -> None:
    class Distance(torch.nn.Module):
        def forward(self, data: Data) -> torch.Tensor:
            i, j = data.edge_label_index
            return (data.x[i] - data.x[j]).squeeze(1)

    data = CHAIN.clone()
    data.x = torch.tensor([[0.0], [0.0], [-1.0], [2.0]], requires_grad=True)
    classification = classify(Distance(), None, data)
    assert classification.edge_probability == pytest.approx(1 / (1 + np.exp([0.0, -1.0, 3.0])))
    assert classification.objectness is None


@given(label_maps(), st.data())
def test_objects_cover_what_the_rule_keeps(label_map: npt.NDArray[np.int32], draw: st.DataObject) -> None:
    data = build_graph(draw.draw(frames(label_map.shape)), label_map)
    rng = np.random.default_rng(0)
    classification = _probabilities(
        *rng.random(data.edge_label_index.shape[1]), objectness=tuple(rng.random(len(data.area)))
    )
    segments = partition_graph(data, classification, ConnectedComponents(), ObjectRule(min_area=3))
    painted = paint(label_map, data, classification, segments)
    assert len(painted.scores) == segments.is_object.sum() == painted.instances.max(initial=0)
    assert (painted.scores[:-1] >= painted.scores[1:]).all()
    assert ((painted.instances > 0) == segments.is_object[segments.segment][label_map]).all()


def test_a_segmentation_is_shown_in_one_line() -> None:
    shown = Segmentation(
        instances=np.zeros((3, 4), np.int32),
        scores=np.zeros(2, np.float32),
        objectness=np.zeros(2, np.float32),
        superpixels=np.repeat(np.array([[0, 1, 2, 2]], np.int32), 3, axis=0),
        edge_index=np.array([[0, 1], [1, 2]]),
        edge_probability=np.zeros(2, np.float32),
    )
    assert repr(shown) == "Segmentation(2 objects, 4x3 pixels, 3 superpixels, 2 edges)"
