"""What happens in a run, generation by generation, and what it ends with."""

import platform
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from vinefab import __version__
from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.model.score import Score
from vinefab.search.record.timing import TimeSplit
from vinefab.search.settings import RunSettings


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Generation:
    """One generation: m points and what became of them.

    Parameters
    ----------
    number
        0 for the first.
    x
        Points in the unit cube, shape (m, d).
    fitness
        What the optimizer was told, shape (m,).
    composite
        Composite scores, shape (m,); NaN for a point that is no design.
    penalty
        Fabrication penalties, shape (m,); 0 everywhere in a run that does not ask for designs
        that can be made.
    terms
        Means of the task's terms over the evaluations, each of shape (m,).
    seconds
        How long it took.
    best
        The largest fitness.
    """

    number: int
    x: Floats
    fitness: Floats
    composite: Floats
    penalty: Floats
    terms: Mapping[str, Floats]
    seconds: float
    best: float = field(init=False)

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
    """What a user sees while a run goes on.

    Parameters
    ----------
    generation, generations
        How many are done, and how many there are at most.
    best
        Best fitness of the run so far.
    mean, spread
        Mean and standard deviation of the composite scores of this generation's designs.
    fabricable_share
        Share of this generation's designs that can be made.
    elapsed_s, left_s
        Time spent by all sessions together; time that the rest will take at this pace.
    """

    generation: int
    generations: int
    best: float
    mean: float
    spread: float
    fabricable_share: float
    elapsed_s: float
    left_s: float


_PACKAGES = ("cmaes", "numba", "numpy", "pymoo", "pyswarms", "scipy", "shapely")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Finalist:
    """One of the best designs of a run, evaluated again on fresh poses.

    Parameters
    ----------
    x
        Its point, shape (d,).
    design
        The design.
    score
        Its score on the fresh poses.
    penalty
        Its penalty; 0 in a run that does not ask for designs that can be made.
    fitness
        Its fitness on the fresh poses; finalists are ordered by it.
    """

    x: Floats
    design: Design
    score: Score
    penalty: float
    fitness: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunResult:
    """What a run found.

    Parameters
    ----------
    run_id
        Name of the run: the same for the same settings and maps.
    best
        The winner, with its origin.
    finalists
        Best first; the winner is the first.
    history
        Every generation.
    stopped
        Why it stopped: ``generations``, ``evaluations``, ``stall`` or ``wall_time``.
    times
        Where the time of this session went.
    asked
        Whether the run asked for designs that can be made.
    repair
        What was done because no design of the search could be made, in words; else empty.
    drift
        Packages that have another version now than when the run began, in words.
    """

    run_id: str
    best: Design
    finalists: tuple[Finalist, ...]
    history: tuple[Generation, ...]
    stopped: str
    times: TimeSplit = field(default_factory=TimeSplit)
    asked: bool = True
    repair: str = ""
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
    """Return the versions of everything that a run's numbers depend on.

    Parameters
    ----------
    others
        More packages, such as those of plug-ins; one that is not installed has version ``none``.
    """
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
