"""The two kinds of work that experiments are made of: training a design, and testing one.

A job is a value: what it gives depends on nothing else, so it can be done in any process, in any
order, and once for several experiments.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from vinefab import __version__
from vinefab.core.hashing import fingerprint
from vinefab.experiments.designs import design_from, plain_design
from vinefab.growth.options import GrowthOptions
from vinefab.optimize.identity import RunIdentity
from vinefab.optimize.loop import Search
from vinefab.optimize.settings import MapSettings, PartSettings, RunSettings, plain_settings
from vinefab.optimize.training import generated_maps
from vinefab.pipeline.optimize import penalty_of
from vinefab.tasks.evaluate import Site, poses_on, score_design
from vinefab.tasks.registry import make_task

FIRST_UNSEEN = 900_001
"""Seed of the first map for testing; no design has trained on any of them."""

SITES_KEPT = 64

DEFAULT_GROWTH = GrowthOptions()


class Job(Protocol):
    """Some work with a name of its own."""

    @property
    def key(self) -> str:
        """What tells it from all others, also in another session."""
        ...

    def run(self) -> dict[str, Any]:
        """Do it; the result is plain values."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """A run of the optimizer on generated maps.

    Parameters
    ----------
    settings
        The run.
    """

    settings: RunSettings

    @property
    def key(self) -> str:
        """Name of the run."""
        making = penalty_of(self.settings)
        return f"train_{RunIdentity.of(self.settings, (), making).run_id}"

    def run(self) -> dict[str, Any]:
        """Return the winner and how the search went.

        ``design``; ``fitness``, of the winner on fresh poses on the training maps; ``best`` and
        ``mean``, the fitness of each generation; ``evaluations``; ``penalty``.
        """
        settings = self.settings
        maps = generated_maps(settings.maps)
        result = Search.of(settings, maps, penalty_of(settings)).run()
        return {
            "design": plain_design(result.best),
            "fitness": result.finalists[0].fitness,
            "best": [g.best for g in result.history],
            "mean": [float(np.nanmean(g.composite)) for g in result.history],
            "evaluations": result.evaluations,
            "penalty": result.finalists[0].penalty,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Testing:
    """A design scored over maps and poses.

    Parameters
    ----------
    design
        As `plain_design` gives it.
    worlds
        The maps; generated ones.
    poses
        Poses on each.
    task
        What counts; areas are exact unless it says otherwise.
    growth
        How robots grow.
    """

    design: Mapping[str, Any]
    worlds: MapSettings
    poses: int
    task: PartSettings
    growth: GrowthOptions = DEFAULT_GROWTH

    @property
    def key(self) -> str:
        """Fingerprint of everything that it depends on."""
        return f"test_{fingerprint(plain_settings(self), __version__)}"

    def run(self) -> dict[str, Any]:
        """Return ``scores``, maps by poses, and every term likewise under ``terms``."""
        sites = tuple(site(self.worlds, index) for index in range(self.worlds.count))
        # Poses go by the map's seed: whoever is tested on a map meets the same ones.
        first = self.worlds.seed
        poses = poses_on(sites, self.poses, range(first, first + self.worlds.count))
        task = make_task(self.task.name, self.task.parameters)
        score = score_design(design_from(self.design), sites, poses, task, self.growth)
        shape = self.worlds.count, self.poses
        names = tuple(score.evaluations[0].terms)
        terms = {name: [e.terms[name] for e in score.evaluations] for name in names}
        return {
            "scores": score.scores.reshape(shape).tolist(),
            "terms": {name: np.reshape(values, shape).tolist() for name, values in terms.items()},
        }


def done(job: Job) -> dict[str, Any]:
    """Do a job: what a process of the pool is asked for."""
    return job.run()


def site(worlds: MapSettings, index: int) -> Site:
    """Return one of some generated maps, made ready."""
    return _site(worlds.environment, worlds.seed + index, tuple(sorted(worlds.options.items())))


@lru_cache(maxsize=SITES_KEPT)
def _site(environment: str, seed: int, options: tuple[tuple[str, object], ...]) -> Site:
    maps = MapSettings(environment=environment, count=1, seed=seed, options=dict(options))
    return Site.of(generated_maps(maps)[0])
