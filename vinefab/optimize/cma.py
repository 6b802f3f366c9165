"""CMA-ES with margin for mixed variables, from the package cmaes, one generation at a time.

A normal distribution moves towards what is good and takes the shape of what is good; a margin
keeps whole numbers from freezing (Hamano et al., CatCMA with margin, arXiv:2504.07884). Whole
numbers with two values are drawn from probabilities, as the package's authors advise.
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
_ARRAYS |= {"_A": float, "_pmut": float, "_int_succ": bool, "_q": float, "_s": float}
_NUMBERS = ("_sigma", "_g", "_iqhist_values", "_Delta", "_gamma", "_delta", "_eps")


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
        self._whole = np.flatnonzero(counts > 2)
        self._binary = np.flatnonzero((counts == 1) | (counts == 2))
        self._counts = counts
        self._search = self._new_search(recipe)
        self._generation = 0
        self._asked: list[Any] = []

    def ask(self) -> Floats:
        """Return points of the distribution, shape (m, d)."""
        if not self._asked:
            sequence = np.random.SeedSequence(self._seed, spawn_key=(_STREAM, self._generation))
            self._search._rng = np.random.RandomState(np.random.MT19937(sequence))
            self._asked = [self._search.ask() for _ in range(self._population)]
        x = np.empty((self._population, len(self._counts)))
        if len(self._real):
            x[:, self._real] = [point.x for point in self._asked]
        if len(self._whole):
            numbers = np.array([point.z for point in self._asked])
            x[:, self._whole] = (numbers + 0.5) / self._counts[self._whole]
        if len(self._binary):
            numbers = np.array([point.c.argmax(axis=1) for point in self._asked])
            x[:, self._binary] = (numbers + 0.5) / self._counts[self._binary]
        return x

    def tell(self, x: Floats, fitness: Floats) -> None:  # noqa: ARG002 - it knows what it asked
        """Move the distribution by the ranks of the points."""
        self.ask()
        ranks = np.empty(self._population)
        # Of equals, the order in which they were drawn decides, which is as good as any.
        ranks[np.argsort(-fitness, kind="stable")] = np.arange(self._population)
        self._search.tell(list(zip(self._asked, ranks.tolist(), strict=True)))
        self._asked = []
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
        self._asked = []
        for name, value in state.items():
            if name in _ARRAYS:
                setattr(self._search, name, np.array(value, dtype=_ARRAYS[name]))
            elif name in _NUMBERS:
                setattr(self._search, name, value)

    def _new_search(self, recipe: CmaRecipe) -> Any:  # noqa: ANN401 - cmaes has no types here
        from cmaes import CatCMAwM  # noqa: PLC0415 - loads scipy's statistics, which takes a second

        whole = self._counts[self._whole]
        ranges = np.concatenate([np.ones(len(self._real)), whole])
        middles = np.concatenate([np.full(len(self._real), 0.5), (whole - 1.0) / 2.0])
        search = CatCMAwM(
            x_space=[[0.0, 1.0]] * len(self._real) or None,
            z_space=[list(range(count)) for count in whole.tolist()] or None,
            c_space=[2] * len(self._binary) or None,
            population_size=self._population,
            mean=middles if len(middles) else None,
            cov=np.diag((recipe.spread * ranges) ** 2) if len(ranges) else None,
        )
        if len(whole):
            # The package looks at one number at a time, which takes most of its time.
            search._discretization = lambda v: _whole_numbers(v, search._z_space, search._z_lim)
        return search


def _whole_numbers(v: Floats, values: Floats, limits: Floats) -> Floats:
    """Return the value of each row that a number stands for, shape (n,).

    Parameters
    ----------
    v
        The numbers, shape (n,).
    values
        Rising values of each row, shape (n, k).
    limits
        Where one value ends and the next begins, shape (n, k - 1).
    """
    places = np.count_nonzero(v[:, None] > limits, axis=1)
    found: Floats = values[np.arange(len(values)), places]
    return found


def _plain(value: Any) -> object:  # noqa: ANN401 - as above
    if isinstance(value, list):
        return [float(entry) for entry in value]
    return int(value) if isinstance(value, int) else float(value)
