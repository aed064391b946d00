"""Producing one item ahead in a thread gives the same as a plain loop."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from sgbd.machine import one_ahead as module
from sgbd.machine.one_ahead import one_ahead


@pytest.fixture(params=[1, 2])
def processors(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(module, "thread_count", lambda: request.param)
    return int(request.param)


def counter(count: int, made: list[int]) -> Callable[[], int | None]:
    def make() -> int | None:
        made.append(len(made))
        return made[-1] if len(made) <= count else None

    return make


@pytest.mark.parametrize("count", [0, 1, 5])
def test_every_item_in_turn(count: int, processors: int) -> None:
    made: list[int] = []
    assert list(one_ahead(counter(count, made))) == list(range(count))
    assert len(made) == count + 1


def test_never_more_than_one_ahead(processors: int) -> None:
    made: list[int] = []
    for item in one_ahead(counter(6, made)):
        assert len(made) <= item + processors


def test_the_next_item_is_made_while_this_one_is_worked_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "thread_count", lambda: 2)
    second_made = threading.Event()
    made: list[int] = []

    def make() -> int | None:
        made.append(threading.get_ident())
        if len(made) == 2:
            second_made.set()
        return len(made) if len(made) < 3 else None

    items = one_ahead(make)
    assert next(items) == 1
    # A plain loop would not produce the item before it is requested.
    assert second_made.wait(timeout=30)
    assert list(items) == [2]
    assert len(set(made)) == 1
    assert made[0] != threading.get_ident()


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_comes_in_its_place(error: type[BaseException], processors: int) -> None:
    made: list[int] = []

    def make() -> int | None:
        made.append(0)
        if len(made) == 3:
            raise error("the third")
        return len(made)

    taken: list[int] = []
    with pytest.raises(error, match="the third"):
        taken.extend(one_ahead(make))
    assert taken == [1, 2]


def test_nothing_runs_on_when_the_caller_breaks_off(processors: int) -> None:
    before = threading.active_count()
    items = one_ahead(counter(5, []))
    assert next(items) == 0
    items.close()  # type: ignore[attr-defined]
    assert threading.active_count() == before
