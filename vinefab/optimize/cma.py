"""CMA-ES with margin for mixed variables, from the package cmaes, one generation at a time.

A normal distribution moves towards what is good and takes the shape of what is good; a margin
keeps whole numbers from freezing (Hamano et al., CatCMA with margin, arXiv:2504.07884). Whole
numbers with two values are treated like the others: the package's probabilities for categories
became NaN in long runs of ours.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.model.checked import Floats, number
from vinefab.optimize.axes import Axes
from vinefab.optimize.optimizer import Optimizer

_STREAM = 1405
LEAST_POPULATION = 4
"""With fewer points there is no covariance to learn from."""

# All that changes from one generation to the next, but the generator, which is made anew for each.
# _B and _D can be computed from _C, but not to the last bit.
_ARRAYS = {"_mean": float, "_C": float, "_B": float, "_D": float, "_p_sigma": float, "_pc": float}
_ARRAYS |= {"_A": float, "_pmut": float, "_int_succ": bool}
_NUMBERS = ("_sigma", "_g", "_iqhist_values")


@dataclass(frozen=True, slots=True, kw_only=True)
class CmaRecipe:
    """Parameters of CMA-ES.

    Parameters
    ----------
    spread
        Standard deviation of the first generation, as a share of each range.
    """

    spread: float = 0.2

    def __post_init__(self) -> None:
        number("optimizer.spread", self.spread, 1e-3, 1.0)

    def start(self, axes: Axes, population: int, seed: int) -> Optimizer:
        """Return the search before its first generation."""
        if population < LEAST_POPULATION:
            allowed = f"at least {LEAST_POPULATION} for the optimizer cmaes"
            raise BadInputError("optimizer.population", population, allowed)
        return Cma(self, axes, population, seed)


class Cma:
    """A distribution over designs that learns from the ranks of what it proposes.

    Parameters
    ----------
    recipe
        Parameters.
    axes
        The coordinates.
    population
        Points per generation, at least 4.
    seed
        At least 0.

    Notes
    -----
    It is told ranks instead of fitness: of the values themselves the algorithm uses only the
    spread, to weigh points outside the bounds, and a penalty would blow that up.

    An inactive coordinate is drawn like any other and selected by chance: its mean and spread
    stay, in expectation, what they are, until designs with that level are looked at again.
    """

    def __init__(self, recipe: CmaRecipe, axes: Axes, population: int, seed: int) -> None:
        self._seed = seed
        self._population = population
        counts = np.array(axes.choices)
        self._real = np.flatnonzero(counts == 0)
        self._whole = np.flatnonzero(counts > 0)
        self._counts = counts
        self._search = self._new_search(recipe)
        self._generation = 0
        self._drawn: Floats | None = None

    def ask(self) -> Floats:
        """Return points of the distribution, shape (m, d)."""
        reals, numbers = self._search.within(self._points())
        x = np.empty((self._population, len(self._counts)))
        x[:, self._real] = reals
        x[:, self._whole] = (numbers + 0.5) / self._counts[self._whole]
        return x

    def _points(self) -> Floats:
        """Return this generation's points as they were drawn."""
        if self._drawn is None:
            sequence = np.random.SeedSequence(self._seed, spawn_key=(_STREAM, self._generation))
            rng = np.random.RandomState(np.random.MT19937(sequence))
            self._drawn = self._search.sample(rng, self._population)
        return self._drawn

    def tell(self, x: Floats, fitness: Floats) -> None:  # noqa: ARG002 - it knows what it asked
        """Move the distribution by the ranks of the points."""
        # Of equals, the order in which they were drawn decides, which is as good as any.
        self._search.learn(self._points()[np.argsort(-fitness, kind="stable")])
        self._drawn = None
        self._generation += 1

    def state(self) -> Mapping[str, object]:
        """Return the distribution; before the first generation nothing is to be kept."""
        if self._generation == 0:
            return {"generation": 0}
        kept: dict[str, object] = {"generation": self._generation}
        known = vars(self._search)
        kept |= {name: np.array(known[name], dtype=float) for name in _ARRAYS if name in known}
        kept |= {name: _plain(known[name]) for name in _NUMBERS if name in known}
        return kept

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a state."""
        self._generation = state["generation"]
        self._drawn = None
        for name, value in state.items():
            if name in _ARRAYS:
                setattr(self._search, name, np.array(value, dtype=_ARRAYS[name]))
            elif name in _NUMBERS:
                setattr(self._search, name, value)

    def _new_search(self, recipe: CmaRecipe) -> Any:  # noqa: ANN401 - cmaes has no types here
        from vinefab.optimize.cma_search import Distribution  # noqa: PLC0415 - takes a second

        whole = self._counts[self._whole]
        ranges = np.concatenate([np.ones(len(self._real)), whole])
        middles = np.concatenate([np.full(len(self._real), 0.5), (whole - 1.0) / 2.0])
        return Distribution(
            x_space=[[0.0, 1.0]] * len(self._real) or None,
            z_space=[list(range(count)) for count in whole.tolist()] or None,
            population_size=self._population,
            mean=middles,
            cov=np.diag((recipe.spread * ranges) ** 2),
        )


def _plain(value: Any) -> object:  # noqa: ANN401 - as above
    if isinstance(value, list):
        return [float(entry) for entry in value]
    return int(value) if isinstance(value, int) else float(value)
