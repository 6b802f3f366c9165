"""The table of coupon results, CSV: written to be filled in, and read in any known unit."""

import csv
import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.core.limits import STANDARD_GRAVITY_M_S2
from vinefab.core.plain_text import GENERATOR
from vinefab.fabrication.calibration.coupons import (
    BALLOONS,
    FILLETS_MM,
    FOCUS_MM,
    JOINT_KPA,
    JOINT_WIDTHS_MM,
    LADDER_MM,
    LAP_COPIES,
    LAP_WIDTHS_MM,
    LENGTHS_MM,
    STRIP_MM,
    STRIPS,
    Matrix,
    joint_designs,
    lap_name,
)
from vinefab.fabrication.job.passes import weldcut_offset_mm
from vinefab.model.files.shipped import read_text
from vinefab.model.job import Operation
from vinefab.model.laser import LapMethod, LaserProfile

_COLUMNS = ("measure", "setting", "value", "unit", "uncertainty", "note")
OFFSET_NOTE = "# weldcut_offset_mm"
RECIPE_NOTE = "# recipe"
Row = tuple[str, str, str, str]
"""Measure, setting, unit and note."""

UNITS = {
    "mm": {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4},
    "kPa": {
        "kPa": 1.0, "Pa": 1e-3, "hPa": 0.1, "MPa": 1000.0, "mbar": 0.1, "bar": 100.0,
        "psi": 6.894757293168361,
    },
    "N": {
        "N": 1.0, "gf": 1e-3 * STANDARD_GRAVITY_M_S2, "kgf": STANDARD_GRAVITY_M_S2,
        "lbf": 4.4482216152605,
    },
    "rad": {"rad": 1.0, "deg": math.pi / 180.0},
    "children": {"children": 1.0},
}  # fmt: skip
"""Factor of every known unit, by the unit that the fit works in."""

_MEASURES = {
    "kerf_piece": "mm",
    "kerf_hole": "mm",
    "seam": "mm",
    "width": "mm",
    "length": "mm",
    "burst": "kPa",
    "peel": "N",
    "crotch_burst": "kPa",
    "lap_band": "mm",
    "lap_burst": "kPa",
    "lap_survived": "kPa",
    "friction_incline": "rad",
    "growth_width": "mm",
    "growth": "kPa",
    "growth_free": "kPa",
    "joint_girth": "mm",
    "joint_angle": "rad",
    "children_out": "children",
    "matrix": "",
}
"""Quantities that may be measured, and the unit of the fit; empty for outcomes as text."""

GROWTH_PATHS = {
    "growth": ("1000", "1000", "50 270 950"),
    "growth_free": ("50", "50", "50", "900 270 100", "900 270 100", "900 270 100"),
}
"""Paths that tell the growth constants apart best: by Fisher information, of those up to a metre
with up to 270 degrees, for constants within a factor of two of the published ones.
"""

SLACK_KPA = 2.0
"""Pressure at which a trunk is round and hardly stretched."""

GIRTHS = 3
"""Readings of each girth: so many coupons of a width."""

_LARGEST = 1e9
"""Of a reading, in any unit: profiles hold no larger number."""

OUTCOMES = ("nothing", "weld", "weldcut", "cut", "burnt")
"""Outcomes of a line of the energy matrix."""


