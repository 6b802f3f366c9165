"""The grid of temperatures and speeds on which a hot tip is tried, and the reading of its lines.

Rows are temperatures, the coolest at the bottom and first, so that the tip only ever heats up;
columns are speeds, the slowest on the left. Nothing is written on the film: a hot tip has no pen.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vinefab.core.errors import UnfitInputError
from vinefab.fabrication.calibration.coupons import Results, sheet_job
from vinefab.fabrication.calibration.estimate import Estimate
from vinefab.fabrication.job.laser_job import recipe_facts
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.machine import HotTip, HotTipMachine, Tool
from vinefab.model.outline import Contour
from vinefab.model.quantity import Quantity, Standing

STEPS_C = (-20.0, -10.0, 0.0, 10.0, 20.0)
SPEED_SHARES = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Temperatures and speeds of the grid, from those of the recipe."""
GRID_LINE_MM = 30.0
COLUMN_MM, ROW_MM = 36.0, 9.0
GRID_NAME = "seal_grid"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SealGrid:
    """The grid of a recipe."""

    job: Job
    celsius: tuple[float, ...]  # of its rows, from below
    speeds_mm_s: tuple[float, ...]  # of its columns, from the left

    @property
    def settings(self) -> tuple[str, ...]:
        """The settings of its lines, as the table of results has them, row by row."""
        return tuple(f"{c:g} {v:g}" for c in self.celsius for v in self.speeds_mm_s)


def seal_grid(profile: LaserProfile) -> SealGrid | None:
    """Return the grid for the hot tip of a recipe; None for a recipe without one."""
    tip, machine = profile.recipe.hot_tip, profile.machine_of(Tool.HOT_TIP)
    if tip is None or not isinstance(machine, HotTipMachine):
        return None
    celsius = tuple(tip.seal_temperature_c.value + step for step in STEPS_C)
    top_mm_s = machine.speed_max_mm_s.value
    speeds = [float(f"{tip.seal_speed_mm_s.value * share:.3g}") for share in SPEED_SHARES]
    reached = tuple(speed for speed in speeds if speed <= top_mm_s)
    corner = machine.margin_mm.value + tip.seam_width_mm.value
    paths = [
        _line(tip, one, speed, (corner + column * COLUMN_MM, corner + row * ROW_MM))
        for row, one in enumerate(celsius)
        for column, speed in enumerate(reached)
    ]
    job = sheet_job(GRID_NAME, paths, profile, recipe_facts(profile))
    return SealGrid(job=job, celsius=celsius, speeds_mm_s=reached)


def _line(
    tip: HotTip, celsius: float, speed_mm_s: float, start_mm: tuple[float, float]
) -> LaserPath:
    x, y = start_mm
    ends = np.array([(x, y), (x + GRID_LINE_MM, y)])
    return LaserPath(
        operation=Operation.WELD,
        contour=Contour.polyline(ends, closed=False),
        label=f"{celsius:g} C at {speed_mm_s:g} mm/s",
        settings=tip.changed(
            seal_temperature_c=_tried(celsius), seal_speed_mm_s=_tried(speed_mm_s)
        ),
    )


def _tried(value: float) -> Quantity:
    return Quantity(value=value, standing=Standing.COMPUTED, source="grid of the coupons")


def grid_settings(results: Results) -> dict[str, Estimate]:
    """Return temperature and speed that the grid recommends; nothing without readings of it.

    At each temperature the longest run of neighbouring speeds that sealed is looked at. The widest
    run of all wins, of several the coolest: its middle is farthest from peeling and from burning.

    Raises
    ------
    UnfitInputError
        If no line sealed.
    """
    rows: dict[float, list[tuple[float, bool]]] = {}
    for reading in results.of("grid"):
        allowed = "temperature in C and speed in mm/s, such as 180 5, as setting"
        celsius, speed = reading.two_numbers(allowed)
        rows.setdefault(celsius, []).append((speed, reading.outcome == "seals"))
    if not rows:
        return {}
    runs = {celsius: _longest_run(row) for celsius, row in rows.items()}
    best = max(runs, key=lambda celsius: (_width(runs[celsius]), -celsius))
    if not runs[best]:
        problem = "no line of the grid sealed"
        raise UnfitInputError(
            "grid", problem, "try other temperatures, or press lower (touch_z_mm)"
        )
    low, high = runs[best][0], runs[best][-1]
    count = sum(map(len, rows.values()))
    return {
        "hot_tip.seal_temperature_c": Estimate(value=best, uncertainty=0.0, readings=count),
        "hot_tip.seal_speed_mm_s": Estimate(
            value=math.sqrt(low * high), uncertainty=0.0, readings=count
        ),
    }


def _longest_run(row: Sequence[tuple[float, bool]]) -> list[float]:
    by_speed: Mapping[float, list[bool]] = {}
    by_speed = {speed: [good for at, good in row if at == speed] for speed, _ in row}
    best, run = list[float](), list[float]()
    for speed in sorted(by_speed):
        run = [*run, speed] if all(by_speed[speed]) else []
        best = max(best, run, key=_width)
    return best


def _width(run: Sequence[float]) -> float:
    """Return the factor that a run of speeds spans; 0 for none, more for a run than for none."""
    return run[-1] / run[0] if run else 0.0
