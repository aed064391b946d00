import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.machine.union_find import find_root


def test_the_way_to_the_root_is_halved() -> None:
    parents = np.array([0, 0, 1, 2, 3])
    assert find_root(parents, 4) == 0
    assert parents.tolist() == [0, 0, 0, 2, 2]


@given(unions=st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=20))
@settings(max_examples=50, deadline=None)
def test_members_of_one_set_have_one_root(unions: list[tuple[int, int]]) -> None:
    parents, sets = np.arange(10), [{member} for member in range(10)]
    for one, other in unions:
        parents[find_root(parents, one)] = find_root(parents, other)
        joined = sets[one] | sets[other]
        for member in joined:
            sets[member] = joined
    roots = [find_root(parents, member) for member in range(10)]
    for member in range(10):
        assert {other for other in range(10) if roots[other] == roots[member]} == sets[member]
