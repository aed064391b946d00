"""Feature columns that a graph builder appends to those of every graph.

A graph builder that adds columns to `x` or `edge_attr` names them in its attributes `node_columns` and `edge_columns`.
These columns belong to no feature group and cannot be deselected: they are always kept.
"""

from __future__ import annotations

from collections.abc import Sequence


def own_columns(graph: object) -> dict[str, list[str]]:
    """Return the names of a graph builder's own columns, for a recipe.

    Args:
        graph: The graph builder.

    Returns:
        `own_node_columns` and `own_edge_columns`; an empty dict for a builder without own columns.
    """
    names = {f"own_{kind}_columns": list(getattr(graph, f"{kind}_columns", ())) for kind in ("node", "edge")}
    return names if any(names.values()) else {}


def with_own_columns(chosen: Sequence[int], declared: int, width: int) -> list[int]:
    """Return the columns to keep: the selected columns and all own columns of the builder.

    Args:
        chosen: Columns of the selected feature groups.
        declared: Number of columns that every graph has; the builder's own columns follow.
        width: Number of all columns of this graph.
    """
    return [*chosen, *range(declared, width)]
