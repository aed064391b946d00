"""What people write about the numbers of a page, below a line of its own: it outlives the next run of the scripts."""

from __future__ import annotations

from pathlib import Path

LINE = "<!-- remarks -->"


def with_remarks(text: str, page: Path) -> str:
    """Return a page's new text with the remarks of the old one below it.

    Args:
        text: The new text, which ends in a line break.
        page: The file that it is for, which need not exist yet.
    """
    _, _, remarks = page.read_text().partition(LINE) if page.is_file() else ("", "", "")
    return "\n\n".join(part for part in (text.rstrip("\n"), LINE, remarks.strip()) if part) + "\n"
