"""The energy matrix, and coupons laid out on as many sheets as they need."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.fabrication.calibration.coupon_shapes import LETTER_MM, Coupon, marks
from vinefab.fabrication.job.passes import weldcut_offset_mm
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, OperationSettings, Quantity, Standing
from vinefab.model.outline import Contour
from vinefab.physics.seam import spot_at_mm

GAP_MM = 8.0
"""Between pieces: more than rule VF-L01 asks for between a mark and a body."""

ROW_MM = 300.0
"""Rows are no longer than this where the bed allows more: a piece of film of a handy shape."""

_ORDER = tuple(Operation)


def coupon_sheets(pieces: Sequence[Coupon], profile: LaserProfile) -> tuple[Job, ...]:
    """Return the jobs that hold all pieces, in rows from the lower left, highest pieces first."""
    (bed_x, bed_y), margin = profile.machine.usable_mm, profile.machine.margin_mm.value
    room = min(bed_x, ROW_MM), bed_y
    sheets: list[list[Coupon]] = [[]]
    x, y, row = 0.0, 0.0, 0.0
    for piece in sorted(pieces, key=lambda piece: -_size(piece)[1]):
        width, height = _size(piece)
        if width > room[0] or height > room[1]:
            words = f"a bed of at least {width:.0f} x {height:.0f} mm for coupon {piece.name}"
            raise BadInputError("machine bed", f"{bed_x:g} x {bed_y:g} mm usable", words)
        if x > 0.0 and x + width > room[0]:
            x, y, row = 0.0, y + row + GAP_MM, 0.0
        if y > 0.0 and y + height > room[1]:
            sheets.append([])
            x, y, row = 0.0, 0.0, 0.0
        low_x, low_y, _, _ = piece.box_mm
        sheets[-1].append(piece.shifted(margin + x - low_x, margin + y - low_y))
        x, row = x + width + GAP_MM, max(row, height)
    names = ["coupons"] if len(sheets) == 1 else [f"coupons_{k + 1}" for k in range(len(sheets))]
    facts = recipe_facts(profile)
    return tuple(
        sheet_job(name, [path for piece in sheet for path in piece.paths], profile, facts)
        for name, sheet in zip(names, sheets, strict=True)
    )


def sheet_job(
    name: str, paths: Sequence[LaserPath], profile: LaserProfile, facts: Mapping[str, object]
) -> Job:
    """Return paths as one job on the machine's bed, in process order."""
    return Job(
        name=name,
        sheet_width_mm=profile.machine.bed_width_mm.value,
        sheet_height_mm=profile.machine.bed_height_mm.value,
        paths=tuple(sorted(paths, key=lambda path: _ORDER.index(path.operation))),
        facts=facts,
    )


def recipe_facts(profile: LaserProfile) -> dict[str, object]:
    """Return what every coupon file says about how it was made."""
    facts: dict[str, object] = {
        "machine": profile.machine.name,
        "material": profile.material.name,
        "recipe": profile.recipe.name,
        "recipe_status": profile.recipe.status.value,
    }
    if Operation.WELDCUT in profile.recipe.operations:
        facts["weldcut_offset_mm"] = weldcut_offset_mm(profile)
    return facts


def _size(piece: Coupon) -> tuple[float, float]:
    x0, y0, x1, y1 = piece.box_mm
    return x1 - x0, y1 - y0


FOCUS_MM = (0.0, 3.0, 6.0, 10.0)
LEAST_MJ_MM, MOST_MJ_MM, LEVELS = 5.0, 250.0, 8
LINE_MM, ZONE_MM = 80.0, 20.0
PITCH_MM = 9.0
_TEXT_MM = 40.0
_TICK_MM = 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matrix:
    """The energy matrix of a recipe."""

    jobs: tuple[Job, ...]  # one per focus offset, for the lens is set by hand
    energies_mj_mm: tuple[float, ...]  # line energies that are drawn
    # line energies that the machine cannot give on a line this short; not drawn
    out_of_reach_mj_mm: tuple[float, ...]


def energies_mj_mm() -> tuple[float, ...]:
    """Return the line energies that are asked for, in even steps of their logarithm.

    >>> [round(energy, 1) for energy in energies_mj_mm()]
    [5.0, 8.7, 15.3, 26.7, 46.8, 81.8, 143.0, 250.0]
    """
    return tuple(np.geomspace(LEAST_MJ_MM, MOST_MJ_MM, LEVELS).tolist())


