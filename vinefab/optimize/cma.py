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
        self._asked: list[Any] = []

    def ask(self) -> Floats:
        """Return points of the distribution, shape (m, d)."""
        if not self._asked:
            self._asked = self._drawn()
        x = np.empty((self._population, len(self._counts)))
        if len(self._real):
            x[:, self._real] = [point.x for point in self._asked]
        if len(self._whole):
            numbers = np.array([point.z for point in self._asked])
            x[:, self._whole] = (numbers + 0.5) / self._counts[self._whole]
        return x

    def _drawn(self) -> list[Any]:
        """Draw a generation at once; the package's `ask` draws a point at a time, slowly."""
        search, count = self._search, self._population
        sequence = np.random.SeedSequence(self._seed, spawn_key=(_STREAM, self._generation))
        rng = np.random.RandomState(np.random.MT19937(sequence))
        vectors, roots = search._eigen_decomposition()
        steps = (rng.randn(count, len(roots)) * roots) @ vectors.T
        v = search._mean + search._sigma * search._A * steps
        x, z = np.clip(v[:, : len(self._real)], 0.0, 1.0), v[:, len(self._real) :]
        if len(self._whole):
            z = _whole_numbers(z, search._z_space, search._z_lim)
        return [search.Solution(*row) for row in zip(x, z, [None] * count, v, strict=True)]

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
            population_size=self._population,
            mean=middles,
            cov=np.diag((recipe.spread * ranges) ** 2),
        )
        if len(whole):
            # The package looks at one number at a time, which takes most of its time.
            search._discretization = lambda v: _whole_numbers(v, search._z_space, search._z_lim)
            search._integer_centering = lambda v: _centred(search, v)
        return search


def _whole_numbers(v: Floats, values: Floats, limits: Floats) -> Floats:
    """Return the values that numbers stand for, the shape of the numbers.

    Parameters
    ----------
    v
        The numbers, shape (n,) or (m, n).
    values
        Rising values of each column, shape (n, k).
    limits
        Where one value ends and the next begins, shape (n, k - 1).
    """
    places = np.count_nonzero(v[..., None] > limits, axis=-1)
    found: Floats = values[np.arange(len(values)), places]
    return found


def _centred(search: Any, v_raw: Floats) -> Floats:  # noqa: ANN401 - cmaes has no types here
    """Return the sorted points with whole numbers centred, as the package does row by row.

    The better half is moved: entries whose whole number differs from the mean's onto that number,
    and the others against the bias that this makes. It also notes which numbers mutated.
    """
    columns, better = search._discrete_idx, slice(search._mu)
    old = v_raw[better][:, columns]
    middle, whole = search._discretization(search._mean[columns]), search._discretization(old)
    mutated = whole != middle
    search._int_succ = mutated.any(axis=0)
    offsets = whole - old
    bias = np.where(mutated, offsets, 0.0).sum(axis=0)
    shares = np.zeros(len(columns))
    for sign in (1.0, -1.0):
        moves = np.where(~mutated & (sign * offsets > 0.0), offsets, 0.0).sum(axis=0)
        against = bias * moves < 0.0
        shares[against] = np.minimum(1.0, -bias[against] / moves[against])
    back = ~mutated & (bias * offsets < 0.0)
    moved = np.where(mutated, whole, old + back * shares * offsets)
    v_raw[: search._mu, columns] = moved
    return v_raw


def _plain(value: Any) -> object:  # noqa: ANN401 - as above
    if isinstance(value, list):
        return [float(entry) for entry in value]
    return int(value) if isinstance(value, int) else float(value)
