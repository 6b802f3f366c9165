"""How the time of a run is spent."""

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from typing import NamedTuple

from vinefab.core.plain_text import counted


class Work(NamedTuple):
    """Processor time that some evaluations took, s."""

    making_s: float = 0.0  # building designs and computing their penalties
    growth_s: float = 0.0  # planning and growing
    scoring_s: float = 0.0  # scoring final states

    @classmethod
    def total(cls, parts: Iterable["Work"]) -> "Work":
        """Return the sum of several parts."""
        return cls(*map(sum, zip(*parts, strict=True)))


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeSplit:
    """How the time of one session was spent, all in seconds."""

    workers: int = 1  # number of workers that evaluated points
    # parts of the session's time: loading compiled code, evaluating points, asking and telling the
    # optimizer, recording while no point is evaluated, the rest
    loading_s: float = 0.0
    evaluating_s: float = 0.0
    optimizer_s: float = 0.0
    store_s: float = 0.0
    other_s: float = 0.0
    beside_s: float = 0.0  # recording in parallel with evaluating; part of ``evaluating_s``
    # processor time of all workers together while evaluating, as in `Work`
    making_s: float = 0.0
    growth_s: float = 0.0
    scoring_s: float = 0.0
    processor_s: float = 0.0  # all processor time of this process

    @property
    def total_s(self) -> float:
        """Length of the session."""
        doing_s = self.evaluating_s + self.optimizer_s + self.store_s
        return self.loading_s + doing_s + self.other_s

    @property
    def shares(self) -> dict[str, float]:
        """Shares of the session's time, and of the workers' time while points were evaluated.

        ``busy`` is the processor time of growing and scoring over the time of all workers while
        points were evaluated; ``making`` is that of designs and their penalties. On a computer
        under other load, workers wait for processors and are less busy; ``useful`` is the share
        of growing and scoring in the processor time that this process got.
        """
        total_s = max(self.total_s, 1e-9)
        room_s = max(self.workers * self.evaluating_s, 1e-9)
        worked_s = self.making_s + self.growth_s + self.scoring_s
        return {
            "loading": self.loading_s / total_s,
            "evaluating": self.evaluating_s / total_s,
            "optimizer": self.optimizer_s / total_s,
            "store": self.store_s / total_s,
            "other": self.other_s / total_s,
            "beside": self.beside_s / total_s,
            "busy": (self.growth_s + self.scoring_s) / room_s,
            "growth": self.growth_s / room_s,
            "scoring": self.scoring_s / room_s,
            "making": self.making_s / room_s,
            "useful": (self.growth_s + self.scoring_s) / max(self.processor_s, worked_s, 1e-9),
        }

    @classmethod
    def from_plain(cls, values: dict[str, float]) -> "TimeSplit":
        """Return the split of `plain`; missing parts are 0."""
        known = {field.name for field in fields(cls)}
        return cls(**{key: value for key, value in values.items() if key in known})  # type: ignore[arg-type]

    @property
    def summary(self) -> str:
        """The split as one line for the user."""
        shares = {name: f"{100 * share:.0f} %" for name, share in self.shares.items()}
        workers = counted(self.workers, "worker")
        return (
            f"time: {self.total_s:.1f} s: loading compiled code {shares['loading']}, evaluating "
            f"{shares['evaluating']}, optimizer {shares['optimizer']}, recording {shares['store']} "
            f"(plus {shares['beside']} in parallel with evaluating); use of {workers} while "
            f"evaluating: growth {shares['growth']}, scoring {shares['scoring']}, penalties "
            f"{shares['making']}"
        )

    def plain(self) -> dict[str, float]:
        """Return the seconds by name."""
        return asdict(self)


class Ledger:
    """Adds up how time is spent while a session runs."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._began_s = time.perf_counter()
        self._process_s = time.process_time()
        self._spent_s = dict.fromkeys(
            ("loading_s", "evaluating_s", "optimizer_s", "store_s", "beside_s"), 0.0
        )
        self._is_evaluating = False
        self._work = Work()

    @property
    def worked_s(self) -> float:
        """Processor time of all workers so far."""
        return sum(self._work)

    @contextmanager
    def spending(self, part: str) -> Iterator[None]:
        """Count the time of a block as ``loading``, ``evaluating``, ``optimizer`` or ``store``.

        A block within evaluating counts as ``beside``, except loading: no point is evaluated
        before it.
        """
        beside, began_s = self._is_evaluating, time.perf_counter()
        self._is_evaluating = beside or part == "evaluating"
        try:
            yield
        finally:
            self._is_evaluating = beside
            spent_s = time.perf_counter() - began_s
            if beside and part == "loading":
                self._spent_s["evaluating_s"] -= spent_s
            elif beside:
                part = "beside"
            self._spent_s[f"{part}_s"] += spent_s

    def add(self, work: Work) -> None:
        """Count the work of workers."""
        self._work = Work.total((self._work, work))

    def split(self) -> TimeSplit:
        """Return how the time has been spent so far."""
        total_s = time.perf_counter() - self._began_s
        spent_s = sum(self._spent_s.values()) - self._spent_s["beside_s"]
        other_s = max(0.0, total_s - spent_s)
        work = self._work._asdict()
        return TimeSplit(
            workers=self.workers,
            other_s=other_s,
            processor_s=time.process_time() - self._process_s,
            **self._spent_s,
            **work,
        )


class Stopwatch:
    """Measures the processor time of the current thread."""

    def __init__(self) -> None:
        self._mark_s = time.thread_time()

    def lap_s(self) -> float:
        """Return the processor time since the last lap, or since the start."""
        before_s, self._mark_s = self._mark_s, time.thread_time()
        return self._mark_s - before_s
