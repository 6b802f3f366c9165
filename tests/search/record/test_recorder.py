"""What is written down when, whatever happens."""

from collections.abc import ItemsView, Mapping, Sequence
from typing import cast

import numpy as np
import pytest

from vinefab.search.record import recorder as diary
from vinefab.search.record.recorder import Recorder
from vinefab.search.record.result import Generation, Progress
from vinefab.search.record.timing import Ledger, TimeSplit
from vinefab.search.settings import SearchSettings

SEARCH = SearchSettings(population=3, generations=10)


class Notebook:
    """Stands for the record."""

    def __init__(self) -> None:
        self.entries: list[tuple[list[int], object]] = []

    def add(
        self, generations: Sequence[Generation], state: Mapping[str, object], times: TimeSplit
    ) -> None:
        assert times.total_s >= 0.0
        self.entries.append(([g.number for g in generations], state["generation"]))

    @property
    def recorded(self) -> int:
        return sum(len(numbers) for numbers, _ in self.entries)


def generation(number: int, fitness: Sequence[float] = (0.1, 0.3, 0.2)) -> Generation:
    values = np.array(fitness)
    return Generation(
        number=number,
        x=np.zeros((3, 2)),
        fitness=values,
        composite=values,
        penalty=np.zeros(3),
        terms={},
        seconds=2.0,
    )


def interrupted(book: Recorder) -> None:
    """Write six generations down, the last of which is never finished."""
    history = list[Generation]()
    with book:
        for number in range(6):
            book.write()
            if number == 5:
                raise KeyboardInterrupt
            history.append(generation(number, (0.1, 1.0 / (number + 1), 0.0)))
            book.note(history, {"generation": number + 1})


def kept(pause_s: float, monkeypatch: pytest.MonkeyPatch) -> tuple[Notebook, list[Progress]]:
    """Return what is left of an interrupted run, and what was told of it."""
    monkeypatch.setattr(diary, "PAUSE_S", pause_s)
    notebook, told = Notebook(), list[Progress]()
    with pytest.raises(KeyboardInterrupt):
        interrupted(Recorder(notebook, told.append, SEARCH, Ledger(1)))
    return notebook, told


def test_slow_generations_are_recorded_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    notebook, _ = kept(0.0, monkeypatch)
    assert notebook.entries == [([number], number + 1) for number in range(5)]


def test_fast_generations_are_recorded_together_and_none_is_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    notebook, _ = kept(60.0, monkeypatch)
    assert [number for entry, _ in notebook.entries for number in entry] == list(range(5))
    assert len(notebook.entries) < 5
    assert all(state == numbers[-1] + 1 for numbers, state in notebook.entries)


def test_every_generation_is_told_of_with_the_run_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    _, told = kept(60.0, monkeypatch)
    assert [progress.generation for progress in told] == [1, 2, 3, 4, 5]
    assert {progress.best for progress in told} == {1.0}
    assert told[-1].elapsed_s == 10.0
    assert told[-1].left_s == 10.0
    assert told[-1].mean == pytest.approx((0.1 + 0.2) / 3)


def test_a_record_that_cannot_be_written_ends_the_run_with_its_own_error() -> None:
    class Full(Notebook):
        def add(self, *_: object) -> None:
            raise OSError("full")

    book = Recorder(Full(), None, SEARCH, Ledger(1))
    with pytest.raises(OSError, match="full"):
        interrupted(book)


@pytest.mark.parametrize("when", ["before it is done", "after it is done"])
def test_an_interrupt_while_recording_costs_nothing(
    when: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Interrupted(Notebook):
        def add(
            self, generations: Sequence[Generation], state: Mapping[str, object], times: TimeSplit
        ) -> None:
            is_third = len(self.entries) == 2 and not hits
            if not is_third or when == "after it is done":
                super().add(generations, state, times)
            if is_third:
                hits.append(1)
                raise KeyboardInterrupt

    monkeypatch.setattr(diary, "PAUSE_S", 0.0)
    hits: list[int] = []
    notebook = Interrupted()
    with pytest.raises(KeyboardInterrupt):
        interrupted(Recorder(notebook, None, SEARCH, Ledger(1)))
    assert notebook.entries == [([0], 1), ([1], 2), ([2], 3)]


def test_an_interrupt_while_noting_leaves_no_generation_with_the_state_before_it() -> None:
    class Slow(dict[str, object]):
        def items(self) -> ItemsView[str, object]:
            raise KeyboardInterrupt

    notebook, history = Notebook(), [generation(0), generation(1)]
    book = Recorder(notebook, None, SEARCH, Ledger(1))
    book.note(history[:1], {"generation": 1})
    with pytest.raises(KeyboardInterrupt), book:
        book.note(history, Slow(generation=2))
    assert notebook.entries == [([0], 1)]


def test_what_an_optimizer_does_to_its_state_later_is_not_recorded() -> None:
    entries: list[Mapping[str, object]] = []

    class Keeping(Notebook):
        def add(
            self, generations: Sequence[Generation], state: Mapping[str, object], times: TimeSplit
        ) -> None:
            super().add(generations, {"generation": 1}, times)
            entries.append(state)

    state: dict[str, object] = {"place": np.zeros(2), "numbers": [[1]]}
    with Recorder(Keeping(), None, SEARCH, Ledger(1)) as book:
        book.note([generation(0)], state)
        cast("np.ndarray", state["place"])[:] = 7.0
        cast("list[list[int]]", state["numbers"])[0].append(2)
    assert [(list(e["place"]), e["numbers"]) for e in entries] == [([0.0, 0.0], [[1]])]
