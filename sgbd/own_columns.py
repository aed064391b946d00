"""Feature columns of a graph builder's own, after those that every graph has.

A builder that adds columns to `x` or `edge_attr` names them in its attributes `node_columns` and `edge_columns`. They
are no group to be chosen or left out: whoever takes the builder takes its columns.
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
