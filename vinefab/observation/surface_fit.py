"""The half-angle of a surface from a table of contacts: at each angle a tip grew on, or stopped.

The share p(a) of tips that stop at an angle a from head-on never rises with a, and the half-angle T
is where it passes one half. Nothing else is assumed of p. Counts at each angle are binomial, and
trials independent. The likelihood of T is the greatest that any such p has, with p at least 1/2
below T and at most 1/2 above it: isotonic regression (pool adjacent violators) on both sides of T,
cut off at 1/2, is exact. Between two angles of the table the likelihood is constant, so the ends of
an interval are angles of the table. They are where twice its logarithm falls by the quantile of chi
squared: right for few angles tried often, wide for many (Tang, Banerjee, Kosorok 2012).
"""

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy  # its parts load at their first use

from vinefab.core.errors import BadInputError, UnfitInputError, nearest
from vinefab.core.limits import rad
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats, number
from vinefab.core.view import Answer, Block, Data, Notes, Number, Rows, WrittenResult
from vinefab.model.contacts import CONTACTS_SCHEMA, Surface, SurfaceAngle
from vinefab.model.files.shipped import read_text
from vinefab.observation.contact_fit import ONE_SIDED, TWO_SIDED

COLUMNS = ("angle_from_head_on_deg", "grew_on", "surface")
"""The last one may be left out."""

UNNAMED = "coupon"
"""What the surface of a table without that column is called."""

