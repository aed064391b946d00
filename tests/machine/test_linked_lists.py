import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sgbd.machine.linked_lists import LinkedLists, prepend, unlink


def members(lists: LinkedLists, number: int) -> list[int]:
    """Walk a list from its head, checking the backward link at every step."""
    found, before, item = [], -1, int(lists.head[number])
    while item >= 0:
        assert lists.preceding[item] == before
        found.append(item)
        before, item = item, int(lists.following[item])
    return found


def test_items_stand_in_front_of_those_that_came_earlier() -> None:
    lists = LinkedLists.empty(lists=2, items=5)
    for item in (3, 1, 4):
        prepend(lists, 1, item)
    assert members(lists, 0) == []
    assert members(lists, 1) == [4, 1, 3]


@given(moves=st.lists(st.tuples(st.integers(0, 5), st.integers(0, 2)), max_size=40))
@settings(max_examples=50, deadline=None)
def test_items_move_between_lists_as_between_lists_of_python(moves: list[tuple[int, int]]) -> None:
    lists, expected = LinkedLists.empty(lists=3, items=6), [[5, 4, 3, 2, 1, 0], [], []]
    home = np.zeros(6, np.int64)
    for item in range(6):
        prepend(lists, 0, item)
    for item, number in moves:
        unlink(lists, int(home[item]), item)
        expected[home[item]].remove(item)
        prepend(lists, number, item)
        expected[number].insert(0, item)
        home[item] = number
    assert [members(lists, number) for number in range(3)] == expected
