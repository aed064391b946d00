"""Disjoint sets (union-find), for compiled loops.

A set is a tree of its members. Each member has a parent; the root is its own parent and represents the set.
R. E. Tarjan, "Efficiency of a good but not linear set union algorithm", JACM 22(2), 1975, doi:10.1145/321879.321884.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from sgbd.machine.compiled import compiled


@compiled(inline="always")
def find_root(parents: NDArray[Any], member: Any) -> Any:
    """Find the representative of a member's set, and shorten the path to it for later calls.

    Args:
        parents: int [N], the parent of each member; changed.
        member: The member.
    """
    # Path halving: every member on the way is linked to its grandparent.
    while parents[member] != member:
        parents[member] = parents[parents[member]]
        member = parents[member]
    return member