_ANSWERS = {"yes": True, "no": False}
_LARGEST_BYTES = 16 << 20
FEW_CONTACTS = 20
"""With fewer on a surface, the interval spans several angles of the coupon."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trials:
    """What tips did on one surface, by the angle from head-on at which they met it."""

    angles_deg: tuple[float, ...]  # different, least first
    stopped: tuple[int, ...]
    tried: tuple[int, ...]

    @classmethod
    def of(cls, angles_deg: Sequence[float], stopped: Sequence[bool]) -> "Trials":
        """Count trials by angle."""
        angles, place = np.unique(np.asarray(angles_deg, dtype=np.float64), return_inverse=True)
        held = np.bincount(place, weights=np.asarray(stopped, dtype=np.float64))
        return cls(
            angles_deg=tuple(angles.tolist()),
            stopped=tuple(int(count) for count in held),
            tried=tuple(np.bincount(place).tolist()),
        )

    @property
    def shares(self) -> Floats:
        """The likeliest share of tips that stop at each angle, never rising, shape (n,)."""
        return _falling(np.divide(self.stopped, self.tried), np.array(self.tried))

    def log_likelihoods(self) -> Floats:
        """Return the log likelihood of a half-angle below, between and above the angles.

        Shape (n + 1,).
        """
        held, tried = np.array(self.stopped), np.array(self.tried)
        share = held / tried
        found = np.empty(len(tried) + 1)
        for place in range(len(found)):
            below = np.maximum(_falling(share[:place], tried[:place]), 0.5)
            above = np.minimum(_falling(share[place:], tried[place:]), 0.5)
            p = np.concatenate([below, above])
            logs = scipy.special.xlogy(held, p) + scipy.special.xlogy(tried - held, 1.0 - p)
            found[place] = logs.sum()
        return found

    @property
    def half_angle(self) -> SurfaceAngle:
        """The half-angle with its 95 % interval; without a value where there is only a bound."""
        likely = self.log_likelihoods()
        fall = 2.0 * (likely.max() - likely)
        alike = sum(self.stopped) in (0, sum(self.tried))
        inside = np.flatnonzero(fall <= (ONE_SIDED if alike else TWO_SIDED))
        ends = (0.0, *self.angles_deg, 90.0)
        return SurfaceAngle(
            low=ends[inside[0]],
            high=ends[inside[-1] + 1],
            value=None if alike else self._crossing_deg(),
        )

    def _crossing_deg(self) -> float:
        """Return where the likeliest shares pass one half, straight between two angles."""
        angles, shares = np.array(self.angles_deg), self.shares
        level = angles[np.isclose(shares, 0.5, rtol=0.0, atol=1e-12)]
        if len(level):
            return round(float(0.5 * (level[0] + level[-1])), 2)
        above = int(np.count_nonzero(shares > 0.5))
        x = np.concatenate([[0.0], angles, [90.0]])[above : above + 2]
        y = np.concatenate([[1.0], shares, [0.0]])[above : above + 2]
        return round(float(x[0] + (y[0] - 0.5) / (y[0] - y[1]) * (x[1] - x[0])), 2)

    @property
    def rises(self) -> bool:
        """Whether tips stop the more often, the farther they were from head-on."""
        share, weights = np.divide(self.stopped, self.tried), np.array(self.tried)
        flat = np.ptp(_falling(share, weights)) == 0.0
        return bool(flat and np.ptp(_falling(-share, weights)) > 0.0)


def _falling(values: Floats, weights: np.ndarray) -> Floats:
    """Return the weighted least-squares fit that never rises: also the likeliest of shares."""
    if not len(values):
        return values
    return np.asarray(
        scipy.optimize.isotonic_regression(values, weights=weights, increasing=False).x
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class SurfaceFit(WrittenResult):
    """Half-angles of surfaces, measured on a table of contacts.

    Parameters
    ----------
    surfaces
        Each with its half-angle, 95 % interval and number of contacts.
    trials
        What was counted, by the names of the surfaces.
    notes
        What a user should know, a sentence each.
    path
        The file that predictions read.
    """

    surfaces: tuple[Surface, ...]
    trials: Mapping[str, Trials]
    notes: tuple[str, ...] = ()
    path: Path | None = None
    schema = CONTACTS_SCHEMA

    def view(self) -> Iterator[Block]:
        """Yield the half-angle of each surface, the counts and notes."""
        for one in self.surfaces:
            yield Answer(f"{one.surface}: {_shown(one.half_angle_deg)} (measured: {one.counted})")
        for one in self.surfaces:
            trials = self.trials[one.surface]
            rows = zip(
                trials.angles_deg, trials.tried, trials.stopped, trials.shares.tolist(), strict=True
            )
            yield Rows(
                caption=f"{one.surface}: tips that stopped (measured), and the likeliest share "
                "that never rises with the angle (computed)",
                headings=("from head-on, deg", "tried", "stopped", "grew on", "share that stops"),
                rows=tuple(
                    (f"{angle:g}", tried, stopped, tried - stopped, Number(share, "", ".2f"))
                    for angle, tried, stopped, share in rows
                ),
            )
        yield Notes(self.notes)
        yield Data(
            {
                "surfaces": [
                    one.content | {"half_angle_deg": dict(one.half_angle_deg)}
                    for one in self.surfaces
                ]
            }
        )


def _shown(angle: SurfaceAngle) -> str:
    """Return a half-angle, or its bound, as text."""
    if angle.value is not None:
        return f"half-angle {angle.value:g} deg, 95 % interval {angle.low:g} to {angle.high:g} deg"
    if angle.low == 0.0:
        return f"half-angle at most {angle.high:g} deg (95 %): every tip grew on"
    return f"half-angle at least {angle.low:g} deg (95 %): every tip stopped"


def fit_contact_table(
    path: Path, *, film: str = "", tube_diameter_mm: float | None = None
) -> SurfaceFit:
    """Return the half-angle of each surface in a table of contacts.

    Parameters
    ----------
    film, tube_diameter_mm
        Of the tubes that were grown; the table does not say them.

    Raises
    ------
    BadInputError
        If a column is missing, a cell cannot be used, or no row is filled in.
    UnreadableFileError
        If the file is missing or no text.
    """
    rows, notes = _contact_rows(path)
    surfaces, trials = list[Surface](), dict[str, Trials]()
    for name in dict.fromkeys(name for *_, name in rows):
        mine = [(angle, stopped) for angle, stopped, other in rows if other == name]
        counts = trials[name] = Trials.of(*zip(*mine, strict=True))
        found = Surface(
            surface=name,
            half_angle_deg=counts.half_angle,
            contacts=len(mine),
            tube_diameter_mm=tube_diameter_mm,
            film=film,
            source=f"{path.name}: {sum(counts.stopped)} of {counted(len(mine), 'tip')} stopped, at "
            f"{counted(len(counts.angles_deg), 'angle')} from head-on",
        )
        surfaces.append(found)
        notes += _notes_on(found, counts)
    notes.append("trials are taken as independent, a tube for each (assumed)")
    return SurfaceFit(surfaces=tuple(surfaces), trials=trials, notes=tuple(notes))


def _notes_on(found: Surface, trials: Trials) -> Iterator[str]:
    """Yield notes for a user about the half-angle of a surface."""
    name, angle = found.surface, found.half_angle_deg
    if trials.rises:
        yield (
            f"{name}: tips stopped the more often, the farther from head-on; angles may have been "
            "measured from the wall's tangent"
        )
    if found.contacts < FEW_CONTACTS:
        yield f"{name}: few contacts ({found.contacts}, from {FEW_CONTACTS} on): a wide interval"
    if angle.value is not None:
        yield (
            f"{name}: as friction of a tip that slides as a solid (Coulomb's cone, computed) "
            f"{math.tan(rad(angle.value)):.2f}, {math.tan(rad(angle.low)):.2f} to "
            f"{math.tan(rad(min(angle.high, 89.0))):.2f}; anchoring keeps its own"
        )
    if angle.high == 90.0:
        yield f"{name}: tips stop at the widest angle of the table too: try walls farther off"


def _contact_rows(path: Path) -> tuple[list[tuple[float, bool, str]], list[str]]:
    """Return angle, whether the tip stopped, and surface of each row, and notes on the rest."""
    text = read_text(path, _LARGEST_BYTES).removeprefix("\ufeff")
    lines = [
        (place, line)
        for place, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.startswith("#")
    ]
    rows, notes, header, empty = list[tuple[float, bool, str]](), list[str](), list[str](), 0
    for number_of_line, line in lines:
        place = f"{path}, line {number_of_line}"
        try:
            cells = [cell.strip() for cell in next(csv.reader(io.StringIO(line), strict=True))]
        except csv.Error as error:
            problem = f"the line cannot be read as cells ({error})"
            raise UnfitInputError("", problem, "mend its quotes", place) from None
        if not header:
            header, left = _header(cells, place)
            notes += [f"columns left alone: {', '.join(left)}"] * bool(left)
            continue
        row = dict(zip(header, cells, strict=False))
        if not row.get("grew_on"):
            empty += 1
            continue
        rows.append(_row(row, place))
    if not rows:
        problem = "no row says whether a tip grew on"
        raise UnfitInputError("grew_on", problem, "fill in yes or no", path)
    notes += [f"{counted(empty, 'row')} without an answer"] * bool(empty)
    return rows, notes


def _header(cells: list[str], place: str) -> tuple[list[str], list[str]]:
    """Return the names of the columns, and those that mean nothing here."""
    for name in COLUMNS[:2]:
        if name not in cells:
            problem = f"the first row {','.join(cells)!r} does not name the column {name}"
            raise UnfitInputError("", problem, f"begin with {','.join(COLUMNS)}", place)
    if len(set(cells)) < len(cells):
        raise UnfitInputError("", "a column is there twice", "leave one of them out", place)
    others = [name for name in cells if name not in COLUMNS]
    for name in others:
        if hint := nearest(name, COLUMNS):
            problem = f"there is no column {name!r}"
            raise UnfitInputError("", problem, hint.removeprefix("; "), place)
    return cells, others


def _row(row: Mapping[str, str], place: str) -> tuple[float, bool, str]:
    answer = row["grew_on"].lower()
    if answer not in _ANSWERS:
        raise BadInputError("grew_on", row["grew_on"], "yes, no", place)
    key, text = COLUMNS[0], row.get(COLUMNS[0], "")
    try:
        angle_deg = float(text)
    except ValueError:
        raise BadInputError(key, text or None, "0 to 90 deg", place) from None
    try:
        number(key, angle_deg, 0.0, 90.0, "deg")
    except BadInputError as error:
        raise error.at(place) from None
    return angle_deg, not _ANSWERS[answer], row.get("surface") or UNNAMED
