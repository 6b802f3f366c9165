"""Even fans from a table: what simulated joints tell about those between them.

The table ships as simulated rows (``joints.npz``, made by ``tests/inflation/make_table.py``).
Gaussian processes run through them: they smooth what differs from mesh to mesh, use the simulated
slopes, and tell where rows are too few to be trusted.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import scipy  # its parts load at their first use

from vinefab.core.hashing import fingerprint
from vinefab.core.validation import Floats, Ints
from vinefab.inflation import joint as joint_module
from vinefab.inflation import membrane, mesh
from vinefab.inflation.membrane import Bools

MODEL = 1
"""To be raised with every change of the simulation that moves results and no constant."""

PATH = Path(__file__).with_name("joints.npz")

CHILDREN = (1, 2, 3, 4, 5)

RATIO, FILLET, STRAIN = (0.3, 1.0), (0.04, 0.5), (0.002, 0.3)
"""Ranges of the table: child over parent width, fillet over parent width, hoop strain."""

LEAST_GAP_DEG = 2.0
"""Siblings that deploy nearer to each other are not in the table."""

TRUSTED_DEG = 0.6
"""Largest standard deviation of an angle from the table, by the distance to its rows."""


NARROW_DEG, NARROW_RATIO = 34.0, 0.45
"""So are two or three that are narrower, where they deploy nearer to each other."""

_BLOCK = 512  # joints at a time


def simulation_fingerprint() -> str:
    """Return 12 digits that change with the simulation of joints."""
    return fingerprint(
        MODEL,
        joint_module.ACROSS,
        joint_module.TRUNK_STUB,
        joint_module.CHILD_STUB,
        mesh.LENGTHENED,
        mesh.FILLET_STEP_RAD,
        mesh.FINEST,
        mesh.GRADE,
        mesh.FINER,
        mesh.LOAD_LENGTH,
        membrane.TOLERANCE,
        membrane.POISSON,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class JointRows:
    """Simulated fans of so many children; of mirror images only the left, outermost first."""

    children: int
    places: Floats  # width ratio, fillet, strain, shape (n, 3)
    cut_deg: Floats  # flat angles as simulated, shape (n, children // 2)
    deployed_deg: Floats
    # Pull-backs ((children + 1) // 2), side offsets (children // 2), logarithms of sensitivity and
    # of crotch load, passage.
    figures: Floats

    @classmethod
    def of(cls, children: int, table: Floats) -> "JointRows":
        """Return the rows of a table's array."""
        half = children // 2
        parts = np.split(table.astype(np.float64), np.cumsum([3, half, half]), axis=1)
        return cls(
            children=children,
            places=parts[0],
            cut_deg=parts[1],
            deployed_deg=parts[2],
            figures=parts[3],
        )

    @property
    def even(self) -> Floats:
        """Shares of the whole fan at which children of an even one lie, shape (children // 2,)."""
        return np.linspace(0.5, -0.5, self.children)[: self.children // 2]

    @property
    def deployment(self) -> "tuple[Floats, Floats]":
        """Places of evenly cut fans, and by how much more their children turn as they deploy."""
        kept = self.is_cut_even
        fan = 2.0 * self.cut_deg[:, 0] if self.children > 1 else np.zeros(len(self.places))
        even = fan[:, None] * self.even
        return scaled(fan, self.places)[kept], (self.deployed_deg - even)[kept]

    @property
    def compensation(self) -> "tuple[Floats, Floats]":
        """Places of evenly deployed fans, and by how much more their flat children are turned."""
        fan = self.deployed_fan_deg
        kept = self.is_open
        even = fan[:, None] * self.even
        return scaled(fan, self.places)[kept], (self.flat_deg - even)[kept]

    @property
    def deployed_fan_deg(self) -> Floats:
        """Angle between the outer children under pressure, shape (n,)."""
        return 2.0 * self.deployed_deg[:, 0] if self.children > 1 else np.zeros(len(self.places))

    @property
    def unevenness_deg(self) -> Floats:
        """By how much inner children deploy short of an even fan, shape (n, children // 2)."""
        return self.deployed_fan_deg[:, None] * self.even - self.deployed_deg

    @property
    def flat_deg(self) -> Floats:
        """Flat angles of fans that deploy evenly, their outer children as those simulated."""
        evened = 0.65  # flat over deployed turn of an inner child, where a fan is nearly even
        return self.cut_deg + evened * self.unevenness_deg

    @property
    def is_open(self) -> Bools:
        """Whether flat angles follow from deployed ones: siblings deploy apart, nearly evenly."""
        if self.children == 1:
            return np.ones(len(self.places), dtype=np.bool_)
        apart = self.deployed_fan_deg / (self.children - 1) > LEAST_GAP_DEG
        most_uneven_deg = 1.5
        is_near = np.abs(self.unevenness_deg).max(axis=1) < most_uneven_deg
        return np.asarray(apart & is_near, dtype=np.bool_)

    @property
    def is_cut_even(self) -> Bools:
        """Whether flat angles are even, shape (n,)."""
        off = np.abs(self.cut_deg - 2.0 * self.cut_deg[:, :1] * self.even)
        return np.asarray(off.max(axis=1, initial=0.0) < 0.01, dtype=np.bool_)


def scaled(fan_deg: Floats, places: Floats) -> Floats:
    """Return coordinates in which joints change evenly: fan, ratio, fillet, strain."""
    ratio, fillet, strain = np.maximum(places, 1e-6).T
    return np.column_stack([fan_deg / 100.0, ratio, np.log(fillet) / 2.5, np.log(strain) / 5.0])


# --- Gaussian process -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Scales:
    """How fast a quantity changes along each coordinate, and how far its rows scatter."""

    lengths: Floats  # shape (4,)
    noise: float  # over the amplitude


class Process:
    """A smooth function of four coordinates through scattered rows, of several quantities."""

    def __init__(self, x: Floats, y: Floats, scales: Scales) -> None:
        self._x, self._lengths = x / scales.lengths, scales.lengths
        self._coefficients = np.linalg.lstsq(_trend(x), y, rcond=None)[0]
        rest = y - _trend(x) @ self._coefficients
        self.amplitude: Floats = np.sqrt((rest**2).mean(axis=0)) + 1e-9
        self.factor = scipy.linalg.cholesky(
            self._near(x) + scales.noise**2 * np.eye(len(x)), lower=True, check_finite=False
        )
        self.weights = scipy.linalg.cho_solve((self.factor, True), rest)

    def __call__(self, x: Floats) -> Floats:
        """Return the quantities at some places, shape (m, quantities)."""
        found = _trend(x) @ self._coefficients
        for k in range(0, len(x), _BLOCK):
            found[k : k + _BLOCK] += self._near(x[k : k + _BLOCK]) @ self.weights
        return np.asarray(found, dtype=np.float64)

    def _near(self, x: Floats) -> Floats:
        """Return the covariances with the rows: Matern 5/2."""
        scaled_x = x / self._lengths
        square = (scaled_x**2).sum(axis=1)[:, None] + (self._x**2).sum(axis=1)
        s = np.sqrt(5.0 * np.maximum(square - 2.0 * scaled_x @ self._x.T, 0.0))
        near: Floats = (1.0 + s + s * s / 3.0) * np.exp(-s)
        return near

    def deviation(self, x: Floats) -> Floats:
        """Return the standard deviation of the quantities from the rows alone, noise left out."""
        known = scipy.linalg.solve_triangular(self.factor, self._near(x).T, lower=True)
        share = np.sqrt(np.maximum(0.0, 1.0 - (known**2).sum(axis=0)))
        spread: Floats = share[:, None] * self.amplitude
        return spread


def _trend(x: Floats) -> Floats:
    return np.column_stack([np.ones(len(x)), x, x[:, 0] ** 2])


# --- Table ----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFigures:
    """A joint as deployed (simulated): lengths in widths of the trunk, an entry for each child."""

    deployed_deg: tuple[float, ...]  # angles under pressure
    # Flat length that each child needs beyond its deployed length.
    pull_backs: tuple[float, ...]
    side_offsets: tuple[float, ...]  # of each child's deployed axis, to its left
    sensitivity: float  # largest change of a deployed angle over that of all flat ones
    crotch_load: float  # largest load of the weld over that of the trunk's straight seam
    passage: float  # largest ball from the trunk into any child, over the child's tube


@dataclass(frozen=True, slots=True, kw_only=True)
class Fan(JointFigures):
    """An even fan by the table."""

    flat_deg: tuple[float, ...]


class FanTable:
    """The table's fans of so many children."""

    def __init__(self, rows: JointRows, scales: Floats) -> None:
        self.rows = rows
        compensation, deployment, *figures = (
            Scales(lengths=row[:4], noise=float(row[4])) for row in scales
        )
        self.compensation = Process(*rows.compensation, compensation)
        self.deployment = Process(*rows.deployment, deployment)
        x, kept = scaled(rows.deployed_fan_deg, rows.places)[rows.is_open], rows.is_open
        self.figures = [
            Process(x, rows.figures[kept, columns], scale)
            for columns, scale in zip(figure_groups(rows.children), figures, strict=True)
        ]

    def compensated(self, fan_deg: float, place: tuple[float, float, float]) -> Fan | None:
        """Return the fan that deploys with a whole angle; None where the table cannot be trusted.

        Parameters
        ----------
        place
            Width ratio, fillet over the parent's width, hoop strain.
        """
        x = scaled(np.array([fan_deg]), np.array([place]))
        left = fan_deg * self.rows.even + self.compensation(x)[0]
        if not self._is_within(place) or not self._is_cut(left):
            return None
        if self.compensation.deviation(x).max(initial=0.0) > TRUSTED_DEG:
            return None
        return self._fan(left, fan_deg * self.rows.even, x)

    def deployed(self, fan_deg: float, place: tuple[float, float, float]) -> Fan | None:
        """Return a flat fan as deployed; None where the table cannot be trusted."""
        x = scaled(np.array([fan_deg]), np.array([place]))
        left = fan_deg * self.rows.even
        if not self._is_within(place) or not self._is_cut(left):
            return None
        if self.deployment.deviation(x).max(initial=0.0) > TRUSTED_DEG:
            return None
        deployed = left + self.deployment(x)[0]
        whole = 2.0 * deployed[0] if len(deployed) else 0.0
        return self._fan(left, deployed, scaled(np.array([whole]), np.array([place])))

    def _is_within(self, place: tuple[float, float, float]) -> bool:
        ranges = (RATIO, FILLET, STRAIN)
        return all(low <= value <= high for value, (low, high) in zip(place, ranges, strict=True))

    def _is_cut(self, left_deg: Floats) -> bool:
        """Whether the outer flat angle is among those of the rows."""
        outer = self.rows.cut_deg[:, :1]
        return not len(left_deg) or bool(outer.min() <= left_deg[0] <= outer.max())

    def _fan(self, flat: Floats, deployed: Floats, x: Floats) -> Fan | None:
        """Return a whole fan from its left half; None for one that is too sensitive."""
        count, half = self.rows.children, self.rows.children // 2
        apart = 2.0 * float(deployed[0]) / (count - 1) if half else 180.0
        lengths, *rest = (process(x)[0] for process in self.figures)
        sensitivity, load = float(np.exp(rest[0][0])), float(np.exp(rest[1][0]))
        is_narrow = bool(x[0, 1] < NARROW_RATIO)
        crowded_deg = 16.0  # four and more siblings that deploy nearer to each other are simulated
        least = crowded_deg if count > 3 else NARROW_DEG if is_narrow else 1.5 * LEAST_GAP_DEG
        most_sensitive = 4.0  # joints whose flat angles matter more than so are simulated
        if apart < least or sensitivity > most_sensitive:
            return None
        backs, offsets = lengths[: count - half], lengths[count - half :]

        def whole(left: Floats, sign: float, digits: int) -> tuple[float, ...]:
            rounded = np.round(left, digits)
            middle = rounded[half:] if len(left) > half else np.zeros(count - 2 * half)
            return (*(sign * rounded[:half]), *middle, *rounded[:half][::-1])

        return Fan(
            flat_deg=_plain(whole(flat, -1.0, 3)),
            deployed_deg=_plain(whole(deployed, -1.0, 3)),
            pull_backs=_plain(whole(backs, 1.0, 5)),
            side_offsets=_plain(whole(offsets, -1.0, 5)),
            sensitivity=round(sensitivity, 3),
            crotch_load=round(load, 3),
            passage=round(min(1.0, float(rest[2][0])), 3),
        )


def _plain(values: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(float(value) + 0.0 for value in values)


def figure_groups(children: int) -> list[slice]:
    """Return the columns of `JointRows.figures` that share a process."""
    lengths = (children + 1) // 2 + children // 2
    return [slice(0, lengths), *(slice(k, k + 1) for k in range(lengths, lengths + 3))]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bound:
    """Errors of the table's joints against direct simulations of them.

    Over joints of the paper's Table 1 (two to four children, fans of 20 to 160 degrees) with random
    widths, default fillets and strains; those that the table leaves to simulations do not count.
    """

    largest_deg: float
    typical_deg: float  # root mean square
    joints: int  # compared


@dataclass(frozen=True, slots=True, kw_only=True)
class TableFile:
    """The file of the table."""

    fingerprint: str  # of the simulation that made it
    compensation: Bound
    deployment: Bound
    rows: dict[int, Floats]  # arrays of `JointRows`
    scales: dict[int, Floats]

    @classmethod
    def read(cls, path: Path = PATH) -> "TableFile":
        """Return the table that ships."""
        with np.load(path, allow_pickle=False) as file:
            bounds = [
                Bound(largest_deg=float(one[0]), typical_deg=float(one[1]), joints=int(one[2]))
                for one in file["bounds"]
            ]
            return cls(
                fingerprint=str(file["fingerprint"]),
                compensation=bounds[0],
                deployment=bounds[1],
                rows={n: file[f"rows_{n}"] for n in CHILDREN},
                scales={n: file[f"scales_{n}"] for n in CHILDREN},
            )


@cache
def table_file() -> TableFile | None:
    """Return the table that ships; None if it is that of another simulation."""
    try:
        found = TableFile.read()
    except (OSError, ValueError, KeyError):
        return None
    return found if found.fingerprint == simulation_fingerprint() else None


@cache
def fan_table(children: int) -> FanTable | None:
    """Return the table's fans of so many children, if it has such."""
    file = table_file()
    if file is None or children not in CHILDREN:
        return None
    return FanTable(
        JointRows.of(children, file.rows[children]), file.scales[children].astype(float)
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlatFans:
    """Flat fans of many joints, by the table alone."""

    fan_rad: Floats  # from the first to the last child, shape (m,)
    angles_rad: Floats  # of each child, NaN beyond the last, shape (m, 5)
    pull_backs: Floats  # over the parent's width, shape (m, 5)
    side_offsets: Floats  # of the last child to its left, over the parent's width, shape (m,)
    is_within: Bools  # whether the joint is within the table's ranges, shape (m,)


def flat_fan(
    children: Ints, fan_rad: Floats, ratio: Floats, fillet: Floats, strain: Floats
) -> FlatFans:
    """Return the flat fans of many joints that deploy evenly, by the table alone.

    Joints beyond the table's ranges get what its nearest place tells, those of more than five
    children the fan itself.

    Parameters
    ----------
    children, fan_rad, ratio, fillet, strain
        Number, deployed angle from first to last, width over the parent's, fillet radius over the
        parent's width, hoop strain of the parent; shape (m,) each, or one for all.
    """
    count, fan, *place = np.broadcast_arrays(children, np.degrees(fan_rad), ratio, fillet, strain)
    asked = np.column_stack([np.atleast_1d(one).astype(np.float64) for one in (fan, *place)])
    count, ranges = np.atleast_1d(count), np.array([RATIO, FILLET, STRAIN])
    nearest = np.clip(asked[:, 1:], ranges[:, 0], ranges[:, 1])
    most = max(CHILDREN)
    flat, angles = np.radians(asked[:, 0]), np.full((len(asked), most), np.nan)
    backs, within = np.full((len(asked), most), np.nan), (nearest == asked[:, 1:]).all(axis=1)
    offsets = np.zeros(len(asked))
    for n in np.unique(count).tolist():
        table, chosen = fan_table(n), np.flatnonzero(count == n)
        if table is None:
            within[chosen] = False
            continue
        half, known = n // 2, table.rows.deployed_fan_deg[table.rows.is_open]
        asked_fan = asked[chosen, 0]
        fan_there = np.clip(asked_fan, known.min(), known.max())
        x = scaled(fan_there, nearest[chosen])
        left = asked_fan[:, None] * table.rows.even + table.compensation(x)
        lengths = table.figures[0](x)
        angles[chosen[:, None], np.arange(n)] = 0.0
        angles[chosen[:, None], np.arange(half)] = -np.radians(left)
        angles[chosen[:, None], n - 1 - np.arange(half)] = np.radians(left)
        backs[chosen[:, None], np.arange(n - half)] = lengths[:, : n - half]
        backs[chosen[:, None], n - 1 - np.arange(half)] = lengths[:, :half]
        if half:
            flat[chosen] = 2.0 * np.radians(left[:, 0])
            offsets[chosen] = lengths[:, n - half]
            within[chosen] &= fan_there == asked_fan
        else:
            flat[chosen] = 0.0
    return FlatFans(
        fan_rad=flat,
        angles_rad=angles,
        pull_backs=backs,
        side_offsets=offsets,
        is_within=within,
    )
