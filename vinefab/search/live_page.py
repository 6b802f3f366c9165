"""The page of a run that is going on, rewritten now and then; loads no plotting."""

import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType

import numpy as np

from vinefab.core.atomic import write_text
from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    ForeignFileError,
    InterruptedRunError,
)
from vinefab.core.plain_text import counted
from vinefab.core.view import Answer, Block, Code, Fact, Facts, Notes, Picture, Remark, Text
from vinefab.growth.simulator import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.design import Design
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.pages.charts import fitness_curve
from vinefab.pages.html import Live, page
from vinefab.pages.page_svg import page_svg
from vinefab.pages.plan import deployment_plan
from vinefab.search.evaluator import INVALID_FITNESS
from vinefab.search.manufacturability import ManufacturabilityPenalty, run_profile
from vinefab.search.record.generations import Generation, Progress, curve_of
from vinefab.search.record.result import size_words
from vinefab.search.run import first_map
from vinefab.search.settings import RunSettings, run_task
from vinefab.search.space import Space
from vinefab.tasks.targets import touched_targets

PAGE_NAME = "index.html"
"""The page of a run in its folder."""

LEAST_PAUSE_S = 3.0
"""Between two versions of the live page, at least."""

_OF_PROCESSOR, _OF_TIME = 0.01, 0.05
"""Shares of the processor's time and of a run's time that its live page takes at most; writing to a
slow disk takes the second only. The first version loads what it needs, and is not counted."""

_REFRESH_S, _STOPPED_REFRESH_S = 5, 20
_PATIENCE_S = 90


class LivePage:
    """The page of a run that is going on: rewritten now and then, and when it is stopped.

    Nothing but the page depends on it: where it cannot be written, the run goes on without.

    Attributes
    ----------
    problem
        Why the page could not be written; empty if it could.
    """

    def __init__(self, folder: Path, settings: RunSettings, again: str) -> None:
        self.path = folder / PAGE_NAME
        self.problem = ""
        self._settings, self._again = settings, again
        self._last: Progress | None = None
        self._next_s, self._pause_s = 0.0, LEAST_PAUSE_S
        self._best = _BestSoFar(settings)

    def __enter__(self) -> "LivePage":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        """Say on the page that the run was stopped."""
        # Before the first generation of this session the page may be of another one.
        if kind is None or self._last is None:
            return
        interrupted = issubclass(kind, KeyboardInterrupt | InterruptedRunError)
        why = "Interrupted" if interrupted else f"Stopped by an error ({error})"
        self._write(f"{why} after {self._done(self._last)}.", running=False)

    def update(self, progress: Progress) -> None:
        """Write the page, unless that was just done."""
        if self._last is None:
            self._clear()
        self._last = progress
        self._best.look(progress.history)
        began_s, worked_s = time.monotonic(), time.thread_time()
        if began_s < self._next_s or self.problem:
            return
        left = _duration(progress.left_s)
        self._write(f"Running: {self._done(progress)}; about {left} left.", running=True)
        now_s = time.monotonic()
        if self._next_s:
            working_s = (time.thread_time() - worked_s) / _OF_PROCESSOR
            self._pause_s = max(LEAST_PAUSE_S, working_s, (now_s - began_s) / _OF_TIME)
        self._next_s = now_s + self._pause_s

    def _clear(self) -> None:
        """Remove what killed sessions left of a version half written."""
        with suppress(OSError):
            for path in self.path.parent.glob(f".{PAGE_NAME}.*"):
                path.unlink(missing_ok=True)

    @staticmethod
    def _done(progress: Progress) -> str:
        return progress.stage or f"generation {progress.generation} of {progress.generations}"

    def _write(self, state: str, *, running: bool) -> None:
        try:
            write_text(self.path, self._page(state, running=running))
        except (CannotWriteError, ForeignFileError) as error:
            self.problem = str(error)

    def _page(self, state: str, *, running: bool) -> str:
        progress, settings = self._last, self._settings
        if progress is None:
            raise BadInputError("progress", None, "that of a generation")
        pace_s = progress.elapsed_s / max(1, progress.generation)
        patience_s = round(_PATIENCE_S + 5.0 * pace_s + self._pause_s)
        return page(
            f"{settings.name}: search for the best design",
            (
                Answer(state, "good" if running else "caution"),
                Notes(() if running else (f"To go on: {self._again}",)),
                *([Remark(progress.advice, "warning")] if progress.advice else []),
                Facts(tuple(self._headlines(progress)), lead=True),
                *self._best.view(),
                Picture(
                    image=page_svg(fitness_curve(*curve_of(progress.history))),
                    caption="Best fitness so far, and the scores of each generation (simulated). "
                    "A best value can be luck: at the end finalists are evaluated again on fresh "
                    "poses.",
                ),
                Facts(run_facts(settings)),
                Text(
                    "Every generation is recorded. After Ctrl-C, a kill or a power cut this goes "
                    "on as if nothing had happened:"
                ),
                Code(self._again),
            ),
            Live(
                refresh_s=_REFRESH_S if running else _STOPPED_REFRESH_S,
                written_ms=int(1000 * time.time()),
                patience_s=patience_s if running else 0,
                again=self._again,
            ),
        )

    def _headlines(self, progress: Progress) -> Iterator[Fact]:
        best = progress.best
        yield Fact(
            "best fitness so far",
            f"{best:.4f}" if best > INVALID_FITNESS else "none",
            detail="in the search, of many tries: likely too good (simulated)",
        )
        if progress.targets_text:
            yield Fact(
                "targets of the best so far",
                progress.targets_text,
                detail="mean of its deployments (simulated)",
                tone="good" if progress.touches_all else "caution",
            )
        yield Fact(
            "mean of the last generation",
            f"{progress.mean:.4f}",
            detail=f"standard deviation {progress.spread:.4f} (simulated)",
        )
        if self._settings.evaluation.fabricable:
            yield Fact(
                "the best is manufacturable",
                progress.manufacturable,
                detail=f"{100.0 * progress.fabricable_share:.0f} % of the last generation are, by "
                "the quick rules; the winner's joints are simulated at the end",
                tone="caution" if progress.passes is False else "good",
            )


