import pytest
from hypothesis import given
from hypothesis import strategies as st

from sgbd.sources.time_association import associate

# Multiples of a quarter give exact differences and ties.
TIMES = st.lists(st.integers(0, 40).map(lambda quarter: quarter / 4), max_size=12)


def pairs(first: list[float], second: list[float], tolerance: float) -> list[tuple[int, int]]:
    return list(zip(*(places.tolist() for places in associate(first, second, tolerance)), strict=True))


def test_each_is_the_nearest_of_the_other() -> None:
    # 0.11 is nearer to 0.12 than to 0.10, which then has no partner within the tolerance.
    assert pairs([0.10, 0.11, 5.0], [0.12, 5.03], 0.02) == [(1, 0)]
    assert pairs([0.10, 0.11, 5.0], [0.12, 5.03], 0.04) == [(1, 0), (2, 1)]


def test_pairs_are_in_the_order_of_time_whatever_that_of_the_lists() -> None:
    assert pairs([3.0, 1.0, 2.0], [2.0, 3.0, 1.0], 0.0) == [(1, 2), (2, 0), (0, 1)]


def test_twice_the_rate_uses_every_second() -> None:
    assert pairs([0, 1, 2, 3, 4], [0, 2, 4], 0.5) == [(0, 0), (2, 1), (4, 2)]


def test_nothing_has_no_partner() -> None:
    assert pairs([], [1.0], 1.0) == []
    assert pairs([1.0], [], 1.0) == []


@pytest.mark.parametrize("tolerance", [-0.1, float("nan")])
def test_a_tolerance_is_not_negative(tolerance: float) -> None:
    with pytest.raises(ValueError, match="0 or more, in seconds"):
        associate([0.0], [0.0], tolerance)


@given(TIMES, TIMES, st.integers(0, 8).map(lambda quarter: quarter / 4))
def test_as_looking_at_all_pairs_has_it(first: list[float], second: list[float], tolerance: float) -> None:
    def nearest(time: float, among: list[float]) -> int:
        return min(range(len(among)), key=lambda place: (abs(among[place] - time), among[place], place))

    expected = [
        (place, partner)
        for place in sorted(range(len(first)), key=lambda place: (first[place], place))
        if second
        and nearest(second[partner := nearest(first[place], second)], first) == place
        and abs(first[place] - second[partner]) <= tolerance
    ]
    assert pairs(first, second, tolerance) == expected
