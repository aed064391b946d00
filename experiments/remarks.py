"""Preserve hand-written remarks at the end of a page when the page is generated again."""

from __future__ import annotations

from pathlib import Path

LINE = "<!-- remarks -->"


def with_remarks(text: str, page: Path) -> str:
    """Return the new text of a page, followed by the remarks of the existing page.

    Args:
        text: The new text, ending with a line break.
        page: File of the page; it need not exist.
    """
    _, _, remarks = page.read_text().partition(LINE) if page.is_file() else ("", "", "")
    return "\n\n".join(part for part in (text.rstrip("\n"), LINE, remarks.strip()) if part) + "\n"
