"""The report of a benchmark, as aligned Markdown tables and as JSON."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from sgbd.machine.atomic_file import write_whole

FORMAT_VERSION = 1

DECIMALS = 2


@dataclass
class Table:
    """One table of a report.

    Attributes:
        name: Key in the JSON file.
        title: Heading; says what was measured and on what.
        rows: Values by column; all rows have the same columns, None marks missing values.
    """

    name: str
    title: str
    rows: list[dict[str, Any]]

    def markdown(self) -> str:
        """Return the title and the aligned table, without empty columns."""
        table = pd.DataFrame(self.rows).dropna(axis="columns", how="all")
        cells = table.map(_cell)
        align = ["right" if pd.api.types.is_numeric_dtype(table[name]) else "left" for name in table]
        headers = [str(name).replace("_", " ") for name in table]
        return f"{self.title}\n\n" + cells.to_markdown(
            index=False, headers=headers, colalign=align, disable_numparse=True
        )


@dataclass
class Report:
    """All results of one benchmark.

    Attributes:
        environment: Machine and versions.
        settings: Configuration of the benchmark.
        notes: Remarks needed to interpret the numbers.
        tables: The results.
    """

    environment: dict[str, Any]
    settings: dict[str, Any]
    notes: list[str] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)

    def add(self, name: str, title: str, rows: list[dict[str, Any]]) -> Table:
        """Append a table and return it."""
        table = Table(name, title, rows)
        self.tables.append(table)
        return table

    def heading(self) -> str:
        """Return the lines that describe machine, versions and frames."""
        machine = self.environment
        versions = ", ".join(f"{package} {number}" for package, number in machine["versions"].items() if number)
        lines = [
            f"{machine['cpu']}, {machine['cores_used']} of {machine['cores']} cores, {machine['memory_gib']} GiB, "
            f"load {machine['load']}; torch with {machine['torch_threads']} thread(s)",
            f"{machine['system']}; Python {machine['python']}, {versions}",
            *self.notes,
        ]
        return "\n".join(lines)

    def markdown(self) -> str:
        """Return the whole report as Markdown."""
        return "\n\n".join([self.heading(), *(table.markdown() for table in self.tables)]) + "\n"

    def json(self) -> dict[str, Any]:
        """Return the whole report as JSON values."""
        return {
            "format": "sgbd benchmark",
            "format_version": FORMAT_VERSION,
            "environment": self.environment,
            "settings": self.settings,
            "notes": self.notes,
            "tables": {table.name: {"title": table.title, "rows": table.rows} for table in self.tables},
        }

    def write(self, json_path: Path, markdown_path: Path) -> None:
        """Write the report as JSON and as Markdown; existing files are replaced atomically."""
        for path, content in (
            (json_path, json.dumps(self.json(), indent=2, allow_nan=False) + "\n"),
            (markdown_path, self.markdown()),
        ):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, content.encode())


def _cell(value: Any) -> str:
    if value is None or (isinstance(value, float) and value != value):
        return ""
    if isinstance(value, float):
        return f"{value:.{DECIMALS}f}" if abs(value) < 1000 else f"{value:.0f}"
    return str(value)
