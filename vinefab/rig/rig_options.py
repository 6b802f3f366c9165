"""What a user chooses about a rig: its sizes and style, and the printer."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from annotated_types import Ge, Interval, Unit
from pydantic import Field, create_model, model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError, located
from vinefab.core.limits import DEFAULT_MARKER_MM, SMALLEST
from vinefab.core.table import Table, declared_keys, validated
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import read_toml
from vinefab.model.laser import Quantity

if TYPE_CHECKING:
    from vinefab.model.map import Map

MOST_PARTS = 2000
"""Most parts that may be asked for: every one is a solid, a file and a place on a bed."""

GRID_MM = 1e-3
"""Plans are snapped to this grid: far below what a printer can do, far above what single
precision (STL) resolves at the size of a bed, so that no two corners melt into one in the file."""

Mm = Annotated[float, Unit("mm")]
MmIfGiven = Annotated[float | None, Unit("mm")]


def _within(low: float, high: float) -> Interval:
    return Interval(ge=low, le=high)


_SIZE, _DETAIL = _within(SMALLEST, 1e4), _within(SMALLEST, 100)
Speed = Annotated[float, _within(SMALLEST, 1e4), Unit("mm/s"), Doc("of the nozzle")]


class Printer(Table):
    """A printer's limits; from ``layer_mm`` on for estimates only."""

    name: Annotated[str, Doc("file name of its profile")]
    bed_width_mm: Annotated[Mm, _SIZE, Doc("of the build volume")]
    bed_depth_mm: Annotated[Mm, _SIZE, Doc("of the build volume")]
    height_mm: Annotated[Mm, _SIZE, Doc("of the build volume")]
    nozzle_mm: Annotated[Mm, _SIZE, Doc("diameter of the nozzle")] = 0.4
    least_wall_mm: Annotated[Mm, _DETAIL, Doc("thinnest wall that prints")] = 0.8
    clearance_mm: Annotated[Mm, _DETAIL, Doc("gap between parts that fit together")] = 0.2
    layer_mm: Annotated[Mm, _DETAIL, Doc("height of a layer")] = 0.2
    shell_mm: Annotated[Mm, _DETAIL, Doc("thickness of the skin")] = 0.8
    infill: Annotated[float, _within(0, 1), Doc("share of the inside that is filled")] = 0.15
    wall_speed_mm_s: Speed = 80.0
    fill_speed_mm_s: Speed = 100.0
    travel_speed_mm_s: Speed = 150.0
    acceleration_mm_s2: Annotated[
        float, _within(SMALLEST, 1e6), Unit("mm/s2"), Doc("of the nozzle")
    ] = 2000.0
    flow_mm3_s: Annotated[
        float | None,
        _within(SMALLEST, 1000),
        Unit("mm3/s"),
        Doc("mean extrusion rate of whole parts, measured: takes the place of the speeds"),
    ] = None
    layer_change_s: Annotated[float, _within(0, 3600), Unit("s"), Doc("extra time per layer")] = 1.0
    filament_mm: Annotated[Mm, _DETAIL, Doc("diameter of the filament")] = 1.75
    density_g_cm3: Annotated[
        float, _within(SMALLEST, 30), Unit("g/cm3"), Doc("of the filament")
    ] = 1.24


def _form_of_printers() -> type[Table]:
    """Return the form of a printer's file: every number of `Printer` with its standing."""
    version = Doc("kind of file and its version")
    fields: dict[str, Any] = {
        "schema_": (Annotated[Literal["vinefab/printer-1"], Field(alias="schema"), version], ...),
        "title": (Annotated[str, Doc("for people")], ...),
    }
    held: tuple[Any, Any] = (Quantity, ...)
    for key in declared_keys(Printer):
        if key.field == "layer_mm":  # from here on for estimates only
            held = (Quantity | None, None)
        if key.field != "name":
            fields[key.field] = (Annotated[held[0], Unit(key.unit), Doc(key.meaning)], held[1])
    doc = "A file in ``laser_profiles/printers``; what is for estimates only may be left out."
    return create_model("PrinterForm", __base__=Table, __doc__=doc, **fields)


PrinterForm = _form_of_printers()


def read_printer(name_or_path: str | Path) -> Printer:
    """Read a printer's profile.

    Every number in the file is a table of ``value``, ``standing`` (measured, paper, published,
    computed or assumed) and ``source``, so that a guess is never taken for a measurement.
    """
    path = locate("printer", name_or_path)
    form = validated(PrinterForm, read_toml(path), path)
    with located(path):
        values = {name: held.value for name, held in form if isinstance(held, Quantity)}
        return Printer(name=path.stem, **values)


