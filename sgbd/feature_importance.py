"""python -m sgbd.feature_importance: which features a random forest uses to decide whether two superpixels merge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pandas as pd
import torch
from omegaconf import DictConfig
from torch_geometric.data import Data

from sgbd.batches import SupervisedGraphs, collate
from sgbd.evaluation import with_truth
from sgbd.graph import edge_positions
from sgbd.jobs.configuration import ConfigurationError, entry_point, output_folder
from sgbd.jobs.pipeline import open_graphs, prepare_splits
from sgbd.jobs.untrained import configured_block
from sgbd.machine.atomic_file import write_whole
from sgbd.machine.availability import NotAvailableError
from sgbd.reporting.results import write_figure
from sgbd.sampling import BalancedEdgeSampler

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from sklearn.ensemble import RandomForestClassifier

Values = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class PairTable:
    """Pairs of superpixels as rows of a table.

    Attributes:
        x: float32 [P, C], node features of both superpixels, then edge features.
        merge: bool [P], whether both superpixels belong to the same instance.
        columns: The columns of each feature in `x`: two for a node feature, one for an edge feature.
    """

    x: Values
    merge: npt.NDArray[np.bool_]
    columns: dict[str, list[int]]


def pair_table(
    graphs: Sequence[Data],
    pairs: int,
    merge_share: float,
    generator: torch.Generator,
    node_names: Sequence[str],
    edge_names: Sequence[str],
) -> PairTable:
    """Draw labelled pairs, the same number from each of a random subset of graphs.

    Args:
        graphs: Graphs with ground truth.
        pairs: Number of pairs. Four are drawn from each of pairs / 4 graphs; more per graph if there are fewer graphs.
        merge_share: Fraction of merges among the pairs.
        generator: Source of randomness.
        node_names: Names of the columns of `x`.
        edge_names: Names of the columns of `edge_attr`.

    Returns:
        The table.

    Raises:
        ConfigurationError: If there are too few labelled pairs, only merges, or only cuts.
    """
    each = max(4, -(-pairs // len(graphs)))
    order = torch.randperm(len(graphs), generator=generator)[: -(-pairs // each)].tolist()
    fields = SupervisedGraphs(graphs)
    drawn = BalancedEdgeSampler(each, merge_share)(collate([fields[index] for index in order]), generator)
    index, labels = drawn.edge_label_index, drawn.edge_label
    # Rows are ordered by graph. Drop surplus rows at random, so that not only the last graph loses pairs.
    kept = torch.randperm(index.shape[1], generator=generator)[:pairs]
    index, labels = index[:, kept], labels[kept]
    if len(labels) < pairs or labels.min() == labels.max():
        raise ConfigurationError(
            f"pairs={pairs} of both kinds cannot be drawn from {len(graphs)} graphs: got {int((labels == 1).sum())} "
            f"merges and {int((labels == 0).sum())} cuts. Ask for fewer, or for another merge_share."
        )
    parts = [drawn.x[index[0]], drawn.x[index[1]]]
    if edge_names:
        parts.append(drawn.edge_attr[edge_positions(drawn.edge_index, index, drawn.x.shape[0])])
    nodes = len(node_names)
    columns = {name: [place, nodes + place] for place, name in enumerate(node_names)}
    columns |= {name: [2 * nodes + place] for place, name in enumerate(edge_names)}
    return PairTable(torch.cat(parts, dim=1).numpy(), (labels == 1).numpy(), columns)


def forest_importance(
    train: PairTable, held_out: PairTable, trees: int, seed: int, shuffles: int = 10
) -> tuple[pd.DataFrame, float]:
    """Train a random forest and measure the importance of each feature.

    A node feature has two columns, one for each superpixel. Their impurity importances are added, and they are shuffled
    together. (scikit-learn's permutation importance shuffles single columns, so the column of the other superpixel
    would still carry the information.)

    Args:
        train: Pairs to train on.
        held_out: Pairs from other frames, on which features are shuffled.
        trees: Number of trees.
        seed: Seed of the forest and of the shuffles.
        shuffles: Number of times each feature is shuffled.

    Returns:
        One row per feature with `impurity` (mean decrease of Gini impurity; the values add up to 1) and `permutation`
        (mean loss of balanced accuracy on the held-out pairs when the feature is shuffled; see L. Breiman, "Random
        forests", Machine Learning 45, 2001, doi:10.1023/A:1010933404324); and the balanced accuracy on the held-out
        pairs.

    Raises:
        NotAvailableError: If scikit-learn is not installed.
    """
    try:
        from sklearn.ensemble import RandomForestClassifier
    except ImportError as error:
        raise NotAvailableError(
            f"feature importance needs scikit-learn, which cannot be imported ({error}). Install the extra: "
            "pip install 'sgbd[analysis]'"
        ) from error
    forest = RandomForestClassifier(trees, random_state=seed, class_weight="balanced").fit(train.x, train.merge)
    accuracy = _balanced_accuracy(forest, held_out.x, held_out.merge)
    rng = np.random.default_rng(seed)
    rows = {}
    for name, columns in train.columns.items():
        losses = []
        for _ in range(shuffles):
            shuffled = held_out.x.copy()
            shuffled[:, columns] = held_out.x[rng.permutation(len(shuffled))][:, columns]
            losses.append(accuracy - _balanced_accuracy(forest, shuffled, held_out.merge))
        rows[name] = {"impurity": forest.feature_importances_[columns].sum(), "permutation": float(np.mean(losses))}
    return pd.DataFrame.from_dict(rows, orient="index"), accuracy


def _balanced_accuracy(forest: RandomForestClassifier, x: Values, merge: npt.NDArray[np.bool_]) -> float:
    right = forest.predict(x) == merge
    return float((right[merge].mean() + right[~merge].mean()) / 2)


def summarize(runs: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Return mean and sample standard deviation over runs, sorted by descending permutation importance."""
    stacked = pd.concat(runs, keys=range(len(runs)), names=["run", "feature"])
    groups = stacked.groupby("feature", sort=False)
    deviations = groups.std().add_suffix(" std")
    return groups.mean().join(deviations).sort_values("permutation", ascending=False, kind="stable")


def importance_figure(summary: pd.DataFrame) -> Figure:
    """Draw both importances as bars, with the standard deviation over the runs.

    Args:
        summary: The table of `summarize`.

    Returns:
        A figure, made without pyplot.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 1.2 + 0.26 * len(summary)), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    titles = {"impurity": "decrease of impurity, share", "permutation": "loss of balanced accuracy when shuffled"}
    for axes, (kind, title) in zip(panels, titles.items(), strict=True):
        axes.barh(summary.index, summary[kind], xerr=summary[f"{kind} std"].fillna(0), color="#4477aa", capsize=2)
        axes.axvline(0, color="black", linewidth=0.8)
        axes.set_xlabel(title)
        axes.grid(axis="x", alpha=0.3)
    panels[0].invert_yaxis()
    return figure


@entry_point("feature_importance")
def main(config: DictConfig) -> None:
    """Prepare the graphs, train forests on pairs of the training frames, write the table and the figure."""
    features, block = config.features, configured_block(config)
    cache = prepare_splits(config, ("train", config.held_out), block)
    graphs = [
        with_truth(open_graphs(cache, split, features, block, in_memory=True), config.on_error)
        for split in ("train", config.held_out)
    ]
    runs, accuracies = [], []
    for run in range(config.runs):
        seed = config.seed + run
        generator = torch.Generator().manual_seed(seed)
        train, held_out = (
            pair_table(dataset, config.pairs, config.merge_share, generator, dataset.node_names, dataset.edge_names)
            for dataset in graphs
        )
        importance, accuracy = forest_importance(train, held_out, config.trees, seed)
        runs.append(importance)
        accuracies.append(accuracy)
    summary = summarize(runs)
    folder = output_folder()
    write_whole(folder / "feature_importance.csv", summary.to_csv().encode())
    write_figure(importance_figure(summary), folder / "feature_importance.png")
    # A single forest has no deviations.
    table = summary.dropna(axis="columns", how="all").map("{:.3f}".format).to_markdown(disable_numparse=True)
    text = f"{_circumstances(config, accuracies)}\n\n{table}"
    write_whole(folder / "feature_importance.md", f"{text}\n".encode())
    print(f"\n{text}\n\nTable and figure: {folder}")


def _circumstances(config: DictConfig, accuracies: Sequence[float]) -> str:
    """Say what the forests were trained on, and how accurate they are."""
    several = len(accuracies) > 1
    deviation = f" ± {100 * np.std(accuracies, ddof=1):.1f}" if several else ""
    trees = f"{config.trees} trees"
    forests = f"{config.runs} forests of {trees}, each on" if several else f"A forest of {trees} on"
    return (
        f"{forests} {config.pairs} pairs of other superpixels of the training frames; balanced accuracy on "
        f"{config.pairs} pairs of {config.held_out} frames {100 * np.mean(accuracies):.1f}{deviation} %."
        + (" Mean and sample standard deviation over the forests." if several else "")
    )


if __name__ == "__main__":
    main()
