"""Pressure over deployments: the window, and how far a robot gets at its working pressure."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from vinefab.core.validation import Floats
from vinefab.core.view import Data, Number, Picture, Rows, Section
from vinefab.fabrication.rules.catalog import RULES
from vinefab.growth.batch import Batch, GrowthBlock
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.model.deployment import Stop
from vinefab.model.design import Design
from vinefab.model.laser import LaserProfile
from vinefab.model.quantity import Standing
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    ALERT,
    INK,
    LEVEL_COLOURS,
    SOFT,
    TICK_PT,
    Ink,
    Page,
    Panel,
    level_colour,
    page_of,
    upright,
)
from vinefab.physics.growth_pressure import FITTED, FITTED_DIAMETER_MM, FITTED_DIAMETER_RANGE_MM
from vinefab.physics.tube import (
    burst_pressure_kpa,
    hoop_strain,
    inflated_diameter_mm,
    seam_load_n_mm,
)
from vinefab.prediction.family_deployments import PreparedFamily
from vinefab.prediction.measures import LOOSE_PRESSURE, TIGHT_PRESSURE, MeasureTable
from vinefab.search.record.winner import PressureRoom, WinnerPressure


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelPressure:
    """Pressure limits of one lay-flat width."""

    name: str  # which part has the width
    level: int  # its level, for colours
    # width_mm, inflated_mm: lay-flat width and inflated diameter
    width_mm: float
    inflated_mm: float
    burst_kpa: float  # pressure that its seam stands: known to burst there, or to survive it
    allowed_kpa: float  # that over the safety factor
    strain_percent: float  # hoop strain at the working pressure


@dataclass(frozen=True, slots=True, kw_only=True)
class Need:
    """Pressure that growth to the worst tip needs, over deployments."""

    storage: str  # how the film is stored: ``loosely`` or ``tightly``
    # percentiles over deployments, and the greatest value
    p05_kpa: float
    median_kpa: float
    p95_kpa: float
    greatest_kpa: float
    enough_percent: float  # share of the deployments that need no more than is allowed


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureWindow:
    """The pressure for growth to the worst tip, and the limit of the widest part."""

    # loose, tight: need with film that nothing holds back in its store, and on a tight spool
    loose: Need
    tight: Need
    working_kpa: float  # the design's working pressure
    levels: tuple[LevelPressure, ...]  # limits of the widest, trunk first, pouches last
    safety_factor: float  # burst over allowed pressure
    standing: Standing  # of burst pressures

    @property
    def allowed_kpa(self) -> float:
        """The largest pressure allowed for every width."""
        return min(level.allowed_kpa for level in self.levels)

    @property
    def needed_kpa(self) -> float:
        """Pressure that 95 % of the deployments grow with, if the film is stored loosely."""
        return self.loose.p95_kpa

    @property
    def is_open(self) -> bool:
        """Whether some pressure grows the robot without bursting it."""
        return self.needed_kpa < self.allowed_kpa

    @property
    def is_open_tight(self) -> bool:
        """Whether the window is open even with film on a tight spool."""
        return self.tight.p95_kpa < self.allowed_kpa

    @property
    def holds_working(self) -> bool:
        """Whether the working pressure lies in the window."""
        return self.needed_kpa <= self.working_kpa <= self.allowed_kpa

    @property
    def words(self) -> str:
        """Whether the robot is deployable at its working pressure, after "manufacturable"."""
        if not self.is_open:
            return (
                f"but hardly deployable: growth to the worst tip needs {self.needed_kpa:.1f} kPa "
                "even with film stored loosely, and its widest part is limited to "
                f"{self.allowed_kpa:.1f} kPa"
            )
        room = f"{self.needed_kpa:.1f} to {self.allowed_kpa:.1f} kPa"
        if not self.holds_working:
            return (
                f"and deployable at {room}; its working pressure of {self.working_kpa:g} kPa is "
                "outside this window"
            )
        return f"and deployable at {room} with film stored loosely"

    @property
    def room(self) -> PressureRoom:
        """The window as results and records have it."""
        return PressureRoom(
            is_open=self.is_open,
            needed_kpa=round(self.needed_kpa, 1),
            allowed_kpa=round(self.allowed_kpa, 1),
            working_kpa=self.working_kpa,
            safety_factor=self.safety_factor,
            standing=self.standing,
        )

    @property
    def of_winner(self) -> WinnerPressure:
        """The window as the record of a run has it."""
        return WinnerPressure(
            **asdict(self.room), holds_working=self.holds_working, words=self.words
        )

    @property
    def highest_kpa(self) -> float:
        """The largest pressure that a picture of it has to show."""
        return max(
            self.tight.p95_kpa, self.working_kpa, *(level.allowed_kpa for level in self.levels)
        )


def window_of(
    design: Design, profile: LaserProfile, families: Sequence[MeasureTable]
) -> PressureWindow | None:
    """Return the pressure window over all deployments, or None where nothing ever emerged."""
    loose, tight = (
        np.concatenate([outcomes.values[measure.key] for outcomes in families])
        for measure in (LOOSE_PRESSURE, TIGHT_PRESSURE)
    )
    return window_over(design, profile, loose, tight)


def window_over(
    design: Design, profile: LaserProfile, loose: Floats, tight: Floats
) -> PressureWindow | None:
    """Return the pressure window of a design, or None where nothing ever emerged.

    Parameters
    ----------
    loose, tight
        Pressure that growth to the worst tip needs in each deployment, kPa, shape (n,), with film
        that is stored loosely and tightly; NaN where nothing emerged.
    """
    factor = RULES["VF-P01"].limits["safety_factor"]
    film, build = profile.material, design.build
    stands_n_mm = seam_load_n_mm(film.seam)
    parts = [(one.name, one.level, one.width_mm) for one in design.tubes]
    pouches = {pouch.flat_width_mm for pouch in design.pouches if pouch is not None}
    parts += [("pouch", design.depth + 1, width_mm) for width_mm in sorted(pouches, reverse=True)]
    # A robot of many widths is told by the widest ones: these stand the least.
    most_parts = 12
    widest = sorted(parts, key=lambda part: -part[2])[:most_parts]
    found = []
    for name, level, width_mm in (part for part in parts if part in widest):
        burst_kpa = burst_pressure_kpa(width_mm, stands_n_mm)
        strain = hoop_strain(
            build.pressure_kpa, width_mm, film.ply_mm.value, film.modulus_mpa.value
        )
        found.append(
            LevelPressure(
                name=name,
                level=level,
                width_mm=width_mm,
                inflated_mm=inflated_diameter_mm(width_mm),
                burst_kpa=burst_kpa,
                allowed_kpa=burst_kpa / factor,
                strain_percent=100.0 * strain,
            )
        )
    allowed_kpa = min(level.allowed_kpa for level in found)
    if not np.isfinite(loose).any():
        return None
    measured = film.seam.is_measured_limit
    return PressureWindow(
        loose=_need("loosely", loose, allowed_kpa),
        tight=_need("tightly", tight, allowed_kpa),
        working_kpa=design.build.pressure_kpa,
        levels=tuple(found),
        safety_factor=factor,
        standing=Standing.MEASURED if measured else Standing.ASSUMED,
    )


def burst_basis(profile: LaserProfile) -> str:
    """Return the basis of burst pressures and strains, as text."""
    film = profile.material
    return (
        f"from one test: {film.seam.words()}; strain "
        f"with a modulus of {film.modulus_mpa.value:g} MPa ({film.modulus_mpa.standing})"
    )


def _need(storage: str, needed_kpa: Floats, allowed_kpa: float) -> Need:
    known = needed_kpa[np.isfinite(needed_kpa)]
    p05, median, p95 = (float(value) for value in np.percentile(known, [5.0, 50.0, 95.0]))
    return Need(
        storage=storage,
        p05_kpa=p05,
        median_kpa=median,
        p95_kpa=p95,
        greatest_kpa=float(known.max()),
        enough_percent=100.0 * float((known <= allowed_kpa).mean()),
    )


def window_blocks(window: PressureWindow, basis: str) -> Iterator[Data | Section]:
    """Yield the pressure window as a chart and numbers; ``basis``: of burst pressures."""
    kpa = partial(Number, form=".1f", decimals=1)
    mm = partial(Number, form=".2f", decimals=2)
    yield Data({"pressure_window": window.room.content})
    words = (
        "A robot can be deployed where the pressure that growth to the worst tip needs lies below "
        "what its widest part may take. Narrow branches after many turns need most; wide tubes "
        "burst first. How the film is stored decides much and is not known: stored loosely, "
        "nothing holds it back; tightly, it is drawn off a spool."
    )
    needs = Rows(
        caption="Pressure to grow to the worst tip over deployments (simulated paths; nested "
        "capstan with published constants, scaled by 1/diameter from a tube whose diameter is "
        "assumed)",
        headings=("film stored", "5 % kPa", "median kPa", "95 % kPa", "greatest kPa", "enough for"),
        rows=tuple(
            (need.storage, kpa(need.p05_kpa), kpa(need.median_kpa), kpa(need.p95_kpa),
             kpa(need.greatest_kpa), kpa(need.enough_percent, "%"))
            for need in (window.loose, window.tight)
        ),
        key="pressure_window.needs",
        keys=("film_stored", "p05_kpa", "median_kpa", "p95_kpa", "greatest_kpa", "enough_percent"),
    )  # fmt: skip
    stands = Rows(
        caption=f"What each width stands, over allowed {window.safety_factor:g} (assumed), "
        f"and how far it stretches at the working pressure of {window.working_kpa:g} kPa; "
        f"{basis}",
        headings=(
            "part", "lay-flat mm", "inflated mm", "seam stands kPa", "may take kPa", "hoop strain",
        ),
        rows=tuple(
            (level.name, mm(level.width_mm), mm(level.inflated_mm), kpa(level.burst_kpa),
             kpa(level.allowed_kpa), Number(round(level.strain_percent), "%", "d"))
            for level in window.levels
        ),
        key="pressure_window.widths",
        keys=("part", "width_mm", "inflated_mm", "burst_kpa", "allowed_kpa", "strain_percent"),
    )  # fmt: skip
    picture = Picture(
        image=lambda: page_svg(window_chart(window)),
        caption="Bars of growth: 5 to 95 % of the deployments, line at the median (simulated). "
        "Bars of widths: what they may take; line at what their seams stand "
        f"({window.standing.value}).",
    )
    note = (
        f"'Enough for' is the share of the deployments that grow in full with the "
        f"{window.allowed_kpa:.1f} kPa that every width may take."
    )
    yield Section(
        title="Pressure window",
        paragraphs=(words, note),
        pictures=(picture,),
        tables=(needs, stands),
        folded=True,
    )


_OPEN = "#1b7f4d"


def window_chart(window: PressureWindow) -> Page:
    """Return the need of growth, the limit of each width, and the room between the two."""
    rows = 2 + len(window.levels)
    low, high = window.needed_kpa, window.allowed_kpa
    panel = Panel(
        box=(0.0, rows - 0.5, 1.06 * window.highest_kpa, -1.2),
        width_pt=300.0,
        height_pt=27.0 * (rows + 0.7),
        x_name="pressure (kPa)",
        frame=True,
        y_grid=False,
    )
    if window.is_open:
        panel.title, panel.title_colour = f"window {low:.1f} to {high:.1f} kPa", _OPEN
    else:
        panel.title, panel.title_colour = f"no window: {low - high:.1f} kPa missing", ALERT
    panel.title_bold = True
    room = (min(low, high), rows - 0.5, max(low, high), -1.2)
    panel.bars([room], panel.title_colour, 0.16 if window.is_open else 0.10)
    upright(panel, high, (rows - 0.5, -1.2), SOFT, 1.0)
    names = []
    for row, need in enumerate((window.loose, window.tight)):
        colour = LEVEL_COLOURS[1]
        panel.bars([(need.p05_kpa, row + 0.25, need.p95_kpa, row - 0.25)], colour, 0.45)
        for value, weight in ((need.median_kpa, 1.2), (need.p95_kpa, 2.5)):
            upright(panel, value, (row - 0.3, row + 0.3), colour, weight)
        names.append(f"growth needs, film stored {need.storage}")
    for row, level in enumerate(window.levels, start=2):
        colour = level_colour(level.level)
        panel.bars([(0.0, row + 0.25, level.allowed_kpa, row - 0.25)], colour, 0.5)
        upright(panel, level.burst_kpa, (row - 0.3, row + 0.3), colour, 2.0)
        names.append(f"{level.name} may take, {level.width_mm:.1f} mm")
    dashed = Ink(line=INK, width_pt=1.4, dash_pt=(5.0, 2.5))
    working = window.working_kpa
    panel.line([(working, rows - 0.5), (working, -1.2)], dashed)
    words = f"working pressure {working:g} kPa"
    panel.words((working, -0.86), words, TICK_PT, shift_pt=(4.0, 0.0))
    panel.y_ticks = list(enumerate(names))
    return page_of(panel)


# --- How far a robot gets at its working pressure -------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureReach:
    """How far a robot gets at its working pressure, under one set of assumptions."""

    storage: str  # how the film is stored: ``loosely`` or ``tightly``
    fitted_diameter_mm: float  # diameter of the tube that the constants were fitted to
    grown_percent: float  # mean length grown
    stopped_percent: float  # share of the branches that ran out of pressure
    full_percent: float  # share of the deployments in which no branch did
    # pressure with which 95 % of the deployments grow to every tip; None if no trunk ever left
    needed_kpa: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureRange:
    """How far a robot gets at its working pressure, over what is assumed."""

    label: str  # of the map family
    deployments: int
    working_kpa: float
    reaches: tuple[PressureReach, ...]  # loosely stored first, by rising diameter


_DIAMETERS_MM = (FITTED_DIAMETER_RANGE_MM[0], FITTED_DIAMETER_MM.value, FITTED_DIAMETER_RANGE_MM[1])


def pressure_range(
    design: Design, prepared: PreparedFamily, options: GrowthOptions, measured: MeasureTable
) -> PressureRange | None:
    """Return how far a design gets at its working pressure; None if it has none.

    Parameters
    ----------
    measured
        The family's measures; growth pressures are inverse to the fitted diameter, so that the
        pressures in it give the need of every other assumption.
    """
    working_kpa = design.build.pressure_kpa
    if working_kpa <= 0.0:
        return None
    reaches = []
    for storage, tension_kpa, measure in (
        ("loosely", 0.0, LOOSE_PRESSURE),
        ("tightly", FITTED.storage_kpa.value, TIGHT_PRESSURE),
    ):
        values = measured.values[measure.key]
        known_kpa = values[np.isfinite(values)]
        usual_kpa = float(np.percentile(known_kpa, 95.0)) if len(known_kpa) else None
        for diameter_mm in _DIAMETERS_MM:
            pressed = options.changed(
                pressure_stop=True,
                storage_kpa=tension_kpa,
                fitted_diameter_mm=diameter_mm,
            )
            grown, stopped, full = _pressed(design, prepared, pressed)
            reaches.append(
                PressureReach(
                    storage=storage,
                    fitted_diameter_mm=diameter_mm,
                    grown_percent=grown,
                    stopped_percent=stopped,
                    full_percent=full,
                    needed_kpa=None
                    if usual_kpa is None
                    else usual_kpa * diameter_mm / FITTED_DIAMETER_MM.value,
                )
            )
    return PressureRange(
        label=prepared.label,
        deployments=len(measured),
        working_kpa=working_kpa,
        reaches=tuple(reaches),
    )


def _pressed(
    design: Design, prepared: PreparedFamily, options: GrowthOptions
) -> tuple[float, float, float]:
    """Return grown length, stopped branches and deployments without any, in percent."""

    def measured(block: GrowthBlock) -> Floats:
        edges = block.branch[:-1]
        stopped = np.add.reduceat((block.growth.stop == Stop.PRESSURE).astype(np.float64), edges)
        grown = np.add.reduceat(block.growth.grown, edges) / block.planned_mm()
        return np.array([grown, stopped / np.diff(block.branch), stopped == 0.0])

    batch = Batch(Plans.of([design], options), prepared.launches(), options)
    grown, stopped, full = np.concatenate(list(batch.each(measured)), axis=1).mean(axis=1).tolist()
    return 100.0 * grown, 100.0 * stopped, 100.0 * full
