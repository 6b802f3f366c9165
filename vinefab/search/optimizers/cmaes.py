"""CMA-ES with margin for mixed variables, one generation at a time.

A normal distribution adapts its mean and covariance to the best points; a margin keeps integers
from freezing (Hamano et al., CatCMA with margin, arXiv:2504.07884). It learns as the package cmaes
does, whose public functions cannot serve here: islands ask for points until enough are valid, learn
from all of them, and are resumed between any two generations. Integers with two values are
treated like the others: the package's probabilities for categories became NaN in long runs.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
import scipy  # its parts load at their first use
from annotated_types import Ge, Le
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.table import Table
from vinefab.core.validation import Floats
from vinefab.search.optimizers.optimizer import Optimizer, SearchAxes

_LEAST, _MOST, _LEAST_EIGENVALUE = 1e-8, 1e32, 1e-30
"""Bound that keeps quotients finite and probabilities above 0, and the largest step size, as in
the package."""


class Distribution:
    """A normal distribution whose last coordinates stand for integers.

    Constants, and the order of operations, are those of the package cmaes 0.13, so that both learn
    the same to the last bit.

    Parameters
    ----------
    middle, spread
        Mean and standard deviation of each coordinate, shape (d,); integers last.
    population
        Number of points that each generation learns from.
    counts
        Number of values of each integer.
    """

    def __init__(
        self, middle: Floats, spread: Floats, *, population: int, counts: Sequence[int] = ()
    ) -> None:
        size = len(middle)
        self._reals, self._population, self._mu = size - len(counts), population, population // 2
        ranks = [math.log((population + 1) / 2) - math.log(i + 1) for i in range(population)]
        raw, mu = np.array(ranks), self._mu
        # Sizes of the better half and the worse half, and rates of learning.
        self._mu_eff = mu_eff = np.sum(raw[:mu]) ** 2 / np.sum(raw[:mu] ** 2)
        mu_eff_worse = np.sum(raw[mu:]) ** 2 / np.sum(raw[mu:] ** 2)
        self._c1 = 2 / ((size + 1.3) ** 2 + mu_eff)
        rate_mu = 2 * (mu_eff - 2 + 1 / mu_eff) / ((size + 2) ** 2 + 2 * mu_eff / 2)
        self._cmu = min(1 - self._c1 - _LEAST, rate_mu)
        worse = min(
            1 + self._c1 / self._cmu,
            1 + (2 * mu_eff_worse) / (mu_eff + 2),
            (1 - self._c1 - self._cmu) / (size * self._cmu),
        )
        better_sum, worse_sum = np.sum(raw[raw > 0]), np.sum(np.abs(raw[raw < 0]))
        self._weights = np.where(raw >= 0, 1 / better_sum * raw, worse / worse_sum * raw)
        self._c_sigma = (mu_eff + 2) / (size + mu_eff + 5)
        far = math.sqrt((mu_eff - 1) / (size + 1)) - 1
        self._d_sigma = 1 + 2 * max(0, far) + self._c_sigma
        self._cc = (4 + mu_eff / size) / (size + 4 + 2 * mu_eff / size)
        self._chi_n = math.sqrt(size) * (1.0 - 1.0 / (4.0 * size) + 1.0 / (21.0 * size**2))

        self._mean, self._C, self._sigma, self._g = middle.copy(), np.diag(spread**2), 1.0, 0
        self._B: Floats | None = None
        self._D: Floats | None = None
        self._p_sigma, self._pc, self._A = np.zeros(size), np.zeros(size), np.ones(size)
        self._low = np.where(np.arange(size) < self._reals, 0.0, -np.inf)
        self._high = np.where(np.arange(size) < self._reals, 1.0, np.inf)
        # Integers, padded to the longest range with their largest value, and the limits between.
        self._discrete_idx = np.arange(self._reals, size)
        if counts:
            self._alpha = 1 - 0.73 ** (1 / len(counts))
            self._pmut = (0.5 - _LEAST) * np.ones(len(counts))
            self._int_succ = np.zeros(len(counts), dtype=bool)
            longest = np.arange(max(counts))
            self._z_space = np.minimum(longest, np.array(counts)[:, None] - 1)
            self._z_lim = (self._z_space[:, 1:] + self._z_space[:, :-1]) / 2

    def sample(self, rng: np.random.RandomState, count: int) -> Floats:
        """Return random points, shape (count, d), not yet within the bounds."""
        vectors, roots = self._eigen_decomposition()
        steps = (rng.randn(count, len(roots)) * roots) @ vectors.T
        drawn: Floats = self._mean + self._sigma * self._A * steps
        return drawn

    def within(self, v: Floats) -> tuple[Floats, Floats]:
        """Return continuous coordinates clipped to 0 to 1, and the integers of the others."""
        reals, rest = v[:, : self._reals], v[:, self._reals :]
        return np.clip(reals, 0.0, 1.0), self._discretization(rest) if rest.size else rest

    @property
    def spread(self) -> Floats:
        """Standard deviation of each coordinate, shape (d,)."""
        deviations: Floats = self._sigma * self._A * np.sqrt(np.diag(self._C))
        return deviations

    def learn(self, v: Floats) -> None:
        """Update mean and covariance by sampled points, shape (count, d), best first."""
        v = v[np.argsort(self._places(v), kind="stable")]
        self._g += 1
        if len(self._discrete_idx):
            v = self._integer_centering(v)
        self._update_gaussian(v)
        if len(self._discrete_idx):
            self._margin_correction()

    @property
    def _ranges_of_ranks(self) -> list[float]:
        """Interquartile ranges of the ranks of the last generations, which are all the same."""
        quartiles = float(3 * self._population // 4 - self._population // 4)
        kept = 20 + math.ceil(3 * len(self._mean) / self._population)
        return [quartiles] * min(self._g, kept) if self._reals else []

    def _places(self, v: Floats) -> Floats:
        """Return the ranks of points, increased where they lie outside the bounds, shape (m,).

        Hansen et al. 2009, A method for handling uncertainty, https://doi.org/10.1109/tevc.2008.924423.
        """
        places, low, high = np.arange(len(v), dtype=np.float64), self._low, self._high
        inside = np.minimum(np.maximum(v, low), high)
        if (inside == v).all():
            return places
        size, variances = len(self._mean), np.diag(self._C) * self._A
        quartiles = self._population * 3 // 4 - self._population // 4
        gamma = np.ones(size) * 2 * quartiles / (self._sigma**2 * np.sum(variances))
        far = 3 * self._sigma * np.sqrt(variances) * max(1, np.sqrt(size) / self._mu_eff)
        below = (self._mean < low) & (np.abs(self._mean - low) > far)
        above = (high < self._mean) & (np.abs(high - self._mean) > far)
        gamma[below | above] *= 1.1 ** (max(1, self._mu_eff / (10 * size)))
        logs = np.log(variances)
        scales = np.exp(0.9 * (logs - np.sum(logs) / size))
        places += np.sum(gamma * ((inside - v) ** 2) / scales, axis=1)
        return places

    def _eigen_decomposition(self) -> tuple[Floats, Floats]:
        """Return eigenvectors, and roots of the eigenvalues, of the covariance matrix."""
        if self._B is None or self._D is None:
            values, self._B = np.linalg.eigh((self._C + self._C.T) / 2)
            self._D = np.sqrt(np.where(values < 0, _LEAST, values))
            self._C = np.multiply(self._B, self._D**2, order="C").dot(self._B.T)
        return self._B, self._D

    @property
    def middle(self) -> Floats:
        """The mean, shape (d,)."""
        middle: Floats = self._mean.copy()
        return middle

    def packed(self) -> Floats:
        """Return everything that changes between generations, without integers, as one vector."""
        sigma, history = [self._sigma, self._g], self._ranges_of_ranks
        axes: list[Any] = [self._B, self._D] if self._B is not None else []
        arrays = [self._mean, self._C, self._p_sigma, self._pc, self._A, *axes]
        return np.concatenate([[len(history)], history, sigma, *map(np.ravel, arrays)])

    def unpack(self, vector: Floats) -> None:
        """Continue from the vector that `packed` returned."""
        count, size = int(vector[0]), len(self._mean)
        self._sigma, self._g = float(vector[count + 1]), int(vector[count + 2])
        rest = vector[count + 3 :]
        for name, shape in _PACKED.items():
            if not len(rest):
                break
            length = size ** len(shape)
            setattr(self, name, rest[:length].reshape([size] * len(shape)).copy())
            rest = rest[length:]

    def _discretization(self, v_discrete: Floats) -> Floats:
        """Return the integers that values stand for, shape (n,) or (m, n) as given."""
        places = np.count_nonzero(v_discrete[..., None] > self._z_lim, axis=-1)
        values: Floats = self._z_space[np.arange(len(self._z_space)), places]
        return values

    def _integer_centering(self, v_raw: Floats) -> Floats:
        """Return points with integers centred, best first.

        The better half is moved: entries whose integer differs from the mean's onto that integer,
        and the others against the resulting bias. ``_int_succ`` records which integers mutated.
        """
        columns, better = self._discrete_idx, slice(self._mu)
        old = v_raw[better][:, columns]
        middle, whole = self._discretization(self._mean[columns]), self._discretization(old)
        mutated = whole != middle
        self._int_succ = mutated.any(axis=0)
        offsets = whole - old
        bias = np.where(mutated, offsets, 0.0).sum(axis=0)
        shares = np.zeros(len(columns))
        for sign in (1.0, -1.0):
            moves = np.where(~mutated & (sign * offsets > 0.0), offsets, 0.0).sum(axis=0)
            against = bias * moves < 0.0
            shares[against] = np.minimum(1.0, -bias[against] / moves[against])
        back = ~mutated & (bias * offsets < 0.0)
        v_raw[: self._mu, columns] = np.where(mutated, whole, old + back * shares * offsets)
        return v_raw

    def _update_gaussian(self, sv: Floats) -> None:
        """Update mean, paths, step size and covariance by points in order (tutorial, fig. 6)."""
        steps = ((sv - self._mean) / self._A + self._mean - self._mean) / self._sigma
        vectors, roots = self._eigen_decomposition()
        whiten = np.multiply(vectors, 1.0 / roots, order="C").dot(vectors.T)
        better = slice(self._mu)
        mean_step = np.sum(steps[better].T * self._weights[better], axis=1)
        self._mean += self._sigma * mean_step
        # Both paths and the step size; `goes_on` is 0 while the step size grows fast, else 1.
        rate = math.sqrt(self._c_sigma * (2 - self._c_sigma) * self._mu_eff)
        self._p_sigma = (1 - self._c_sigma) * self._p_sigma + rate * whiten.dot(mean_step)
        length = np.linalg.norm(self._p_sigma)
        self._sigma *= np.exp((self._c_sigma / self._d_sigma) * (length / self._chi_n - 1))
        self._sigma = min(self._sigma, _MOST)
        begun = math.sqrt(1 - (1 - self._c_sigma) ** (2 * (self._g + 1)))
        goes_on = float(length / begun < (1.4 + 2 / (len(self._mean) + 1)) * self._chi_n)
        pull = math.sqrt(self._cc * (2 - self._cc) * self._mu_eff)
        self._pc = (1 - self._cc) * self._pc + goes_on * pull * mean_step
        lengths = np.linalg.norm(whiten.dot(steps.T), axis=0) ** 2
        weights = self._weights * np.where(
            self._weights >= 0, 1, len(self._mean) / (lengths + _LEAST)
        )
        late = (1.0 - goes_on) * self._cc * (2 - self._cc)
        outer = steps[:, :, None] * steps[:, None, :]
        outer *= weights[:, None, None]
        decay = 1 + self._c1 * late - self._c1 - self._cmu * np.sum(self._weights)
        self._C = (
            decay * self._C
            + self._c1 * np.multiply.outer(self._pc, self._pc)
            + self._cmu * outer.sum(axis=0)
        )
        self._B = self._D = None
        _, roots = self._eigen_decomposition()
        self._sigma = max(self._sigma, np.sqrt(_LEAST_EIGENVALUE / np.min(roots)))

    def _margin_correction(self) -> None:
        """Keep the probability that each integer changes above the margin (its equations)."""
        place = self._discrete_idx
        middle, rows = self._mean[place], np.arange(len(self._z_lim))
        after = np.count_nonzero(self._z_lim < middle[:, None], axis=1)
        last = self._z_lim.shape[1] - 1
        low = self._z_lim[rows, np.clip(after - 1, 0, last)]
        high = self._z_lim[rows, np.clip(after, 0, last)]
        root = np.sqrt(np.diag(self._C)[place])
        scale = self._sigma * self._A[place] * root
        below = scipy.special.ndtr((low - middle) / scale)
        above = 1.0 - scipy.special.ndtr((high - middle) / scale)
        at_end = np.maximum(below, above) > 0.5
        if at_end.any():
            self._widen_at_end(at_end, np.minimum(below, above), high)
        if not at_end.all():
            self._widen_between(~at_end, (below, above), (low, high))

    def _widen_at_end(self, where: Any, rate: Floats, limit: Floats) -> None:  # noqa: ANN401
        """Correct integers whose mean lies at the smallest or largest value, at one limit."""
        place, spread = self._discrete_idx, np.diag(self._C)[self._discrete_idx]
        side = np.sign(self._mean[place] - limit)
        rate = np.maximum(rate, self._alpha)
        rate = np.where(self._int_succ, rate, np.minimum(rate, self._pmut))
        rate = np.clip(rate, _LEAST, 0.5 - _LEAST)
        away = np.abs(self._discretization(self._mean[place]) - limit)
        least = away / (self._sigma * np.sqrt(_square_of(1.0 - 2.0 * self._alpha) * spread))
        factor = self._A[place]
        self._A[place[where]] = np.maximum(factor[where], least[where])
        off = self._sigma * self._A[place] * np.sqrt(_square_of(1.0 - 2.0 * rate) * spread)
        shift = limit + side * off - self._mean[place]
        self._mean[place] = self._mean[place] + where * shift
        self._pmut[where] = rate[where]

    def _widen_between(
        self,
        where: Any,  # noqa: ANN401 - a mask
        chances: tuple[Floats, Floats],
        limits: tuple[Floats, Floats],
    ) -> None:
        """Correct integers whose mean lies between two limits: both neighbours stay likely."""
        place, hit, alpha = self._discrete_idx, self._int_succ, self._alpha
        below, above = chances
        between = 1.0 - (below + above)
        below, above = np.maximum(below, alpha / 2), np.maximum(above, alpha / 2)
        between = np.where(hit, between, np.maximum(between, 1 - self._pmut))
        lack, all_three = 1 - below - above - between, below + above + between
        lack /= np.where(hit, all_three - 3 * alpha / 2, all_three - alpha - (1 - self._pmut))
        below, above = below + lack * (below - alpha / 2), above + lack * (above - alpha / 2)
        below = np.clip(below, _LEAST, 0.5 - _LEAST)
        above = np.clip(above, _LEAST, 0.5 - _LEAST)
        one, two = (np.sqrt(_square_of(1.0 - 2 * chance)) for chance in (below, above))
        low, high = limits
        root = np.sqrt(np.diag(self._C))[place]
        factor = (high - low) / ((one + two) * self._sigma * root)
        self._A[place] = self._A[place] + where * (factor - self._A[place])
        middle = (low * two + high * one) / (one + two)
        self._mean[place] = self._mean[place] + where * (middle - self._mean[place])
        self._pmut[where] = below[where] + above[where]


def _square_of(chance: Any) -> Any:  # noqa: ANN401 - a number or an array
    """Return the quantile of the chi-square distribution with one degree of freedom."""
    return 2.0 * scipy.special.gammaincinv(0.5, chance)


_PACKED = {"_mean": "d", "_C": "dd", "_p_sigma": "d", "_pc": "d", "_A": "d", "_B": "dd", "_D": "d"}
"""Arrays of a distribution without integers, with a letter for each dimension."""


_STREAM = 1405
LEAST_POPULATION = 4
"""Fewer points give no covariance."""

# State that changes between generations; the random generator is created for each generation.
# _B and _D could be recomputed from _C, but not to the last bit.
_ARRAYS = {"_mean": float, "_C": float, "_B": float, "_D": float, "_p_sigma": float, "_pc": float}
_ARRAYS |= {"_A": float, "_pmut": float, "_int_succ": bool}


Spread = Annotated[
    float,
    Ge(1e-3),
    Le(1),
    Doc("standard deviation of the first points, as a share of each range"),
]


class CmaConfig(Table):
    """Parameters of CMA-ES."""

    spread: Spread = 0.2

    def start(self, axes: SearchAxes, population: int, seed: int) -> Optimizer:
        """Return the search before its first generation."""
        if population < LEAST_POPULATION:
            allowed = f"at least {LEAST_POPULATION} for the optimizer cmaes"
            raise BadInputError("optimizer.population", population, allowed)
        return Cma(self, axes, population, seed)


class Cma:
    """CMA-ES that learns from the ranks of the points it proposes.

    Notes
    -----
    The algorithm gets ranks instead of fitness: of the values themselves it uses only the spread,
    to weigh points outside the bounds, and penalties would inflate that.

    A distribution that runs away is replaced by the first one; the run's record keeps its best.

    An inactive coordinate is sampled like any other and selected by chance: its mean and spread
    stay the same in expectation until designs with that level are evaluated again.
    """

    def __init__(self, config: CmaConfig, axes: SearchAxes, population: int, seed: int) -> None:
        self._config, self._seed = config, seed
        self._population = population
        counts = np.array(axes.choices)
        self._real = np.flatnonzero(counts == 0)
        self._integer = np.flatnonzero(counts > 0)
        self._counts = counts
        self._search = self._new_search(config)
        self._generation = 0
        self._sampled: Floats | None = None

    def ask(self) -> Floats:
        """Return points sampled from the distribution, shape (m, d)."""
        reals, numbers = self._search.within(self._sampled_points())
        x = np.empty((self._population, len(self._counts)))
        x[:, self._real] = reals
        x[:, self._integer] = (numbers + 0.5) / self._counts[self._integer]
        return x

    def _sampled_points(self) -> Floats:
        """Return this generation's points as sampled."""
        if self._sampled is None:
            sequence = np.random.SeedSequence(self._seed, spawn_key=(_STREAM, self._generation))
            rng = np.random.RandomState(np.random.MT19937(sequence))
            self._sampled = self._search.sample(rng, self._population)
        return self._sampled

    def tell(self, x: Floats, fitness: Floats) -> None:  # noqa: ARG002 - points are kept as sampled
        """Update the distribution by the ranks of the points."""
        # Ties keep the order in which they were sampled.
        self._search.learn(self._sampled_points()[np.argsort(-fitness, kind="stable")])
        # Largest standard deviation, in ranges. Noise can let it grow without end: then all points
        # are clipped to the bounds, nothing is learned, and in the end numbers overflow.
        run_away = 1e3
        if not (self._search.spread / self._ranges).max() < run_away:
            self._search = self._new_search(self._config)
        self._sampled = None
        self._generation += 1

    def state(self) -> Mapping[str, object]:
        """Return the distribution; nothing before the first generation."""
        if self._generation == 0:
            return {"generation": 0}
        state: dict[str, object] = {"generation": self._generation}
        known = vars(self._search)
        arrays = [name for name in _ARRAYS if known.get(name) is not None]
        state |= {name: np.array(known[name], dtype=float) for name in arrays}
        numbers = {"_sigma": float(self._search._sigma), "_g": self._search._g}
        return state | numbers | {"_iqhist_values": self._search._ranges_of_ranks}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from a state."""
        self._generation = state["generation"]
        self._sampled = None
        for name, value in state.items():
            if name in _ARRAYS:
                setattr(self._search, name, np.array(value, dtype=_ARRAYS[name]))
            elif name in ("_sigma", "_g"):
                setattr(self._search, name, value)

    @property
    def _ranges(self) -> Floats:
        """Range of each coordinate of the distribution."""
        whole = self._counts[self._integer].astype(np.float64)
        return np.concatenate([np.ones(len(self._real)), whole])

    def _new_search(self, config: CmaConfig) -> Distribution:
        whole = self._counts[self._integer]
        middles = np.concatenate([np.full(len(self._real), 0.5), (whole - 1.0) / 2.0])
        return Distribution(
            middles,
            config.spread * self._ranges,
            population=self._population,
            counts=whole.tolist(),
        )
