"""Names of scores for people: `hm/overlap_f` of files and configurations is "HM overlap F" in tables and figures."""

from __future__ import annotations

TITLES = {
    "overlap_precision": "overlap P",
    "overlap_recall": "overlap R",
    "overlap_f": "overlap F",
    "overlap_f_measure": "overlap F",
    "f75": "F@.75",
    "overlap_detected_share": "F@.75",
    "boundary_precision": "boundary P",
    "boundary_recall": "boundary R",
    "boundary_f": "boundary F",
    "boundary_f_measure": "boundary F",
    "hm": "HM",
}
"""Names of protocols and scores that are not their own key with spaces."""


def score_title(name: str) -> str:
    """Return the name of a score for people.

    Args:
        name: A score, alone or behind its protocol, such as `f75` or `hm/overlap_f`.

    Returns:
        The name, such as "F@.75" or "HM overlap F".
    """
    return " ".join(TITLES.get(part, part.replace("_", " ")) for part in name.split("/"))