class _BestSoFar:
    """The design with the best fitness of a run so far, on its first training map."""

    def __init__(self, settings: RunSettings) -> None:
        self._settings, self._world = settings, first_map(settings)
        self._space = Space(settings.space, settings.build)
        self._seen, self._fitness = 0, INVALID_FITNESS
        self._at = 0
        self._design: Design | None = None
        self._drawn: tuple[Design, bytes] | None = None

    def look(self, history: Sequence[Generation]) -> None:
        """Look for a better design in the generations that are new."""
        for generation in history[self._seen :]:
            if generation.best > self._fitness:
                row = int(np.argmax(generation.fitness))
                self._fitness, self._at = generation.best, generation.number + 1
                self._design = self._space.design(generation.x[row], self._settings.name)
        self._seen = len(history)

    def view(self) -> Iterator[Block]:
        """Yield what it is, with a picture."""
        design = self._design
        if design is None:
            yield Text("No point of the space was a design yet.")
            return
        size = f"{size_words(design)}{self._pieces_words(design)}"
        yield Picture(
            image=self._picture(design),
            caption=f"The best so far, from the start of {self._world.name} (simulated): {size}, "
            f"found in generation {self._at}.",
        )

    def _pieces_words(self, design: Design) -> str:
        """Return how many pieces the search takes a design for; empty where it must be one."""
        settings, evaluation = design.build.pieces, self._settings.evaluation
        if settings is None or not evaluation.fabricable:
            return ""
        penalty = ManufacturabilityPenalty(profile=run_profile(evaluation))
        count = penalty.pieces(design)
        if count is None:
            return f", not yet in {counted(settings.most, 'piece')} that lie flat"
        return f", {counted(count, 'piece')} by the quick rules"

    def _picture(self, design: Design) -> bytes:
        if self._drawn is None or self._drawn[0] is not design:
            growth, pose = self._settings.growth.at_one_angle, self._world.starts[0].pose
            deployment = grow_on(design, Terrain.of(self._world), pose, growth)
            touched = touched_targets([(deployment, self._world)], run_task(self._settings))
            widths_mm = growth.drawn_widths_mm(design.build.widths_mm)
            plan = deployment_plan(self._world, deployment, widths_mm, touched=touched)
            image = page_svg(plan)
            self._drawn = design, image
        return self._drawn[1]


def run_facts(settings: RunSettings) -> tuple[Fact, ...]:
    """Return name and value of what a run was asked for."""
    search, maps = settings.search, settings.maps
    where = "from files" if maps.files else f"of {maps.environment}, seed {maps.seed}"
    evaluation = settings.evaluation
    made = f"recipe {evaluation.recipe or DEFAULT_RECIPE}" if evaluation.fabricable else "not asked"
    return (
        Fact("task", settings.task.name),
        Fact("training maps", f"{maps.count} {where}"),
        Fact("optimizer", f"{settings.optimizer.name}, seed {search.seed}"),
        Fact(
            "size",
            f"{counted(search.population, 'design')} x {counted(search.generations, 'generation')}",
        ),
        Fact("manufacturability", made),
        *([Fact("pieces", _pieces_fact(settings))] if settings.build.pieces else []),
    )


def _pieces_fact(settings: RunSettings) -> str:
    """Return how many pieces a run allows, and what it charges for their joints."""
    pieces, weight = settings.build.pieces, settings.evaluation.joint_weight
    most = pieces.most if pieces else 1
    charged = f", every joint costs {weight:g} of the fitness" if weight else ""
    return f"at most {most}, joined by sleeves{charged}"


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60.0)
    if seconds < 90.0:
        return f"{round(seconds)} s"
    return f"{minutes} min" if minutes < 120 else f"{seconds / 3600.0:.1f} h"
