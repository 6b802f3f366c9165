"""Writing down what happens in a search, and telling the user, while the search goes on."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import NamedTuple

import numpy as np

from vinefab.search.record.result import Generation, Progress
from vinefab.search.record.store import RunStore
from vinefab.search.record.timing import Ledger
from vinefab.search.settings import SearchSettings

PAUSE_S = 0.25
"""Generations that follow each other faster are recorded together: what a kill costs at most."""


class Recorder:
    """Records generations and tells of them, each while the next one is evaluated."""

    def __init__(
        self,
        store: RunStore | None,
        tell: Callable[[Progress], None] | None,
        search: SearchSettings,
        ledger: Ledger,
    ) -> None:
        self._store, self._tell, self._search, self._ledger = store, tell, search, ledger
        self._untold: Sequence[Generation] | None = None
        self._noted = _PendingGeneration((), {})
        self._written_s = -math.inf
        self._so_far = _RunningTotals(0, -math.inf, 0.0)

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Record what is not recorded yet, whatever happened."""
        if kind is KeyboardInterrupt and self._store is not None:
            # It may have come in the middle of recording, or just after it.
            self._noted = self._noted.after(self._store.recorded)
        self._write()
        if kind is None:
            self._tell_last()

    def note(self, history: Sequence[Generation], state: Mapping[str, object]) -> None:
        """Keep in mind what is to be recorded: the last generation, and the state after it."""
        # Copied, because an optimizer may go on working in what it hands out.
        copied = {
            name: value.copy() if isinstance(value, np.ndarray) else deepcopy(value)
            for name, value in state.items()
        }
        # In one step: an interrupt must not leave a generation with the state before it.
        self._noted = _PendingGeneration((*self._noted.generations, history[-1]), copied)
        self._untold = history

    def write(self) -> None:
        """Tell of the last generation, and record what is in mind unless that was just done."""
        if time.monotonic() - self._written_s >= PAUSE_S:
            self._write()
        self._tell_last()

    def _tell_last(self) -> None:
        history, self._untold = self._untold, None
        if history is not None and self._tell is not None:
            with self._ledger.spending("store"):
                self._so_far = self._so_far.after(history)
                self._tell(self._so_far.progress(history[-1], self._search))

    def _write(self) -> None:
        generations, state = self._noted
        if generations and self._store is not None:
            with self._ledger.spending("store"):
                self._store.add(generations, state, self._ledger.split())
        # Only now: whoever is interrupted above has it in mind still.
        self._noted = _PendingGeneration((), state)
        self._written_s = time.monotonic()


class _PendingGeneration(NamedTuple):
    """What is to be recorded."""

    generations: tuple[Generation, ...]  # those that are not recorded yet, in order
    state: Mapping[str, object]  # the optimizer's state after the last one

    def after(self, count: int) -> "_PendingGeneration":
        """Return the same without the first generations of the run."""
        return _PendingGeneration(
            tuple(g for g in self.generations if g.number >= count), self.state
        )


class _RunningTotals(NamedTuple):
    """What a run has come to so far."""

    generations: int  # how many were looked at
    best: float  # their best fitness
    elapsed_s: float  # how long they took

    def after(self, history: Sequence[Generation]) -> "_RunningTotals":
        """Return the same after more generations."""
        new = history[self.generations :]
        return _RunningTotals(
            len(history),
            max([self.best, *(generation.best for generation in new)]),
            self.elapsed_s + sum(generation.seconds for generation in new),
        )

    def progress(self, last: Generation, search: SearchSettings) -> Progress:
        """Return it for the user, with the last generation."""
        designs = last.composite[np.isfinite(last.composite)]
        return Progress(
            generation=self.generations,
            generations=search.generations,
            best=self.best,
            mean=float(designs.mean()) if len(designs) else 0.0,
            spread=float(designs.std()) if len(designs) else 0.0,
            fabricable_share=last.fabricable_share,
            elapsed_s=self.elapsed_s,
            left_s=self.elapsed_s / self.generations * (search.generations - self.generations),
        )
