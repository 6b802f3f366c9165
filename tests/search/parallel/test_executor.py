"""Pieces of work that somebody asks for and others help with."""

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from vinefab.search.parallel.executor import SerialExecutor, ThreadExecutor, WorkUnit


@pytest.fixture
def helper() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as pool:
        yield pool


def test_a_team_works_while_whoever_asked_does_something_else(helper: ThreadPoolExecutor) -> None:
    began, go_on = threading.Event(), threading.Event()

    def slow() -> int:
        began.set()
        assert go_on.wait(10.0)
        return threading.get_ident()

    pieces = [WorkUnit(slow), *(WorkUnit(threading.get_ident) for _ in range(5))]
    finish = ThreadExecutor(helper, 2).begin(pieces)
    assert began.wait(10.0)
    # Whoever asked does the rest; only then the helper may end.
    threading.Timer(0.05, go_on.set).start()
    finish()
    assert pieces[0].result != threading.get_ident()
    assert {piece.result for piece in pieces[1:]} == {threading.get_ident()}


def test_alone_means_in_order_and_when_it_is_wanted() -> None:
    done: list[int] = []
    finish = SerialExecutor().begin([WorkUnit(lambda k=k: done.append(k)) for k in range(4)])
    assert done == []
    finish()
    assert done == [0, 1, 2, 3]


def test_a_team_of_one_needs_no_helper(helper: ThreadPoolExecutor) -> None:
    pieces = [WorkUnit(threading.get_ident) for _ in range(3)]
    ThreadExecutor(helper, 1).begin(pieces)()
    assert {piece.result for piece in pieces} == {threading.get_ident()}


@pytest.mark.parametrize("place", [0, 3])
def test_what_goes_wrong_comes_back_and_ends_the_rest(
    helper: ThreadPoolExecutor, place: int
) -> None:
    """In the helper's piece, which is the first, and in another one."""
    started, hold = threading.Event(), threading.Event()

    def first() -> None:
        started.set()
        assert hold.wait(10.0)
        fail(0)

    def fail(number: int) -> None:
        done.append(number)
        if number == place:
            raise KeyError(number)

    done: list[int] = []
    work = [first, *(lambda k=k: fail(k) for k in range(1, 1000))]
    finish = ThreadExecutor(helper, 2).begin([WorkUnit(one) for one in work])
    assert started.wait(10.0)
    threading.Timer(0.05, hold.set).start()
    with pytest.raises(KeyError):
        finish()
    assert len(done) < 1000 or place == 0


def test_nothing_is_begun_after_a_stop(helper: ThreadPoolExecutor) -> None:
    started, hold = threading.Event(), threading.Event()

    def first() -> None:
        started.set()
        assert hold.wait(10.0)

    done: list[int] = []
    team = ThreadExecutor(helper, 2)
    finish = team.begin([WorkUnit(first), *(WorkUnit(lambda: done.append(1)) for _ in range(9))])
    assert started.wait(10.0)
    team.stop()
    hold.set()
    finish()
    assert done == []
