"""Work units of a caller, with and without helper threads."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from vinefab.search.evaluator import Executor, WorkUnit


@pytest.fixture
def helper():
    with ThreadPoolExecutor(1) as pool:
        yield pool


def test_helpers_work_while_the_caller_does_something_else(helper):
    began, go_on = threading.Event(), threading.Event()

    def slow():
        began.set()
        assert go_on.wait(10.0)
        return threading.get_ident()

    units = [WorkUnit(slow), *(WorkUnit(threading.get_ident) for _ in range(5))]
    finish = Executor(helper, 2).begin(units)
    assert began.wait(10.0)
    # The caller does the rest; only then the helper may end.
    threading.Timer(0.05, go_on.set).start()
    finish()
    assert units[0].result != threading.get_ident()
    assert {unit.result for unit in units[1:]} == {threading.get_ident()}


def test_a_serial_executor_works_in_order_when_finished():
    done: list[int] = []
    finish = Executor().begin([WorkUnit(lambda k=k: done.append(k)) for k in range(4)])
    assert done == []
    finish()
    assert done == [0, 1, 2, 3]


def test_an_executor_of_one_needs_no_helper(helper):
    units = [WorkUnit(threading.get_ident) for _ in range(3)]
    Executor(helper, 1).begin(units)()
    assert {unit.result for unit in units} == {threading.get_ident()}


@pytest.mark.parametrize("place", [0, 3])
def test_an_error_is_raised_and_stops_the_rest(helper, place):
    """In the helper's unit, which is the first, and in another one."""
    started, hold = threading.Event(), threading.Event()

    def first():
        started.set()
        assert hold.wait(10.0)
        fail(0)

    def fail(number):
        done.append(number)
        if number == place:
            raise KeyError(number)

    done: list[int] = []
    work = [first, *(lambda k=k: fail(k) for k in range(1, 1000))]
    finish = Executor(helper, 2).begin([WorkUnit(one) for one in work])
    assert started.wait(10.0)
    threading.Timer(0.05, hold.set).start()
    with pytest.raises(KeyError):
        finish()
    assert len(done) < 1000 or place == 0


def test_nothing_is_begun_after_a_stop(helper):
    started, hold = threading.Event(), threading.Event()

    def first():
        started.set()
        assert hold.wait(10.0)

    done: list[int] = []
    executor = Executor(helper, 2)
    finish = executor.begin(
        [WorkUnit(first), *(WorkUnit(lambda: done.append(1)) for _ in range(9))]
    )
    assert started.wait(10.0)
    executor.stop()
    hold.set()
    finish()
    assert done == []
