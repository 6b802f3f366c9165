"""The shape of least energy of an inflated sheet, by Newton's method.

The relaxed film is convex in the Green strain, so only the gas makes the Hessian indefinite. A
shift makes it definite again; it shrinks as the steps come out as predicted.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load at their first use

from vinefab.core.errors import VinefabError
from vinefab.core.validation import Floats
from vinefab.inflation.membrane import Membrane

TOLERANCE = 1e-8
"""Largest force on a corner at rest, over p W^2."""

MOST_STEPS = 120

Tell = Callable[[float, str], None]
"""Takes the progress of a computation: a share of 0 to 1, and words."""

_FIRST_SHIFT = 0.3
_LEAST_SHIFT = 1e-3
_LONGEST_STEP = 0.5  # widths that a corner moves in one step
_SOFTER = (16.0, 4.0, 1.0)  # strains, over the one asked for, where the plain way stalls


class NotConvergedError(VinefabError, ArithmeticError):
    """The simulation of an inflated sheet found no equilibrium."""

    def __init__(self, residual: float, steps: int) -> None:
        self.residual = residual
        self.steps = steps
        super().__init__(residual, steps)

    def __str__(self) -> str:
        return (
            f"inflation did not converge: after {self.steps} steps forces of "
            f"{self.residual:.2g} p W^2 are left, {TOLERANCE:g} are allowed"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Equilibrium:
    """A sheet at rest under pressure, at a minimum of its energy."""

    positions: Floats  # corners in space, in widths, shape (n, 3)
    energy: float  # over p W^3
    residual: float  # largest force on a free coordinate, over p W^2
    steps: int  # Newton steps taken
    stiffness: "Factor"  # the Hessian there, positive definite


class Factor:
    """A factorized symmetric matrix."""

    def __init__(self, matrix: "scipy.sparse.csc_array", order: "_Order") -> None:
        self._order = order
        permuted = order.permuted(matrix)
        self._lu: scipy.sparse.linalg.SuperLU = scipy.sparse.linalg.splu(
            permuted,
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True, "Equil": False},
        )

    def solve(self, right: Floats) -> Floats:
        """Return the solution for a right-hand side, shape (k,)."""
        solved: Floats = self._lu.solve(right[self._order.rows])[self._order.back]
        return solved

    @property
    def is_definite(self) -> bool:
        """Whether all pivots are positive and none was moved off the diagonal."""
        on_diagonal = np.array_equal(self._lu.perm_r, np.arange(len(self._lu.perm_r)))
        return on_diagonal and bool((self._lu.U.diagonal() > 0.0).all())


class _Order:
    """An elimination order, found once for all matrices of one pattern."""

    def __init__(self, matrix: "scipy.sparse.csc_array") -> None:
        count = matrix.shape[0]
        # SuperLU tells its order of minimum degree with its factors alone; values are all the same
        # to that order, and a heavy diagonal keeps the pivots on it.
        plain = scipy.sparse.csc_array(
            (np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape
        )
        found = scipy.sparse.linalg.splu(
            scipy.sparse.csc_array(
                plain + scipy.sparse.diags_array(np.full(count, 1e3), format="csc")
            ),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True, "Equil": False},
        )
        self.back = found.perm_c.astype(np.int64)
        self.rows = np.argsort(self.back)
        number = scipy.sparse.csc_array(
            (np.arange(1.0, matrix.nnz + 1.0), matrix.indices, matrix.indptr), shape=matrix.shape
        )
        moved = scipy.sparse.csc_array(number[self.rows][:, self.rows])
        moved.sort_indices()
        self._entries = moved.data.astype(np.int64) - 1
        self._indices, self._pointers = moved.indices, moved.indptr

    def permuted(self, matrix: "scipy.sparse.csc_array") -> "scipy.sparse.csc_array":
        parts = (matrix.data[self._entries], self._indices, self._pointers)
        return scipy.sparse.csc_array(parts, shape=matrix.shape)


def at_rest(
    membrane: Membrane,
    start: Floats,
    *,
    tell: Tell | None = None,
    most_steps: int = MOST_STEPS,
) -> Equilibrium:
    """Return the equilibrium that a sheet comes to from a start.

    Parameters
    ----------
    membrane
        The sheet and its pressure.
    start
        Corners in space, in widths, shape (n, 3); not flat, as a flat sheet stays flat.
    tell
        Called before every step.
    most_steps
        Newton steps before softer film is tried first, and again before that fails.

    Raises
    ------
    NotConvergedError
        If no equilibrium is found.
    """
    tell = tell or _tell_nobody
    order = _Order(membrane.hessian(start))
    try:
        return _minimum(membrane, start, order, (tell, most_steps))
    except NotConvergedError as stalled:
        steps, positions = stalled.steps, start
    usual = membrane.stiffness
    try:
        for softer in _SOFTER:
            membrane.stiffness = usual / softer
            found = _minimum(membrane, positions, order, (tell, most_steps), steps)
            positions, steps = found.positions, found.steps
    finally:
        membrane.stiffness = usual
    return found


def _tell_nobody(_share: float, _words: str) -> None:
    pass


def _minimum(
    membrane: Membrane, start: Floats, order: _Order, way: tuple[Tell, int], before: int = 0
) -> Equilibrium:
    tell, most_steps = way
    positions, energy = start, membrane.energy(start)
    weight, free = _corner_areas(membrane), membrane.free
    shift = _FIRST_SHIFT
    gradient = membrane.gradient(positions)
    for step in range(before, before + most_steps):
        residual = float(np.abs(gradient).max())
        tell(_share(residual), f"Newton step {step}, largest force {residual:.1e} p W^2")
        matrix = membrane.hessian(positions)
        if residual <= TOLERANCE:
            factor = Factor(matrix, order)
            if factor.is_definite:
                return Equilibrium(
                    positions=positions,
                    energy=energy,
                    residual=residual,
                    steps=step,
                    stiffness=factor,
                )
            # A saddle: leave it along a direction of no symmetry.
            shift = max(shift, _LEAST_SHIFT)
            aside: Floats = np.cos(np.linspace(0.0, len(gradient), len(gradient)))
            gradient = gradient + 1e-5 * aside
        move, shift = _descent(membrane, matrix, gradient, (weight, shift, order))
        slope = float(gradient @ move)
        share = min(1.0, _LONGEST_STEP / float(np.abs(move).max()))
        while True:
            tried = positions.copy()
            tried[free] += share * move
            tried_energy = membrane.energy(tried)
            # Near the end, differences of energies drown in their rounding.
            if tried_energy <= energy + 1e-4 * share * slope + 1e-13 * (1.0 + abs(energy)):
                break
            share /= 2.0
            if share < 1e-9:
                raise NotConvergedError(residual, step)
        bent = float(move @ (matrix @ move))
        predicted = share * slope + 0.5 * share**2 * bent
        as_predicted = tried_energy - energy <= 0.5 * predicted or predicted > -1e-12
        if share == 1.0 and as_predicted:
            shift = shift / 8.0 if shift > 1e-7 else 0.0
        elif share < 0.5:
            shift = max(4.0 * shift, _LEAST_SHIFT)
        positions, energy = tried, tried_energy
        gradient = membrane.gradient(positions)
    raise NotConvergedError(float(np.abs(gradient).max()), before + most_steps)


def _share(residual: float) -> float:
    """Return the share of the way done, by the digits of the residual."""
    done = -math.log10(max(residual, TOLERANCE)) / -math.log10(TOLERANCE)
    return min(max(done, 0.0), 1.0)


def _corner_areas(membrane: Membrane) -> Floats:
    """Return the flat area around the corner of each free coordinate, shape (k,)."""
    corners = membrane.triangles.ravel()
    weights = np.repeat(membrane.area, 3) / 3.0
    area = np.asarray(np.bincount(corners, weights, len(membrane.points)), dtype=np.float64)
    spread: Floats = np.repeat(area, 3).reshape(-1, 3)[membrane.free]
    return spread


def _descent(
    membrane: Membrane,
    matrix: "scipy.sparse.csc_array",
    gradient: Floats,
    how: tuple[Floats, float, _Order],
) -> tuple[Floats, float]:
    """Return a direction downhill and the shift that it took."""
    weight, shift, order = how
    diagonal = membrane.scatter.diagonal
    while True:
        shifted = matrix.copy()
        shifted.data[diagonal] += shift * weight
        try:
            factor = Factor(shifted, order)
            move = -factor.solve(gradient)
            # Pivots are the proof, but their list costs as much as the factors; where the last
            # step went as predicted without a shift, downhill and bent upward is enough.
            bent = float(move @ (shifted @ move))
            if bent > 0.0 and (shift == 0.0 or factor.is_definite):
                return move, shift
        except RuntimeError:  # exactly singular
            pass
        shift = max(4.0 * shift, _LEAST_SHIFT)
        if shift > 1e9:
            raise NotConvergedError(float(np.abs(gradient).max()), 0)
