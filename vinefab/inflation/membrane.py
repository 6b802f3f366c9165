"""The energy of an inflated sheet, its exact gradient and Hessian, and the shape of least energy.

A robot is two equal sheets welded along its outline. It is symmetric about the plane of the weld,
so the upper sheet alone is computed: flat triangles of a membrane without bending stiffness, over
the plane z = 0, with the gas between the sheet and that plane.

Lengths are in widths of the trunk's flat tube and pressures in the gauge pressure: one number of
the material is left, the hoop strain p W / (pi E t).
"""

import math
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import cast

import numpy as np
import scipy  # its parts load at their first use
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError, VinefabError
from vinefab.core.progress import Progress, announce
from vinefab.core.validation import Floats, Ints

POISSON = 0.45
"""Poisson's ratio of the film (assumed)."""

Bools = NDArray[np.bool_]


class Membrane:
    """An upper sheet under pressure.

    Parameters
    ----------
    points
        Corners of the triangles on the flat sheet, in widths, shape (n, 2).
    triangles
        Corners of each triangle, counter-clockwise as seen from outside, shape (m, 3): clockwise on
        the flat sheet for those of a lower sheet.
    free
        Which coordinates of the corners may move, shape (n, 3). Corners on the seam keep z.
    hoop_strain
        p W / (pi E t) of a tube of width 1.
    poisson
        Poisson's ratio.

    Notes
    -----
    Film law: St. Venant and Kirchhoff, plane stress, relaxed by tension-field theory. With the
    principal Green strains e1 >= e2 a triangle is taut if e2 + nu e1 > 0, slack if e1 <= 0, else
    wrinkled with the energy E e1^2 / 2 per volume. The gas gives its dead pressure times the volume
    between sheet and plane; a sheet whose free edge lies in an upright plane is closed by it.
    """

    def __init__(
        self,
        points: Floats,
        triangles: Ints,
        free: Bools,
        *,
        hoop_strain: float,
        poisson: float = POISSON,
    ) -> None:
        if not 0.0 < hoop_strain < math.inf:
            raise BadInputError("hoop_strain", hoop_strain, "a number above 0")
        self.points, self.triangles, self.free = points, triangles, free
        self.stiffness = 1.0 / (math.pi * hoop_strain)  # E t, over p W
        self.poisson = poisson
        corners = points[triangles]
        (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        double = ax * by - ay * bx
        self.area = np.abs(double) / 2.0
        # Gradients of the second and third corner's shape functions; the first has minus their sum.
        self._g1 = np.stack([by, -bx]) / double
        self._g2 = np.stack([-ay, ax]) / double
        self.unknowns = int(np.count_nonzero(free))
        number = np.full(free.shape, -1, dtype=np.int64)
        number[free] = np.arange(self.unknowns)
        self._number = number
        self._scatter: _Scatter | None = None

    @property
    def scatter(self) -> "_Scatter":
        """Where the triangles' entries stand in the sparse Hessian."""
        if self._scatter is None:
            self._scatter = _Scatter(self._number[self.triangles].reshape(-1, 9), self.unknowns)
        return self._scatter

    def energy(self, positions: Floats) -> float:
        """Return the energy of the film less the work of the gas, over p W^3.

        Parameters
        ----------
        positions
            Corners in space, shape (n, 3).
        """
        x, nu = self._corners(positions), self.poisson
        first, second, _ = _principal(self._strain(*self._stretch(x)))
        taut = (first**2 + second**2 + 2.0 * nu * first * second) / (2.0 * (1.0 - nu**2))
        wrinkled = np.maximum(first, 0.0) ** 2 / 2.0
        density = np.where((second + nu * first > 0.0) & (first > 0.0), taut, wrinkled)
        return float(self.area @ density) * self.stiffness - _volume(x)

    def volume(self, positions: Floats) -> float:
        """Return the volume between the upper sheet and the plane of the seam, over W^3."""
        return _volume(self._corners(positions))

    def gradient(self, positions: Floats) -> Floats:
        """Return the derivative of the energy with respect to the free coordinates, shape (k,)."""
        return self.forces(positions)[self.free]

    def forces(self, positions: Floats) -> Floats:
        """Return the derivative of the energy with respect to all coordinates, shape (n, 3).

        At a fixed coordinate of a solution it is the force that holds it.
        """
        x = self._corners(positions)
        f1, f2 = self._stretch(x)
        xx, yy, xy = self._stress(f1, f2)
        along, across = xx * f1 + xy * f2, xy * f1 + yy * f2
        second = along * self._g1[0] + across * self._g1[1]
        third = along * self._g2[0] + across * self._g2[1]
        gradient = np.stack([-second - third, second, third]) - _volume_gradient(x)
        flat = self.triangles.T
        total = np.empty((len(positions), 3))
        for axis in range(3):
            total[:, axis] = np.bincount(
                flat.ravel(), gradient[:, axis].ravel(), minlength=len(positions)
            )
        return total

    def hessian(self, positions: Floats) -> "scipy.sparse.csc_array":
        """Return the second derivatives by the free coordinates, symmetric, shape (k, k)."""
        x = self._corners(positions)
        f1, f2 = self._stretch(x)
        weight = self.area * self.stiffness
        stress, moduli = _moduli(self._strain(f1, f2), self.poisson)
        upper = _film_curvature(f1, f2, (self._g1, self._g2), stress * weight, moduli * weight)
        return self.scatter.matrix(_less_volume(upper, x))

    def states(self, positions: Floats) -> Ints:
        """Return the state of each triangle, shape (m,): 0 slack, 1 wrinkled, 2 taut."""
        first, second, _ = _principal(self._strain(*self._stretch(self._corners(positions))))
        taut = second + self.poisson * first > 0.0
        return np.where(first <= 0.0, 0, np.where(taut, 2, 1))

    def stresses(self, positions: Floats) -> Floats:
        """Return the membrane forces over p W in the flat sheet's axes, shape (3, m): xx, yy, xy.

        Second Piola-Kirchhoff stress times thickness: force per length of the flat sheet, to first
        order in the strain.
        """
        stresses: Floats = self._stress(*self._stretch(self._corners(positions))) / self.area
        return stresses

    def _corners(self, positions: Floats) -> Floats:
        """Return the corners' coordinates, shape (3, 3, m): corner, coordinate, triangle."""
        flat = positions.T[:, self.triangles.T]
        return np.ascontiguousarray(flat.transpose(1, 0, 2))

    def _stretch(self, x: Floats) -> tuple[Floats, Floats]:
        """Return the two columns of the deformation gradient, shape (3, m) each."""
        a, b = x[1] - x[0], x[2] - x[0]
        return a * self._g1[0] + b * self._g2[0], a * self._g1[1] + b * self._g2[1]

    def _strain(self, f1: Floats, f2: Floats) -> Floats:
        """Return the Green strain, shape (3, m): xx, yy, xy."""
        strain: Floats = np.stack(
            [(f1 * f1).sum(0) - 1.0, (f2 * f2).sum(0) - 1.0, (f1 * f2).sum(0)]
        )
        return 0.5 * strain

    def _stress(self, f1: Floats, f2: Floats) -> Floats:
        weight: Floats = self.area * self.stiffness
        stress: Floats = _stress(self._strain(f1, f2), self.poisson) * weight
        return stress


# --- The film law ---------------------------------------------------------------------------------


def _principal(strain: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the principal strains, the larger first, and half their difference."""
    xx, yy, xy = strain
    middle, radius = (xx + yy) / 2.0, np.hypot((xx - yy) / 2.0, xy)
    return middle + radius, middle - radius, radius


def _stress(strain: Floats, nu: float) -> Floats:
    """Return the derivative of the energy density by the strains xx, yy and 2 xy, shape (3, m)."""
    xx, yy, xy = strain
    first, second, radius = _principal(strain)
    taut = (second + nu * first > 0.0) & (first > 0.0)
    wrinkled = ~taut & (first > 0.0)
    plane = 1.0 / (1.0 - nu**2)
    pull, safe = np.where(wrinkled, first, 0.0), np.where(wrinkled, radius, 1.0)
    cos, sin = (xx - yy) / (2.0 * safe), xy / safe
    return np.stack(
        [
            np.where(taut, plane * (xx + nu * yy), pull * (1.0 + cos) / 2.0),
            np.where(taut, plane * (yy + nu * xx), pull * (1.0 - cos) / 2.0),
            np.where(taut, plane * (1.0 - nu) * xy, pull * sin / 2.0),
        ]
    )


def _moduli(strain: Floats, nu: float) -> tuple[Floats, Floats]:
    """Return stresses, and their derivatives by xx, yy and 2 xy: entries 00 01 02 11 12 22.

    Wrinkled film pulls along the larger principal direction n alone. It resists stretch along n,
    and turning of n by the energy's second derivative 2 e1 / (e1 - e2) (n dE m)^2.
    """
    xx, yy, xy = strain
    first, second, radius = _principal(strain)
    taut = (second + nu * first > 0.0) & (first > 0.0)
    wrinkled = ~taut & (first > 0.0)
    safe = np.where(wrinkled, radius, 1.0)
    cos, sin = np.where(wrinkled, (xx - yy) / (2.0 * safe), 0.0), np.where(wrinkled, xy / safe, 0.0)
    a0, a1, a2 = (1.0 + cos) / 2.0, (1.0 - cos) / 2.0, sin / 2.0
    b1, b2 = sin / 2.0, cos / 2.0  # b0 = -b1
    one, turn = wrinkled.astype(float), np.where(wrinkled, first / safe, 0.0)
    plane = np.where(taut, 1.0 / (1.0 - nu**2), 0.0)
    moduli = np.stack(
        [
            plane + one * a0 * a0 + turn * b1 * b1,
            nu * plane + one * a0 * a1 - turn * b1 * b1,
            one * a0 * a2 - turn * b1 * b2,
            plane + one * a1 * a1 + turn * b1 * b1,
            one * a1 * a2 + turn * b1 * b2,
            (1.0 - nu) / 2.0 * plane + one * a2 * a2 + turn * b2 * b2,
        ]
    )
    pull = one * first
    stress = np.stack(
        [
            plane * (xx + nu * yy) + pull * a0,
            plane * (yy + nu * xx) + pull * a1,
            plane * (1.0 - nu) * xy + pull * a2,
        ]
    )
    return stress, moduli


_PLACE = {entry: place for place, entry in enumerate(combinations_with_replacement(range(9), 2))}
"""Where an entry of a triangle's matrix stands among those on and above the diagonal."""


def _film_curvature(
    f1: Floats, f2: Floats, gradients: tuple[Floats, Floats], stress: Floats, moduli: Floats
) -> Floats:
    """Return the entries of each triangle's matrix of second derivatives, shape (45, m)."""
    c00, c01, c02, c11, c12, c22 = moduli
    outer11 = f1[:, None] * f1[None]
    outer12 = f1[:, None] * f2[None]
    outer22 = f2[:, None] * f2[None]
    blocks = []
    for one, two in ((0, 0), (0, 1), (1, 1)):
        (p, q), (r, s) = gradients[one], gradients[two]
        # Strains xx, yy, 2 xy of the first corner: p f1, q f2, p f2 + q f1; of the second alike.
        ff = p * (c00 * r + c02 * s) + q * (c02 * r + c22 * s)
        fg = p * (c01 * s + c02 * r) + q * (c12 * s + c22 * r)
        gf = q * (c01 * r + c12 * s) + p * (c02 * r + c22 * s)
        gg = q * (c11 * s + c12 * r) + p * (c12 * s + c22 * r)
        block = ff * outer11 + fg * outer12 + gf * outer12.transpose(1, 0, 2) + gg * outer22
        tension = stress[0] * p * r + stress[1] * q * s + stress[2] * (p * s + q * r)
        for axis in range(3):
            block[axis, axis] += tension
        blocks.append(block)
    # Moving all corners alike changes nothing.
    b11, b12, b22 = blocks
    b01, b02 = -b11 - b12.transpose(1, 0, 2), -b12 - b22
    b00 = -b01.transpose(1, 0, 2) - b02.transpose(1, 0, 2)
    found = {(0, 0): b00, (0, 1): b01, (0, 2): b02, (1, 1): b11, (1, 2): b12, (2, 2): b22}
    upper = np.empty((45, b11.shape[2]))
    for (row, column), place in _PLACE.items():
        upper[place] = found[row // 3, column // 3][row % 3, column % 3]
    return upper


# --- The volume -----------------------------------------------------------------------------------


def _volume(x: Floats) -> float:
    """Return the signed volume between triangles and the plane z = 0."""
    a, b = x[1, :2] - x[0, :2], x[2, :2] - x[0, :2]
    return float((a[0] * b[1] - a[1] * b[0]) @ x[:, 2].sum(0)) / 6.0


def _volume_gradient(x: Floats) -> Floats:
    height = x[:, 2].sum(0) / 6.0
    a, b = x[1, :2] - x[0, :2], x[2, :2] - x[0, :2]
    base = (a[0] * b[1] - a[1] * b[0]) / 6.0
    gradient = np.empty_like(x)
    for corner in range(3):
        following, before = x[(corner + 1) % 3], x[(corner + 2) % 3]
        gradient[corner, 0] = height * (following[1] - before[1])
        gradient[corner, 1] = height * (before[0] - following[0])
        gradient[corner, 2] = base
    return gradient


def _less_volume(upper: Floats, x: Floats) -> Floats:
    """Subtract the second derivatives of the volume from the entries of the film."""
    height = x[:, 2].sum(0) / 6.0
    for corner in range(3):
        following, before = (corner + 1) % 3, (corner + 2) % 3
        across_x = (x[following, 1] - x[before, 1]) / 6.0
        across_y = (x[before, 0] - x[following, 0]) / 6.0
        for other in range(3):
            for axis, rate in ((0, across_x), (1, across_y)):
                row, column = sorted((3 * corner + axis, 3 * other + 2))
                upper[_PLACE[row, column]] -= rate
        for other, sign in ((following, 1.0), (before, -1.0)):
            row, column = sorted((3 * corner, 3 * other + 1))
            upper[_PLACE[row, column]] -= sign * height
    return upper


class _Scatter:
    """Sums the entries of triangles into one sparse symmetric matrix."""

    def __init__(self, numbers: Ints, unknowns: int) -> None:
        rows, columns, entries = [], [], []
        count = len(numbers)
        for (row, column), place in _PLACE.items():
            one, two = numbers[:, row], numbers[:, column]
            kept = np.flatnonzero((one >= 0) & (two >= 0))
            # Lower triangle of the whole: column <= row.
            rows.append(np.maximum(one, two)[kept])
            columns.append(np.minimum(one, two)[kept])
            entries.append(place * count + kept)
        keys = np.concatenate(columns) * unknowns + np.concatenate(rows)
        lower, inverse = np.unique(keys, return_inverse=True)
        entry = np.concatenate(entries)
        order = np.argsort(inverse, kind="stable")
        starts = np.concatenate([[0], np.cumsum(np.bincount(inverse, minlength=len(lower)))])
        self._sum = scipy.sparse.csr_array(
            (np.ones(len(entry)), entry[order], starts), shape=(len(lower), 45 * count)
        )
        low_column, low_row = lower // unknowns, lower % unknowns
        off = np.flatnonzero(low_row != low_column)
        full_rows = np.concatenate([low_row, low_column[off]])
        full_columns = np.concatenate([low_column, low_row[off]])
        source = np.concatenate([np.arange(len(lower)), off])
        order = np.lexsort((full_rows, full_columns))
        self._source = source[order]
        self._indices = full_rows[order].astype(np.int32)
        bounds = np.cumsum(np.bincount(full_columns, minlength=unknowns))
        self._pointers = np.concatenate([[0], bounds]).astype(np.int32)
        self._unknowns = unknowns
        self.diagonal = np.flatnonzero(full_rows[order] == full_columns[order])

    def matrix(self, upper: Floats) -> "scipy.sparse.csc_array":
        """Return the sum of the triangles' matrices."""
        values = cast("Floats", self._sum @ upper.ravel())[self._source]
        shape = (self._unknowns, self._unknowns)
        return scipy.sparse.csc_array((values, self._indices, self._pointers), shape=shape)


TOLERANCE = 1e-8
"""Largest force on a corner at rest, over p W^2."""

MOST_STEPS = 120

_LEAST_SHIFT = 1e-3
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
        self._matrix, self._order = matrix, order
        permuted = order.permuted(matrix)
        self._lu: scipy.sparse.linalg.SuperLU = scipy.sparse.linalg.splu(
            permuted,
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True, "Equil": False},
        )

    def __reduce__(self) -> tuple[type, tuple[object, object]]:
        return type(self), (self._matrix, self._order)  # factors of SuperLU cannot be pickled

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
        # SuperLU tells its order of minimum degree with factors alone, here with incomplete ones:
        # values are all the same to that order, and a heavy diagonal keeps the pivots on it.
        plain = scipy.sparse.csc_array(
            (np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape
        )
        found = scipy.sparse.linalg.spilu(
            scipy.sparse.csc_array(
                plain + scipy.sparse.diags_array(np.full(count, 1e3), format="csc")
            ),
            drop_tol=1.0,
            fill_factor=1.0,
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
    most_steps: int = MOST_STEPS,
) -> Equilibrium:
    """Return the equilibrium that a sheet comes to from a start.

    Parameters
    ----------
    membrane
        The sheet and its pressure.
    start
        Corners in space, in widths, shape (n, 3); not flat, as a flat sheet stays flat.
    most_steps
        Newton steps before softer film is tried first, and again before that fails.

    Raises
    ------
    NotConvergedError
        If no equilibrium is found.
    """
    order = _Order(membrane.hessian(start))
    try:
        return _minimum(membrane, start, order, most_steps)
    except NotConvergedError as stalled:
        steps, positions = stalled.steps, start
    usual = membrane.stiffness
    try:
        for softer in _SOFTER:
            membrane.stiffness = usual / softer
            found = _minimum(membrane, positions, order, most_steps, steps)
            positions, steps = found.positions, found.steps
    finally:
        membrane.stiffness = usual
    return found


def _minimum(
    membrane: Membrane, start: Floats, order: _Order, most_steps: int, before: int = 0
) -> Equilibrium:
    positions, energy = start, membrane.energy(start)
    free, corners = membrane.free, membrane.triangles.ravel()
    # The flat area around the corner of each free coordinate.
    area = np.bincount(corners, np.repeat(membrane.area, 3) / 3.0, len(membrane.points))
    weight = np.asarray(np.repeat(area, 3).reshape(-1, 3)[free], dtype=np.float64)
    first_shift = 0.3
    shift = first_shift
    gradient = membrane.gradient(positions)
    longest_step = 0.5  # widths that a corner moves in one step
    for step in range(before, before + most_steps):
        residual = float(np.abs(gradient).max())
        words = f"largest force {residual:.1e} p W^2, {TOLERANCE:.0e} is rest"
        announce(Progress(phase="Newton steps", done=step, words=words))
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
        share = min(1.0, longest_step / float(np.abs(move).max()))
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
