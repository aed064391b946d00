import numpy as np
import pandas as pd
import pytest

from sgbd.comparison import Judged
from sgbd.comparison_results import best_median_worst, score_markdown, score_rows
from sgbd.evaluation import Evaluation


def judged(name: str, scores: dict[str, float], frames: list[float]) -> Judged:
    table = pd.DataFrame(
        {"overlap_f_measure": frames, "unaided_overlap_f_measure": frames[::-1]},
        pd.Index(list("abc")[: len(frames)], name="name"),
    )
    return Judged(name, "baseline", Evaluation(scores, table, pd.DataFrame()), [], lambda frame: frame, True)  # type: ignore[arg-type, return-value]


def test_scores_of_all_methods_are_in_one_table_with_gaps() -> None:
    rows = score_rows(
        [
            judged("one", {"hm/overlap_f": 0.5, "all/f75": 0.25}, [0.1, 0.2]),
            judged("two", {"all/f75": 1.0}, [0.1, 0.2, 0.3]),
        ]
    )
    assert rows.index.tolist() == ["one", "two"]
    assert rows["frames"].tolist() == [2, 3]
    assert np.isnan(rows.loc["two", "hm/overlap_f"])
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in score_markdown(rows).splitlines()]
    assert lines[0] == ["method", "frames", "HM F", "all F@.75"]
    assert lines[2:] == [["one", "2", "50.0", "25.0"], ["two", "3", "–", "100.0"]]


@pytest.mark.parametrize(
    ("names", "count", "chosen"),
    [
        ("abcdefg", 1, {"g": "best", "d": "median", "a": "worst"}),
        ("abcdefg", 2, {"g": "best", "f": "best", "d": "median", "c": "median", "b": "worst", "a": "worst"}),
        ("ab", 2, {"b": "best", "a": "best"}),
        ("abc", 1, {"c": "best", "b": "median", "a": "worst"}),
        ("a", 3, {"a": "best"}),
    ],
)
def test_best_median_and_worst_frames(names: str, count: int, chosen: dict[str, str]) -> None:
    found = best_median_worst(list(names), count)
    assert found == chosen
    assert list(found) == sorted(found, reverse=True), "the best first"
