"""What happens in a run, generation by generation, and what it ends with."""

import platform
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from vinefab.core.validation import Floats
from vinefab.core.version import __version__
from vinefab.model.design import Design
from vinefab.model.score import Score
from vinefab.search.record.timing import TimeSplit
from vinefab.search.settings import RunSettings


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Generation:
    """One generation: m points and what became of them."""

    number: int  # 0 for the first
    x: Floats  # points in the unit cube, shape (m, d)
    fitness: Floats  # what the optimizer was told, shape (m,)
    composite: Floats  # composite scores, shape (m,); NaN for a point that is no design
    # fabrication penalties, shape (m,); 0 everywhere in a run that does not ask for designs that
    # can be made
    penalty: Floats
    # means of the task's terms over the evaluations, each of shape (m,)
    terms: Mapping[str, Floats]
    seconds: float  # how long it took
    best: float = field(init=False)  # the largest fitness

    def __post_init__(self) -> None:
        # Looked at for every generation after every other one.
        object.__setattr__(self, "best", float(self.fitness.max()))

    @property
    def fabricable_share(self) -> float:
        """Share of the points that are designs without a penalty."""
        return float(((self.penalty == 0.0) & np.isfinite(self.composite)).mean())

    @property
    def has_designs(self) -> bool:
        """Whether any point is a design."""
        return bool(np.isfinite(self.composite).any())


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """What a user sees while a run goes on."""

    # generation, generations: how many are done, and how many there are at most
    generation: int
    generations: int
    best: float  # best fitness of the run so far
    # mean, spread: mean and standard deviation of the composite scores of this generation's designs
    mean: float
    spread: float
    fabricable_share: float  # share of this generation's designs that can be made
    # elapsed_s, left_s: time spent by all sessions together; time that the rest will take at this
    # pace
    elapsed_s: float
    left_s: float


_PACKAGES = ("cmaes", "numba", "numpy", "pymoo", "pyswarms", "scipy", "shapely")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Finalist:
    """One of the best designs of a run, evaluated again on fresh poses."""

    x: Floats  # its point, shape (d,)
    design: Design  # the design
    score: Score  # its score on the fresh poses
    penalty: float  # its penalty; 0 in a run that does not ask for designs that can be made
    fitness: float  # its fitness on the fresh poses; finalists are ordered by it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunResult:
    """What a run found."""

    run_id: str  # name of the run: the same for the same settings and maps
    best: Design  # the winner, with its origin
    finalists: tuple[Finalist, ...]  # best first; the winner is the first
    history: tuple[Generation, ...]  # every generation
    stopped: str  # why it stopped: ``generations``, ``evaluations``, ``stall`` or ``wall_time``
    times: TimeSplit = field(default_factory=TimeSplit)  # where the time of this session went
    asked: bool = True  # whether the run asked for designs that can be made
    # what was done because no design of the search could be made, in words; else empty
    repair: str = ""
    # packages that have another version now than when the run began, in words
    drift: tuple[str, ...] = ()

    @property
    def score(self) -> Score:
        """The winner's score on fresh poses on the training maps."""
        return self.finalists[0].score

    @property
    def fabricable(self) -> bool:
        """Whether the winner has no penalty; always so in a run that did not ask."""
        return self.finalists[0].penalty == 0.0

    @property
    def evaluations(self) -> int:
        """How many designs the search evaluated."""
        return sum(len(generation.fitness) for generation in self.history)


def package_versions(others: Iterable[str] = ()) -> dict[str, str]:
    """Return the versions of everything that a run's numbers depend on."""
    versions = {"vinefab": __version__, "python": platform.python_version()}
    versions |= {name: version(name) for name in _PACKAGES}
    for name in others:
        if name not in versions:
            try:
                versions[name] = version(name)
            except PackageNotFoundError:
                versions[name] = "none"
    return versions


def with_origin(
    finalist: Finalist, settings: RunSettings, run_id: str, versions: Mapping[str, str]
) -> Design:
    """Return a finalist's design with a name and where it comes from.

    No times: the same run gives the same bytes.
    """
    origin: dict[str, object] = {
        "run": run_id,
        "task": settings.task.name,
        "optimizer": settings.optimizer.name,
        "seed": settings.search.seed,
        "population": settings.search.population,
        "generations": settings.search.generations,
        "penalty": finalist.penalty,
        "evaluations_of_score": len(finalist.score.evaluations),
        **{f"score_{name}": value for name, value in finalist.score.composite.items()},
        "versions": ", ".join(f"{name} {number}" for name, number in sorted(versions.items())),
    }
    return replace(finalist.design, name=settings.name, origin=origin)
