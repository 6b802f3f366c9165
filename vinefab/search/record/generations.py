"""Generations and finalists of a run, and its identity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from typing import Any, Self, cast

import numpy as np

from vinefab.core.codec import Record
from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.hashing import fingerprint
from vinefab.core.plain_text import counted
from vinefab.core.progress import Progress
from vinefab.core.registry import Registry
from vinefab.core.validation import Floats
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.design import Design
from vinefab.model.files.run_context import map_fingerprint, package_versions
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.model.start import start_of_record, start_text
from vinefab.search.evaluator import INVALID_FITNESS, Penalty
from vinefab.search.optimizers.optimizer import OPTIMIZERS
from vinefab.search.settings import (
    LIMIT_NAMES,
    RunSettings,
    limit_option,
    plain_settings,
)
from vinefab.search.space import COSTS
from vinefab.tasks import TASKS
from vinefab.tasks.reach import TARGETS, TOUCHED


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Generation:
    """One generation: m points and their evaluations."""

    number: int  # 0 for the first
    x: Floats  # points in the unit cube, shape (m, d)
    fitness: Floats  # as told to the optimizer, shape (m,)
    composite: Floats  # composite scores, shape (m,); NaN for a point without a valid design
    penalty: Floats  # shape (m,); 0 for designs that are manufacturable and within the limits
    # means of the task's terms over the evaluations, and composites of other tasks' scores in runs
    # that have them as objectives, by the tasks' names; shape (m,) each
    terms: Mapping[str, Floats]
    seconds: float  # duration
    best: float = field(init=False)  # the largest fitness

    def __post_init__(self) -> None:
        # Stored, because it is read for all generations after each one.
        object.__setattr__(self, "best", float(self.fitness.max()))

    @property
    def fabricable_share(self) -> float:
        """Share of the points with a valid design without penalty."""
        return float(((self.penalty == 0.0) & np.isfinite(self.composite)).mean())

    @property
    def has_designs(self) -> bool:
        """Whether any point has a valid design."""
        return bool(np.isfinite(self.composite).any())


def curve_of(history: Sequence[Generation]) -> tuple[Floats, Floats, Floats]:
    """Return the best fitness so far, and mean and deviation of the scores, by generation.

    NaN where there was no valid design.
    """
    best = np.maximum.accumulate([generation.best for generation in history])
    scores = [g.composite[np.isfinite(g.composite)] for g in history]
    mean = np.array([values.mean() if len(values) else np.nan for values in scores])
    spread = np.array([values.std() if len(values) else np.nan for values in scores])
    return np.where(best > INVALID_FITNESS, best, np.nan), mean, spread


def touched_text(touched: float, total: float) -> str:
    """Return how many targets are touched, a mean over maps, as everywhere."""
    return f"{touched:.3g} of {total:g} touched"


SEARCHING = "generations"
"""The phase of a run in which its points are evaluated, counted in generations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchProgress(Progress):
    """The progress of a run after a generation; its count is that of the generations."""

    phase: str = SEARCHING
    best: float  # best fitness of the run so far
    mean: float  # of the composite scores of this generation's designs
    spread: float  # their standard deviation
    fabricable_share: float  # share of this generation's points with a manufacturable design
    elapsed_s: float  # of all sessions together
    evaluations: int = 0  # designs evaluated so far
    history: Sequence[Generation] = ()  # every generation so far
    # Whether the best so far passes the full check, joints by the table; None where that is not
    # asked, or only a simulation tells.
    passes: bool | None = None
    # Findings on trunk and sheet, or the rules that stop all designs so far, with limits to relax.
    advice: str = ""

    @property
    def manufacturable(self) -> str:
        """Whether the best so far is manufacturable, for the user."""
        return {True: "yes", False: "not yet", None: "by the quick rules"}[self.passes]

    @property
    def _touched(self) -> tuple[float, float] | None:
        """How many targets the best design so far touches, of how many; None without targets."""
        if not self.history or TARGETS not in self.history[-1].terms:
            return None
        best = max(self.history, key=lambda generation: generation.best)
        place = int(best.fitness.argmax())
        return float(best.terms[TOUCHED][place]), float(best.terms[TARGETS][place])

    @property
    def targets_text(self) -> str:
        """How many targets the best design so far touches; empty where there are none."""
        return "" if self._touched is None else touched_text(*self._touched)

    @property
    def touches_all(self) -> bool:
        """Whether the best design so far touches all targets."""
        return self._touched is not None and self._touched[0] == self._touched[1]

    @property
    def share(self) -> float:
        """Share of the run that is done, by the first of its limits that ends it at this pace."""
        whole_s = self.elapsed_s + (self.left_s or 0.0)
        return self.elapsed_s / whole_s if whole_s > 0.0 else self.done / self.total

    def told(self, *, checked: bool) -> Self:
        """Return the same with its facts as words; `checked`: whether rules count."""
        made = f", manufacturable: {self.manufacturable}" if checked else ""
        touched = f" ({self.targets_text})" if self.targets_text else ""
        words = f"best {self.best:.4f}{touched}, mean {self.mean:.4f} +- {self.spread:.4f}{made}"
        return replace(self, words=words)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Finalist:
    """One of the best designs of a run, evaluated again on fresh poses."""

    x: Floats  # its point, shape (d,)
    design: Design
    score: Score  # on the fresh poses
    penalty: float  # 0 if it may win
    fitness: float  # on the fresh poses; finalists are ordered by it


