import pytest

from sgbd.reporting.score_titles import score_title


@pytest.mark.parametrize(
    ("name", "title"),
    [
        ("f75", "F@.75"),
        ("hm/overlap_f", "HM overlap F"),
        ("val/unaided/overlap_f", "val unaided overlap F"),
        ("edges/cut_f", "edges cut f"),
        ("edge_loss", "edge loss"),
    ],
)
def test_names_of_scores_for_people(name: str, title: str) -> None:
    assert score_title(name) == title
