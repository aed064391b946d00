"""Display names of scores: `hm/overlap_f` in files and configurations is "HM overlap F" in tables and figures."""

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
"""Display names that differ from the key with spaces for underscores."""


def score_title(name: str) -> str:
    """Return the display name of a score.

    Args:
        name: Key of a score, with or without its protocol, such as `hm/overlap_f` or `f75`.

    Returns:
        The display name, such as "HM overlap F" or "F@.75".
    """
    return " ".join(TITLES.get(part, part.replace("_", " ")) for part in name.split("/"))