class RigOptions(Table):
    """Sizes of a rig, as printed.

    Style ``plate`` is obstacles printed on their plate, ``board`` printed obstacles with pegs on a
    board that a laser cuts and drills, ``auto`` the quicker of these to print. A start at most
    ``entry_reach_mm`` from the bounds, measured backwards along its heading, gets an opening in the
    border; one further away gets a round hole through the plate.
    """

    style: Annotated[
        Literal["auto", "plate", "board"], Doc("plate, board, or the quicker to print")
    ] = "auto"
    plate_mm: Annotated[Mm, _within(0.2, 100), Doc("thickness of base plate or board")] = 3.0
    height_mm: Annotated[Mm, _within(0.2, 1e4), Doc("height of obstacles and border")] = 30.0
    border_mm: Annotated[
        Mm, _within(0.2, 1000), Doc("thickness of the wall around the bounds, outside of them")
    ] = 4.0
    entry_width_mm: Annotated[
        Mm,
        _within(0, 1e4),
        Doc("width of the entry; the start's sideways spread comes on top; 0: none"),
    ] = 40.0
    entry_reach_mm: Annotated[
        Mm, _within(0, 1e4), Doc("farthest from the bounds that a start has an entry")
    ] = 60.0
    wall_mm: Annotated[
        MmIfGiven,
        _within(0, 100),
        Doc("walls of hollow obstacles: whole lines of the nozzle, else its least; 0: solid"),
    ] = None
    top_mm: Annotated[Mm, Ge(0), Doc("closed top of loose obstacles; 0: open")] = 0.0
    scale: Annotated[float, _within(SMALLEST, 1e3), Doc("rig mm per map mm")] = 1.0
    clearance_mm: Annotated[
        MmIfGiven,
        _within(0, 5),
        Doc("gap around what is pushed into each other, else the printer's"),
    ] = None
    joint: Annotated[Literal["dovetail", "none"], Doc("what holds tiles together")] = "dovetail"
    mark_depth_mm: Annotated[
        Mm, _within(0, 5), Doc("depth of number and north arrow in the underside of tiles; 0: none")
    ] = 0.4
    peg_mm: Annotated[Mm, _within(1, 50), Doc("diameter of the pegs of loose obstacles")] = 5.0
    kerf_mm: Annotated[Mm, _within(0, 2), Doc("width that the laser removes")] = 0.2
    sheet_width_mm: Annotated[Mm, _within(100, 1e4), Doc("width of the laser's sheets")] = 1000.0
    sheet_depth_mm: Annotated[Mm, _within(100, 1e4), Doc("depth of the laser's sheets")] = 600.0
    bed_margin_mm: Annotated[Mm, _within(0, 1000), Doc("rim of the bed that stays free")] = 5.0
    sliver_mm: Annotated[
        Mm, _within(0, 1), Doc("loose pieces and gaps thinner than this are left out, and counted")
    ] = 0.05
    most_parts: Annotated[int, _within(1, MOST_PARTS), Doc("more parts are refused")] = 100
    markers: Annotated[
        Literal["print", "paper", "engrave", "none"] | None,
        Doc(
            "corner markers for photos: print (raised black cells), paper (a place for a paper "
            "marker), engrave (into the board; where there is one, the default) or none"
        ),
    ] = None
    marker_mm: Annotated[Mm, _within(12, 1000), Doc("side of a marker with its black frame")] = (
        DEFAULT_MARKER_MM
    )
    base_start: Annotated[
        int | None,
        _within(0, 10_000),
        Doc("start, from 1, that gets a holder for the base; else the first, if it fits; 0: none"),
    ] = None
    collar_mm: Annotated[
        MmIfGiven, _within(3, 300), Doc("outer diameter of the base's tube, else the design's")
    ] = None

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.top_mm > self.height_mm:
            allowed = f"at most the height, {self.height_mm:g} mm"
            raise BadInputError("top_mm", self.top_mm, allowed)
        if self.mark_depth_mm > 0.5 * self.plate_mm:
            allowed = f"at most half of the plate, {0.5 * self.plate_mm:g} mm"
            raise BadInputError("mark_depth_mm", self.mark_depth_mm, allowed)
        if self.markers == "engrave" and self.style == "plate":
            allowed = "print, paper or none for style plate, which has no board"
            raise BadInputError("markers", self.markers, allowed)
        return self

    @property
    def marker_kind(self) -> str:
        """How the corner markers are made: what was asked for, or what suits the style."""
        return self.markers or ("print" if self.style == "plate" else "engrave")

    def gap_mm(self, printer: Printer) -> float:
        """Return the gap around what is pushed into each other."""
        return printer.clearance_mm if self.clearance_mm is None else self.clearance_mm

    def fitted(self, world: "Map", side_mm: float) -> "RigOptions":
        """Return the options with the scale at which the rig's longer side has some length."""
        room_mm = side_mm - 2.0 * self.border_mm
        if not room_mm > 0.0:
            allowed = f"more than the border on both sides, {2.0 * self.border_mm:g} mm"
            raise BadInputError("--fit-mm", side_mm, allowed)
        return self.changed(scale=room_mm / max(world.size_mm))
