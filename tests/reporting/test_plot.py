from pathlib import Path

import imageio.v3 as iio
import numpy as np

from sgbd.adjacency import border_pairs
from sgbd.reporting.plot import curves_figure, segmentation_figure
from sgbd.reporting.results import write_figure
from sgbd.segmentation import Segmentation
from sgbd.superpixels import Slic
from tests.scenes import scene


def test_a_segmentation_has_six_panels_with_all_edges(tmp_path: Path) -> None:
    frame = scene(0)
    superpixels = Slic(20, min_size=4)(frame)
    pairs = border_pairs(superpixels)
    segmentation = Segmentation(
        instances=np.maximum(frame.instances - 1, 0),  # type: ignore[operator]
        scores=np.ones(3, np.float32),
        objectness=np.ones(3, np.float32),
        superpixels=superpixels,
        edge_index=pairs,
        edge_probability=np.linspace(0, 1, pairs.shape[1]).astype(np.float32),
    )
    figure = segmentation_figure(frame, segmentation)
    titles = [axes.get_title() for axes in figure.axes]
    assert f"{superpixels.max() + 1} superpixels" in titles
    assert "predicted objects: 3" in titles
    assert "true objects: 3" in titles
    edges = figure.axes[titles.index(f"{pairs.shape[1]} edges")].collections[0]
    assert len(edges.get_paths()) == pairs.shape[1]
    picture = iio.imread(write_figure(figure, tmp_path / "pictures" / "a.png"))
    assert picture.shape[0] > 300
    assert picture.std() > 20


def test_losses_and_scores_have_panels_of_their_own() -> None:
    figure = curves_figure({"loss": [(1, 0.5), (2, 0.3)], "val/overlap_f": [(1, 0.6), (2, 0.8)], "val/f75": []})
    left, right = figure.axes
    assert [line.get_label() for line in left.get_lines()] == ["loss"]
    assert [line.get_label() for line in right.get_lines()] == ["val/overlap_f", "val/f75"]
    assert right.get_lines()[0].get_ydata().tolist() == [0.6, 0.8]  # type: ignore[union-attr]