def results_text(profile: LaserProfile, matrix: Matrix | None) -> str:
    """Return the table of results, CSV, one row per reading, values to be filled in."""
    lines = [
        f"# coupon results, {GENERATOR}",
        f"{RECIPE_NOTE} {profile.recipe.name}",
    ]
    if Operation.WELDCUT in profile.recipe.by_operation:
        lines.append(f"{OFFSET_NOTE} {weldcut_offset_mm(profile):.6g}")
    names = [op for op in (Operation.WELDCUT, Operation.CUT) if op in profile.recipe.by_operation]
    rows: list[Row] = [
        ("kerf_piece", name, "mm", f"side of the piece that came out of KERF-{name}")
        for name in names
    ]
    seal = Operation.WELDCUT if Operation.WELDCUT in names else Operation.WELD
    rows += [("seam", seal, "mm", "width of the fused rim inward of any cut") for _ in range(3)]
    rows += [("width", f"{w:g}", "mm", f"lay-flat lumen of finger W{w:g}") for w in LADDER_MM]
    rows += [
        (
            "length",
            f"{length:g}",
            "mm",
            f"cut of the mouth to outer edge of the tip: L{length:g}-{k}",
        )
        for length, copies in LENGTHS_MM.items()
        for k in range(1, copies + 1)
    ]
    rows += [
        ("burst", "20", "kPa", f"BURST-{k}; setting: lay-flat width")
        for k in range(1, BALLOONS + 1)
    ]
    rows += [
        ("peel", f"{STRIP_MM[1]:g}", "N", f"PEEL-{k}; setting: strip width")
        for k in range(1, STRIPS + 1)
    ]
    rows += [("crotch_burst", f"{radius:g}", "kPa", f"CROTCH-R{radius:g}") for radius in FILLETS_MM]
    method = profile.recipe.lap.method if profile.recipe.lap else LapMethod.IMPULSE_SEAL
    rows += [
        (
            "lap_band",
            method,
            "mm",
            f"width of the band as bonded; setting: {' or '.join(LapMethod)}",
        )
    ]
    laps = {
        "lap_burst": "if its lap failed; setting: lay-flat width",
        "lap_survived": "if it failed elsewhere or not at all",
    }
    rows += [
        (measure, f"{width:g}", "kPa", f"{lap_name(width, number)} {when}")
        for width in LAP_WIDTHS_MM
        for number in range(1, LAP_COPIES + 1)
        for measure, when in laps.items()
    ]
    rows += [("friction_incline", "", "deg", "incline at which film slides on the obstacle")] * 3
    rows += [("growth_width", "", "mm", "lay-flat width of the tube that was grown")]
    rows += [
        (measure, path, "kPa", "lengths mm and turns deg in turn")
        for measure, paths in GROWTH_PATHS.items()
        for path in paths
    ]
    if matrix is not None:
        rows += [
            ("matrix", f"{energy:.1f} {focus:g}", "", " / ".join(OUTCOMES))
            for focus in FOCUS_MM
            for energy in matrix.energies_mj_mm
        ]
    rows += [
        ("joint_girth", f"{width:g} {kpa:g}", "mm", "around a trunk; setting: width and kPa")
        for width in JOINT_WIDTHS_MM
        for kpa in (SLACK_KPA, JOINT_KPA)
        for _ in range(GIRTHS)
    ]
    between = "between the axes of the children; setting: coupon and kPa"
    elbow = "from the axis of the trunk to that of the child; setting: coupon and kPa"
    rows += [
        (
            "joint_angle",
            f"{joint.name} {JOINT_KPA:g}",
            "deg",
            between if joint.levels[0].branches > 1 else elbow,
        )
        for joint in joint_designs()
    ]
    rows += [
        (
            "children_out",
            f"{joint.name} {JOINT_KPA:g}",
            "children",
            f"of {joint.levels[0].branches} that came out of the trunk; setting: coupon and kPa",
        )
        for joint in joint_designs()
    ]
    lines += [
        "# Fill in the column value; rows without a value are ignored; add rows as you like.",
        "# uncertainty: one standard deviation of the reading in the row's unit, or empty.",
        ",".join(_COLUMNS),
        *(
            ",".join((measure, setting, "", unit, "", note))
            for measure, setting, unit, note in rows
        ),
    ]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One row of the table."""

    measure: str  # a key of `MEASURES`
    setting: str  # what it was measured on: a width, an operation, a path
    value: float  # in the measure's own unit; NaN for an outcome
    sigma: float | None  # standard uncertainty in the same unit
    outcome: str  # one of `OUTCOMES`; empty for a number
    place: str  # file and line, for errors

    def wrong(self, value: object, allowed: str) -> BadInputError:
        """Return an error that names this row."""
        return BadInputError(f"{self.measure} {self.setting}".strip(), value, allowed, self.place)


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """A table of readings, with the recipe and offset that the coupons were cut with."""

    readings: tuple[Reading, ...]  # the rows that have a value, in order
    recipe: str  # name of the recipe that the coupons were cut with; empty if the table lacks it
    offset_mm: float | None  # offset of the one-pass outline on the coupons

    def of(self, measure: str) -> tuple[Reading, ...]:
        """Return the readings of one kind."""
        return tuple(reading for reading in self.readings if reading.measure == measure)


@dataclass(frozen=True, slots=True, kw_only=True)
class JointReading:
    """The angle of a joint coupon as it was read off a photo (measured)."""

    coupon: str  # name of one of `joint_designs`
    kpa: float  # pressure in it
    angle_deg: float  # between the axes of its children, of a single child from the trunk's
    source: str  # the photo's name

    def entered(self, table: str) -> str:
        """Return a table of results with this reading, which replaces one of the same photo.

        An empty table gets a header.
        """
        lines = table.splitlines() or [f"# coupon results, {GENERATOR}", ",".join(_COLUMNS)]
        place, header = next(
            (number, [cell.strip() for cell in line.split(",")])
            for number, line in enumerate(lines)
            if line.strip() and not line.startswith("#")
        )
        row = {
            "measure": "joint_angle",
            "setting": f"{self.coupon} {self.kpa:g}",
            "value": f"{self.angle_deg:.2f}",
            "unit": "deg",
            "note": f"read off {self.source}",
        }
        kept = []
        for number, line in enumerate(lines):
            is_row = number > place and line.strip() and not line.startswith("#")
            cells = next(csv.reader([line])) if is_row else []
            known = dict(zip(header, (cell.strip() for cell in cells), strict=False))
            if known.get("note") != row["note"] or known.get("setting") != row["setting"]:
                kept.append(line)
        buffer = io.StringIO()
        csv.writer(buffer, lineterminator="").writerow([row.get(name, "") for name in header])
        return "\n".join([*kept, buffer.getvalue()]) + "\n"


def read_results(path: Path) -> Results:
    """Read a table of results; rows without a value are left out.

    Raises
    ------
    UnreadableFileError
        If the file is missing or no text.
    BadInputError, UnknownNameError
        If a header, measure, unit or number is not known; the error names file and line.
    """
    lines = read_text(path, 16 << 20).splitlines()
    parts = (line.lstrip("# ").partition(" ") for line in lines if line.startswith("#"))
    notes = {name: value.strip() for name, _, value in parts}
    offset = notes.get("weldcut_offset_mm")
    return Results(
        readings=tuple(_readings(lines, path)),
        recipe=notes.get("recipe", ""),
        offset_mm=None if offset is None else _number(offset, "weldcut_offset_mm", str(path)),
    )


def _readings(lines: list[str], path: Path) -> Iterator[Reading]:
    header: list[str] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        place = f"{path}, line {number}"
        try:
            cells = [cell.strip() for cell in next(csv.reader([line], strict=True))]
        except csv.Error as error:
            allowed = f"comma-separated cells ({error})"
            raise BadInputError("line", line, allowed, place) from error
        if not header:
            if not {"measure", "setting", "value", "unit"} <= set(cells) <= set(_COLUMNS):
                raise BadInputError("header", ",".join(cells), ",".join(_COLUMNS), place)
            header = cells
            continue
        if len(cells) > len(header):
            allowed = f"{len(header)} ({', '.join(header)}); put commas of a note into quotes"
            raise BadInputError("cells", len(cells), allowed, place)
        row = dict(zip(header, cells, strict=False))
        if row.get("value"):
            yield _reading(row, place)


def _reading(row: dict[str, str], place: str) -> Reading:
    measure = row["measure"]
    if measure not in _MEASURES:
        raise UnknownNameError("measure", measure, _MEASURES, place)
    base, text = _MEASURES[measure], row["value"]
    if not base:
        if text not in OUTCOMES:
            raise BadInputError(measure, text, ", ".join(OUTCOMES), place)
        return Reading(
            measure=measure, setting=row["setting"], value=math.nan, sigma=None, outcome=text,
            place=place,
        )  # fmt: skip
    unit = row.get("unit", "")
    if unit not in UNITS[base]:
        raise BadInputError(f"unit of {measure}", unit, ", ".join(UNITS[base]), place)
    factor, spread = UNITS[base][unit], row.get("uncertainty", "")
    return Reading(
        measure=measure,
        setting=row.get("setting", ""),
        value=factor * _number(text, measure, place),
        sigma=factor * _number(spread, f"uncertainty of {measure}", place) if spread else None,
        outcome="",
        place=place,
    )


def _number(text: str, key: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise BadInputError(key, text, "a number", place) from error
    if not 0.0 <= value <= _LARGEST:
        raise BadInputError(key, text, f"a finite number, 0 or more, at most {_LARGEST:g}", place)
    return value