@dataclass(frozen=True, slots=True, kw_only=True)
class Extension(Record):
    """One time that limits of a run were raised after it had begun."""

    utc: str  # when, ISO 8601
    generations_done: int  # how many generations it had by then
    stopped: str  # why it had stopped; empty if it was not done
    before: Mapping[str, float]  # the limits until then, by name
    after: Mapping[str, float]  # the limits since then
    score: float | None = None  # mean score of the winner that it had, on fresh poses

    @property
    def text(self) -> str:
        """The extension in a line for the user."""
        raised = [
            f"{name} {self.before[name]:g} -> {value:g}"
            for name, value in self.after.items()
            if value != self.before[name]
        ]
        had = "" if self.score is None else f", with a winner of {self.score:.4f} (simulated)"
        return (
            f"extended {self.utc[:19]} UTC after "
            f"{counted(self.generations_done, 'generation')}{had}: "
            f"{', '.join(raised)}"
        )


def plugin_packages(settings: RunSettings) -> list[str]:
    """Return the plug-in packages of a run's task, optimizer and environment."""
    environment = "" if settings.maps.files else settings.maps.environment
    named: tuple[tuple[Registry[Any], str], ...] = (
        *((TASKS, task.name) for task in (settings.task, *settings.other_tasks)),
        (OPTIMIZERS, settings.optimizer.name),
        (ENVIRONMENTS, environment),
    )
    # A look-up of a name makes the registry load plug-ins.
    packages = {parts.packages.get(name, "") for parts, name in named if name in parts}
    return sorted(packages - {""})


@dataclass(frozen=True, slots=True, kw_only=True)
class RunIdentity:
    """Everything that determines a run's result, as plain values."""

    settings: Mapping[str, Any]
    maps: tuple[str, ...]  # fingerprint of each map
    versions: Mapping[str, str]  # of vinefab and the packages that it computes with

    @classmethod
    def of(
        cls, settings: RunSettings, maps: Sequence[Map], penalty: Penalty | None = None
    ) -> "RunIdentity":
        """Return the identity of a run."""
        plain = cast("dict[str, Any]", plain_settings(settings))
        if is_dataclass(penalty):
            plain["making"] = plain_settings(penalty)
        return cls(
            settings=plain,
            maps=tuple(map_fingerprint(world) for world in maps),
            versions=package_versions(plugin_packages(settings)),
        )

    @property
    def run_id(self) -> str:
        """Id of the run, 12 hexadecimal digits; independent of other packages' versions."""
        return fingerprint(self._portable_settings, self.maps, self.versions["vinefab"])

    def with_limits(self, search: Mapping[str, Any]) -> "RunIdentity":
        """Return the identity of the same run with the limits of other search settings."""
        limits = {name: search[name] for name in LIMIT_NAMES}
        settings = {**self.settings, "search": {**self.settings["search"], **limits}}
        return replace(self, settings=settings)

    @property
    def limits(self) -> dict[str, float]:
        """The limits that end the run, by name."""
        return {name: self.settings["search"][name] for name in LIMIT_NAMES}

    @property
    def seedless_id(self) -> str:
        """Id of all runs that differ from this one in their seed alone."""
        settings = self._portable_settings
        search = {key: value for key, value in settings["search"].items() if key != "seed"}
        return fingerprint({**settings, "search": search}, self.maps, self.versions["vinefab"])

    @property
    def _portable_settings(self) -> dict[str, Any]:
        """The settings without the paths of map files; their content counts instead.

        Limits and the start are as in run files, so that a difference is named as it is there.
        """
        maps = {key: value for key, value in self.settings["maps"].items() if key != "files"}
        if start := maps.get("start"):
            maps["start"] = start_text(start_of_record(start))
        space = dict(self.settings["space"])
        limits = {COSTS[name].limit_key: v for name, v in space.pop("most", {}).items()}
        return {**self.settings, "maps": maps, "space": {**space, **limits}}

    def drift(self, recorded: "RunIdentity") -> list[str]:
        """Return the packages with other versions than a record, one message each."""
        return [
            f"{name} {recorded.versions.get(name, 'none')} then, {number} now"
            for name, number in self.versions.items()
            if recorded.versions.get(name) != number
        ]

    def differs_from(self, recorded: "RunIdentity") -> BadInputError | None:
        """Return the error that keeps this run from resuming a record, or None."""
        if self.versions["vinefab"] != recorded.versions["vinefab"]:
            began = f"vinefab {recorded.versions['vinefab']}"
            problem = f"{began} began the run, and this is vinefab {self.versions['vinefab']}"
            return UnfitInputError("--resume", problem, f"resume it with {began}")
        difference = first_difference(self._portable_settings, recorded._portable_settings)
        if difference is not None:
            key, mine, before = difference
            name = key.removeprefix("search.")
            raised = f"; {limit_option(name)} raises it" if name in LIMIT_NAMES else ""
            as_in_file = f"optimizer.{name}" if name != key else key
            problem = f"{mine!r} is asked for, and the run began with {before!r}"
            return UnfitInputError(as_in_file, problem, f"give another run another folder{raised}")
        if self.maps != recorded.maps:
            problem = "are not those with which the run began"
            return UnfitInputError("maps", problem, "give another run another folder")
        return None


def first_difference(
    one: object, other: object, path: str = ""
) -> tuple[str, object, object] | None:
    """Return the key at which two plain values first differ, and both values; or None.

    Examples
    --------
    >>> first_difference({"a": {"b": 1, "c": 2}}, {"a": {"b": 1, "c": 3}})
    ('a.c', 2, 3)
    """
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in sorted({*one, *other}):
            inner = f"{path}.{key}" if path else str(key)
            if found := first_difference(one.get(key), other.get(key), inner):
                return found
        return None
    return None if one == other else (path, one, other)
