"""What a run ends with."""

import platform
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version

from vinefab import __version__
from vinefab.model.checked import Floats
from vinefab.model.design import Design
from vinefab.model.score import Score
from vinefab.optimize.history import Generation
from vinefab.optimize.settings import RunSettings
from vinefab.optimize.timing import TimeSplit

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
