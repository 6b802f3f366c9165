"""Coupon results in: a CSV table of readings, in whatever unit they were taken."""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.core.units import STANDARD_GRAVITY_M_S2
from vinefab.model.files.shipped import read_text

COLUMNS = ("measure", "setting", "value", "unit", "uncertainty", "note")

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
}  # fmt: skip
"""Factor of every known unit, by the unit that is worked in."""

MEASURES = {
    "kerf_piece": "mm",
    "kerf_hole": "mm",
    "seam": "mm",
    "width": "mm",
    "burst": "kPa",
    "peel": "N",
    "crotch_burst": "kPa",
    "friction_incline": "rad",
    "growth_width": "mm",
    "growth": "kPa",
    "matrix": "",
}
"""What may be measured, and the unit that it is worked in; empty for words."""

OUTCOMES = ("nothing", "weld", "weldcut", "cut", "burnt")
"""What a line of the energy matrix may have done."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """One row of the table."""

    measure: str  # A key of `MEASURES`
    setting: str  # what it was measured on: a width, an operation, a path
    value: float  # what was read, in the measure's own unit; NaN for words
    sigma: float | None  # standard uncertainty in the same unit, or None
    word: str  # what was seen, for a measure in words
    place: str  # file and line, for errors

    def wrong(self, value: object, allowed: str) -> BadInputError:
        """Return the error that says what is wrong with this row."""
        return BadInputError(f"{self.measure} {self.setting}".strip(), value, allowed, self.place)


@dataclass(frozen=True, slots=True, kw_only=True)
class Results:
    """A table of readings, and what the coupons said about themselves."""

    readings: tuple[Reading, ...]  # the rows that have a value, in order
    recipe: str  # name of the recipe that the coupons were cut with, or an empty string
    offset_mm: float | None  # offset of the one-pass outline on the coupons, or None

    def of(self, measure: str) -> tuple[Reading, ...]:
        """Return the readings of one kind."""
        return tuple(reading for reading in self.readings if reading.measure == measure)


def read_results(path: Path) -> Results:
    """Return the readings of a table; rows without a value are left out."""
    lines = read_text(path, 16 << 20).splitlines()
    notes = dict(_note(line) for line in lines if line.startswith("#"))
    offset = notes.get("weldcut_offset_mm")
    return Results(
        readings=tuple(_readings(lines, path)),
        recipe=notes.get("recipe", ""),
        offset_mm=None if offset is None else _number(offset, "weldcut_offset_mm", str(path)),
    )


def _note(line: str) -> tuple[str, str]:
    name, _, value = line.lstrip("# ").partition(" ")
    return name, value.strip()


def _readings(lines: list[str], path: Path) -> Iterator[Reading]:
    header: list[str] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        place = f"{path}, line {number}"
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        if not header:
            header = _header(cells, place)
            continue
        if len(cells) > len(header):
            words = f"{len(header)} ({', '.join(header)}); put commas of a note into quotes"
            raise BadInputError("cells", len(cells), words, place)
        row = dict(zip(header, cells, strict=False))
        if row.get("value"):
            yield _reading(row, place)


def _header(cells: list[str], place: str) -> list[str]:
    if not {"measure", "setting", "value", "unit"} <= set(cells) <= set(COLUMNS):
        raise BadInputError("header", ",".join(cells), ",".join(COLUMNS), place)
    return cells


def _reading(row: dict[str, str], place: str) -> Reading:
    measure = row["measure"]
    if measure not in MEASURES:
        raise UnknownNameError("measure", measure, MEASURES, place)
    base, text = MEASURES[measure], row["value"]
    if not base:
        if text not in OUTCOMES:
            raise BadInputError(measure, text, ", ".join(OUTCOMES), place)
        return Reading(
            measure=measure, setting=row["setting"], value=math.nan, sigma=None, word=text,
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
        word="",
        place=place,
    )


def _number(text: str, key: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError as error:
        raise BadInputError(key, text, "a number", place) from error
    if not math.isfinite(value) or value < 0.0:
        raise BadInputError(key, text, "a finite number, 0 or more", place)
    return value
