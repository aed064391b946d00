"""Sets that grow together (union-find), for compiled loops.

A set is a tree of its members: each knows its parent, and the root of the tree, its own parent, stands for the set.
R. E. Tarjan, "Efficiency of a good but not linear set union algorithm", JACM 22(2), 1975, doi:10.1145/321879.321884.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from sgbd.machine.compiled import compiled


@compiled(inline="always")
def find_root(parents: NDArray[Any], member: Any) -> Any:
    """Find what stands for the set of a member, and shorten the way there for the next time.

    Args:
        parents: int [N], the parent of each member; changed.
        member: Whose set is asked for.
    """
    while parents[member] != member:
        parents[member] = parents[parents[member]]
        member = parents[member]
    return member
