import pandas as pd

from sgbd.comparison import Judged
from sgbd.evaluation import Evaluation

FRAMES = pd.DataFrame(
    {"overlap_f_measure": [0.3, 0.1, 0.2], "unaided_overlap_f_measure": [0.2, 0.3, 0.1]},
    pd.Index(list("abc"), name="name"),
)


def judged(aided: bool) -> Judged:
    return Judged("one", "baseline", Evaluation({}, FRAMES, pd.DataFrame()), [], lambda frame: frame, aided)  # type: ignore[arg-type, return-value]


def test_frames_are_ranked_by_what_the_method_is_judged_by() -> None:
    assert judged(aided=True).ranking == ["b", "c", "a"]
    assert judged(aided=False).ranking == ["c", "a", "b"]


def test_help_of_the_truth_is_told() -> None:
    assert (judged(aided=True).title, judged(aided=False).title) == ("one (aided)", "one")
