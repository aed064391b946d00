import json
from pathlib import Path

import pandas as pd

from sgbd.evaluation import Evaluation
from sgbd.reporting.results import example_frames, markdown, write_evaluation

EVALUATION = Evaluation(
    scores={"all/overlap_f": 0.5, "all/f75": 0.25, "hm/overlap_f": 0.125},
    frames=pd.DataFrame({"overlap_f_measure": [0.9, 0.1, 0.5, 0.7, 0.3]}, pd.Index(list("abcde"), name="name")),
    categories=pd.DataFrame(),
)


def test_the_table_shows_gaps_as_dashes() -> None:
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in markdown(EVALUATION).splitlines()]
    assert lines[0] == ["", "overlap F", "F@.75"]
    assert lines[2:] == [["hm", "12.5", "–"], ["all", "50.0", "25.0"]]


def test_examples_spread_from_the_worst_to_the_best() -> None:
    assert example_frames(EVALUATION, 3) == ["b", "c", "a"]
    assert example_frames(EVALUATION, 10) == ["b", "e", "c", "d", "a"]
    assert example_frames(EVALUATION, 0) == []


def test_files_of_an_evaluation(tmp_path: Path) -> None:
    write_evaluation(EVALUATION, tmp_path / "out")
    assert json.loads((tmp_path / "out/scores.json").read_text()) == EVALUATION.scores
    assert pd.read_csv(tmp_path / "out/frames.csv", index_col="name")["overlap_f_measure"].tolist() == [
        0.9,
        0.1,
        0.5,
        0.7,
        0.3,
    ]
    assert (tmp_path / "out/scores.md").read_text() == markdown(EVALUATION) + "\n"
    assert not (tmp_path / "out/categories.csv").exists()
