"""Feature columns that a graph builder appends to those of every graph.

A builder that adds columns to `x` or `edge_attr` names them in its attributes `node_columns` and `edge_columns`. These
columns form no group that could be selected or left out: they always come with the builder.
"""

from __future__ import annotations

from collections.abc import Sequence


def own_columns(graph: object) -> dict[str, list[str]]:
    """Return the names of a builder's own columns, for a recipe.

    Args:
        graph: Frame and label map to graph.

    Returns:
        `own_node_columns` and `own_edge_columns`; nothing for a builder without any.
    """
    names = {f"own_{kind}_columns": list(getattr(graph, f"{kind}_columns", ())) for kind in ("node", "edge")}
    return names if any(names.values()) else {}


def with_own_columns(chosen: Sequence[int], declared: int, width: int) -> list[int]:
    """Return the columns to keep: those chosen among the declared ones, and all after these.

    Args:
        chosen: Columns of chosen groups.
        declared: Number of columns that every graph has.
        width: Number of columns that this graph has.
    """
    return [*chosen, *range(declared, width)]
