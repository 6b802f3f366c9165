"""Writing down what happens in a search, and telling the user, while the search goes on."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from vinefab.optimize.history import Generation, Progress
from vinefab.optimize.settings import SearchSettings
from vinefab.optimize.store import RunStore
from vinefab.optimize.timing import Ledger

PAUSE_S = 0.25
"""Generations that follow each other faster are recorded together: what a kill costs at most."""


class Diary:
    """Records generations and tells of them, each while the next one is evaluated.

    Parameters
    ----------
    store
        Where to record; None: nowhere.
    tell
        Called for every generation; None: nobody wants to know.
    search
        How long the run may be.
    ledger
        Where the time that it takes is counted.
    """

    def __init__(
        self,
        store: RunStore | None,
        tell: Callable[[Progress], None] | None,
        search: SearchSettings,
        ledger: Ledger,
    ) -> None:
        self._store, self._tell, self._search, self._ledger = store, tell, search, ledger
        self._untold: Sequence[Generation] | None = None
        self._unwritten = list[Generation]()
        self._state: Mapping[str, object] = {}
        self._written_s = -math.inf
        self._so_far = _SoFar(0, -math.inf, 0.0)

    def __enter__(self) -> "Diary":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Record what is not recorded yet, whatever happened."""
        self._write()
        if kind is None:
            self._tell_last()

    def note(self, history: Sequence[Generation], state: Mapping[str, object]) -> None:
        """Keep in mind what is to be recorded: the last generation, and the state after it."""
        self._unwritten.append(history[-1])
        self._state = state
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
        generations, self._unwritten = self._unwritten, []
        if generations and self._store is not None:
            with self._ledger.spending("store"):
                self._store.add(generations, self._state, self._ledger.split())
        self._written_s = time.monotonic()


class _SoFar(NamedTuple):
    """What a run has come to so far.

    Parameters
    ----------
    generations
        How many were looked at.
    best
        Their best fitness.
    elapsed_s
        How long they took.
    """

    generations: int
    best: float
    elapsed_s: float

    def after(self, history: Sequence[Generation]) -> "_SoFar":
        """Return the same after more generations."""
        new = history[self.generations :]
        return _SoFar(
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
