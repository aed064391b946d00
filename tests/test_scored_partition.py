import numpy as np
import pytest

from sgbd.evaluation import Evaluator
from sgbd.frame import IGNORE
from sgbd.graph import build_graph
from sgbd.partition import ConnectedComponents, GreedyMulticut
from sgbd.scored_partition import ScoredGraph
from sgbd.segmentation import Classification, ObjectRule, partition_graph
from sgbd.superpixels import Slic
from tests.scenes import scene


@pytest.fixture(scope="module")
def graph() -> ScoredGraph:
    frame = scene(3)
    frame.instances[:, :6] = IGNORE
    data = build_graph(frame, Slic(60, min_size=4)(frame))
    data.name = "scene3"
    rng = np.random.default_rng(0)
    edges = np.clip(0.6 * data.edge_label.numpy() + 0.2 + rng.normal(0, 0.2, data.edge_label.numel()), 0, 1)
    objectness = np.clip(0.5 * (data.node_instance.numpy() >= 2) + rng.uniform(0, 0.5, data.area.numel()), 0, 1)
    return ScoredGraph(data, Classification(edges.astype(np.float32), objectness.astype(np.float32)))


@pytest.mark.parametrize("partitioner", [ConnectedComponents(0.6), GreedyMulticut(0.4, "none"), GreedyMulticut(0.8)])
@pytest.mark.parametrize("rule", [ObjectRule(0, 0), ObjectRule(0.5, 20), ObjectRule(0.7, 0), ObjectRule(1, 10_000)])
def test_scores_are_those_of_an_evaluation(graph: ScoredGraph, partitioner, rule: ObjectRule) -> None:
    segments = partition_graph(graph.data, graph.classification, partitioner, rule)
    expected = Evaluator(partitioner, rule).score(graph.data, segments)
    found = graph.partition(partitioner)
    assert (found.segment == segments.segment).all()
    for scores, objects in ((expected.unaided, found.objects(rule)), (expected.all, found.objects(None))):
        assert found.overlap(objects) == (scores.overlap.f_measure, scores.overlap.detected_share)
        assert found.boundary_f(objects, *graph.maps()) == scores.boundary.f_measure


def test_a_partition_met_again_is_the_same_and_other_objects_in_it_have_other_scores(graph: ScoredGraph) -> None:
    found = graph.partition(ConnectedComponents(0.6))
    assert graph.partition(ConnectedComponents(0.6)) is found
    assert graph.partition(ConnectedComponents(0.99)) is not found
    everything, nothing = found.objects(ObjectRule(0, 0)), found.objects(ObjectRule(1, 10_000))
    assert len(everything) == len(found.table.segments)
    assert len(nothing) == 0
    maps = graph.maps()
    first = found.overlap(everything), found.boundary_f(everything, *maps)
    assert (found.overlap(nothing)[0], found.boundary_f(nothing, *maps)) == (0, 0)
    assert (found.overlap(everything), found.boundary_f(everything, *maps)) == first
    assert first[0][0] > 0