def energy_matrix(profile: LaserProfile) -> Matrix:
    """Return the energy matrix for a recipe's sealing operation, the marks and zones included.

    The power stays at the least that the recipe's tube keeps and the speed gives the energy, so
    an energy is out of reach where the head would not come up to speed before the middle of the
    line, in which the seam is judged.
    """
    operation = sealing_operation(profile)
    settings = profile.settings(operation)
    reached = [energy for energy in energies_mj_mm() if _in_reach(energy, settings, profile)]
    jobs = tuple(_job(focus_mm, reached, operation, profile) for focus_mm in FOCUS_MM if reached)
    return Matrix(
        jobs=jobs,
        energies_mj_mm=tuple(reached),
        out_of_reach_mj_mm=tuple(e for e in energies_mj_mm() if e not in reached),
    )


def sealing_operation(profile: LaserProfile) -> Operation:
    """Return the operation by which the laser makes seams."""
    for operation in (Operation.WELDCUT, Operation.WELD):
        found = profile.recipe.operations.get(operation)
        if found is not None and found.by_laser:
            return operation
    raise BadInputError(
        f"recipe {profile.recipe.name}", "sealed by hand", "a recipe whose laser makes the seam"
    )


def trial_settings(
    energy_mj_mm: float, focus_mm: float, settings: OperationSettings, profile: LaserProfile
) -> OperationSettings:
    """Return the settings of one line of the matrix: one pass, constant power."""
    machine = profile.machine
    power = settings.min_power_percent
    power_w = machine.power_w.value * power.value / 100.0
    spot = spot_at_mm(machine.spot_mm.value, focus_mm, machine.rayleigh_mm.value)
    return replace(
        settings,
        power_percent=power,
        min_power_percent=power,
        speed_mm_s=_trial(1000.0 * power_w / energy_mj_mm, f"{energy_mj_mm:.1f} mJ/mm"),
        passes=1,
        focus_offset_mm=_trial(focus_mm, "energy matrix"),
        spot_mm=_trial(spot, "spot at this focus offset"),
    )


def _trial(value: float, source: str) -> Quantity:
    return Quantity(value=value, standing=Standing.COMPUTED, source=source)


def _in_reach(energy_mj_mm: float, settings: OperationSettings, profile: LaserProfile) -> bool:
    machine = profile.machine
    speed = trial_settings(energy_mj_mm, 0.0, settings, profile).speed_mm_s.value
    ramp_mm = (LINE_MM - ZONE_MM) / 2
    comes_up_to = math.sqrt(2.0 * machine.acceleration_mm_s2.value * ramp_mm)
    return speed <= min(comes_up_to, machine.speed_max_mm_s.value)


def _job(
    focus_mm: float, energies: Sequence[float], operation: Operation, profile: LaserProfile
) -> Job:
    margin, settings = profile.machine.margin_mm.value, profile.settings(operation)
    low = margin + 2.0 * _TICK_MM
    top = low + PITCH_MM * len(energies)
    start = margin + _TEXT_MM
    paths = marks(f"FOCUS {focus_mm:g}", (margin, top), profile)
    for row, energy in enumerate(energies):
        y = low + LETTER_MM / 2 + PITCH_MM * row
        paths += marks(f"{energy:.1f}", (margin, y - LETTER_MM / 2), profile)
        line = np.array([(start, y), (start + LINE_MM, y)])
        paths.append(
            LaserPath(
                operation=operation,
                contour=Contour.polyline(line, closed=False),
                label=f"{energy:.1f} mJ/mm at focus {focus_mm:g} mm",
                variant=f"E{energy:.1f}",
                settings=trial_settings(energy, focus_mm, settings, profile),
            )
        )
    paths += _zone(start + (LINE_MM - ZONE_MM) / 2, (low - _TICK_MM, top), profile)
    facts = {**recipe_facts(profile), "focus_offset_mm": focus_mm}
    return sheet_job(f"matrix_focus_{focus_mm:02.0f}", paths, profile, facts)


def _zone(left_mm: float, ends_mm: tuple[float, float], profile: LaserProfile) -> list[LaserPath]:
    """Return ticks above and below the lines, between which the seam is judged."""
    if Operation.MARK not in profile.recipe.operations:
        return []
    found = []
    for x in (left_mm, left_mm + ZONE_MM):
        for y, towards in zip(ends_mm, (-1.0, 1.0), strict=True):
            tick = np.array([(x, y), (x, y + towards * _TICK_MM)])
            contour = Contour.polyline(tick, closed=False)
            found.append(LaserPath(operation=Operation.MARK, contour=contour, label="zone"))
    return found
