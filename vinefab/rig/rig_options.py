"""What a user chooses about a rig: its sizes and style, and the printer."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from pydantic import Field

from vinefab.core.errors import BadInputError, located
from vinefab.core.validation import number, positive, whole
from vinefab.model.corner_marker import DEFAULT_MARKER_MM
from vinefab.model.files.profile_toml import QuantityForm
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import Form, read_toml, validated
from vinefab.model.map import Map

MOST_PARTS = 2000
"""Most parts that may be asked for: every one is a solid, a file and a place on a bed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Printer:
    """A printer's limits."""

    name: str  # file name of its profile
    # bed_width_mm, bed_depth_mm, height_mm: of the build volume
    bed_width_mm: float
    bed_depth_mm: float
    height_mm: float
    nozzle_mm: float = 0.4  # diameter
    least_wall_mm: float = 0.8  # thinnest wall that prints
    clearance_mm: float = 0.2  # gap between parts that fit together
    # the rest is for estimates only
    layer_mm: float = 0.2  # height of a layer
    shell_mm: float = 0.8  # thickness of the skin
    infill: float = 0.15  # share of the inside that is filled
    # wall_speed_mm_s, fill_speed_mm_s, travel_speed_mm_s: of the nozzle
    wall_speed_mm_s: float = 80.0
    fill_speed_mm_s: float = 100.0
    travel_speed_mm_s: float = 150.0
    acceleration_mm_s2: float = 2000.0  # of the nozzle
    # mean extrusion rate of whole parts; where one was measured, it takes the place of the speeds
    flow_mm3_s: float | None = None
    layer_change_s: float = 1.0  # extra time per layer
    filament_mm: float = 1.75  # diameter
    density_g_cm3: float = 1.24  # of the filament

    def __post_init__(self) -> None:
        for name in ("bed_width_mm", "bed_depth_mm", "height_mm", "nozzle_mm"):
            positive(f"printer.{name}", getattr(self, name), 10_000.0)
        for name in ("least_wall_mm", "clearance_mm", "layer_mm", "shell_mm", "filament_mm"):
            positive(f"printer.{name}", getattr(self, name), 100.0)
        number("printer.infill", self.infill, 0.0, 1.0)
        for name in ("wall_speed_mm_s", "fill_speed_mm_s", "travel_speed_mm_s"):
            positive(f"printer.{name}", getattr(self, name), 10_000.0, "mm/s")
        positive("printer.acceleration_mm_s2", self.acceleration_mm_s2, 1e6, "mm/s2")
        if self.flow_mm3_s is not None:
            positive("printer.flow_mm3_s", self.flow_mm3_s, 1000.0, "mm3/s")
        number("printer.layer_change_s", self.layer_change_s, 0.0, 3600.0, "s")
        positive("printer.density_g_cm3", self.density_g_cm3, 30.0, "g/cm3")


class PrinterForm(Form):
    """A file in ``laser_profiles/printers``; what is for estimates only may be left out."""

    schema_: Literal["vinefab/printer-1"] = Field(alias="schema")
    title: str
    bed_width_mm: QuantityForm
    bed_depth_mm: QuantityForm
    height_mm: QuantityForm
    nozzle_mm: QuantityForm
    least_wall_mm: QuantityForm
    clearance_mm: QuantityForm
    layer_mm: QuantityForm | None = None
    shell_mm: QuantityForm | None = None
    infill: QuantityForm | None = None
    wall_speed_mm_s: QuantityForm | None = None
    fill_speed_mm_s: QuantityForm | None = None
    travel_speed_mm_s: QuantityForm | None = None
    acceleration_mm_s2: QuantityForm | None = None
    flow_mm3_s: QuantityForm | None = None
    layer_change_s: QuantityForm | None = None
    filament_mm: QuantityForm | None = None
    density_g_cm3: QuantityForm | None = None


def read_printer(name_or_path: str | Path) -> Printer:
    """Read a printer's profile.

    Every number in the file is a table of ``value``, ``standing`` (measured, paper, published,
    computed or assumed) and ``source``, so that a guess is never taken for a measurement.
    """
    path = locate("printer", name_or_path)
    form = validated(PrinterForm, read_toml(path), path)
    with located(path):
        values = ((name, getattr(form, name)) for name in PrinterForm.model_fields)
        given = {name: held.value for name, held in values if isinstance(held, QuantityForm)}
        return Printer(name=path.stem, **given)


STYLES = ("auto", "plate", "board")
"""``auto`` is plate or board, the quicker to print: `vinefab.rig.make` chooses."""

JOINTS = ("dovetail", "none")

MARKERS = ("print", "paper", "engrave", "none")

GRID_MM = 1e-3
"""Plans are snapped to this grid: far below what a printer can do, far above what single
precision (STL) resolves at the size of a bed, so that no two corners melt into one in the file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RigOptions:
    """Sizes of a rig, as printed.

    Parameters
    ----------
    style
        ``auto`` (``plate`` or ``board``, what prints quicker), ``plate`` (obstacles printed on
        their plate) or ``board`` (printed obstacles with pegs on a board that a laser cuts and
        drills).
    plate_mm
        Thickness of the base plate, or of the board.
    height_mm
        Height of obstacles and border above the plate.
    border_mm
        Thickness of the wall around the bounds; it stands outside the free space.
    entry_width_mm
        Width of the opening for the robot's base; the start's sideways spread comes on top.
        0: no opening.
    entry_reach_mm
        A start at most this far from the bounds, measured backwards along its heading, gets an
        opening in the border; one further away gets a round hole through the plate.
    wall_mm
        Thickness of the walls of hollow obstacles and borders, whole lines of the printer's nozzle;
        None: its least wall in whole lines; 0: solid.
    top_mm
        Thickness of the closed top of loose obstacles; 0: open.
    scale
        Rig millimetres per map millimetre.
    clearance_mm
        Gap around what is pushed into each other; the printer's own when None.
    joint
        What holds neighbouring tiles together: ``dovetail`` (in the plate) or ``none``.
    mark_depth_mm
        Depth of number and north arrow, engraved into the underside of each tile; 0: none.
    peg_mm
        Diameter of the pegs of loose obstacles.
    kerf_mm
        Width that the laser removes from board and lid.
    sheet_width_mm, sheet_depth_mm
        Size of the sheets that it takes.
    bed_margin_mm
        Rim of the printer's bed that stays free.
    sliver_mm
        Free-standing pieces of obstacle and enclosed gaps thinner than this everywhere are left
        out, and counted.
    most_parts
        A rig that needs more parts is refused.
    markers
        Corner markers by which a photo is rectified: ``print`` (tiles with raised black cells),
        ``paper`` (tiles with a recess for a paper marker; on a board, its outline), ``engrave``
        (into the board) or ``none``. When None: engraved where there is a board, else printed.
    marker_mm
        Side of a marker, its black frame included.
    base_start
        Number, from 1, of the start that gets a holder for the robot's base; 0: none. When None:
        the first start, if a holder can stand there.
    collar_mm
        Outer diameter of the base's tube, which the tail is slipped over; the design's when None.

    Raises
    ------
    BadInputError
        If a value is out of range.
    """

    style: str = "auto"
    plate_mm: float = 3.0
    height_mm: float = 30.0
    border_mm: float = 4.0
    entry_width_mm: float = 40.0
    entry_reach_mm: float = 60.0
    wall_mm: float | None = None
    top_mm: float = 0.0
    scale: float = 1.0
    clearance_mm: float | None = None
    joint: str = "dovetail"
    mark_depth_mm: float = 0.4
    peg_mm: float = 5.0
    kerf_mm: float = 0.2
    sheet_width_mm: float = 1000.0
    sheet_depth_mm: float = 600.0
    bed_margin_mm: float = 5.0
    sliver_mm: float = 0.05
    most_parts: int = 100
    markers: str | None = None
    marker_mm: float = DEFAULT_MARKER_MM
    base_start: int | None = None
    collar_mm: float | None = None

    def __post_init__(self) -> None:
        number("rig.plate_mm", self.plate_mm, 0.2, 100.0, "mm")
        number("rig.height_mm", self.height_mm, 0.2, 10_000.0, "mm")
        number("rig.border_mm", self.border_mm, 0.2, 1000.0, "mm")
        number("rig.entry_width_mm", self.entry_width_mm, 0.0, 10_000.0, "mm")
        number("rig.entry_reach_mm", self.entry_reach_mm, 0.0, 10_000.0, "mm")
        if self.wall_mm is not None:
            number("rig.wall_mm", self.wall_mm, 0.0, 100.0, "mm")
        number("rig.top_mm", self.top_mm, 0.0, self.height_mm, "mm")
        positive("rig.scale", self.scale, 1e3, "rig mm per map mm")
        if self.clearance_mm is not None:
            number("rig.clearance_mm", self.clearance_mm, 0.0, 5.0, "mm")
        if self.joint not in JOINTS:
            raise BadInputError("rig.joint", self.joint, f"one of {', '.join(JOINTS)}")
        if self.style not in STYLES:
            raise BadInputError("rig.style", self.style, f"one of {', '.join(STYLES)}")
        number("rig.peg_mm", self.peg_mm, 1.0, 50.0, "mm")
        number("rig.kerf_mm", self.kerf_mm, 0.0, 2.0, "mm")
        number("rig.sheet_width_mm", self.sheet_width_mm, 100.0, 10_000.0, "mm")
        number("rig.sheet_depth_mm", self.sheet_depth_mm, 100.0, 10_000.0, "mm")
        number("rig.mark_depth_mm", self.mark_depth_mm, 0.0, 5.0, "mm")
        if self.mark_depth_mm > 0.5 * self.plate_mm:
            allowed = f"at most half of the plate, {0.5 * self.plate_mm:g} mm"
            raise BadInputError("rig.mark_depth_mm", self.mark_depth_mm, allowed)
        number("rig.bed_margin_mm", self.bed_margin_mm, 0.0, 1000.0, "mm")
        number("rig.sliver_mm", self.sliver_mm, 0.0, 1.0, "mm")
        whole("rig.most_parts", self.most_parts, 1, MOST_PARTS)
        self._check_fixtures()

    def _check_fixtures(self) -> None:
        number("rig.marker_mm", self.marker_mm, 12.0, 1000.0, "mm")
        if self.markers is not None and self.markers not in MARKERS:
            raise BadInputError("rig.markers", self.markers, f"one of {', '.join(MARKERS)}")
        if self.markers == "engrave" and self.style == "plate":
            allowed = "print, paper or none for style plate, which has no board"
            raise BadInputError("rig.markers", self.markers, allowed)
        if self.base_start is not None:
            whole("rig.base_start", self.base_start, 0, 10_000)
        if self.collar_mm is not None:
            number("rig.collar_mm", self.collar_mm, 3.0, 300.0, "mm")

    @property
    def marker_kind(self) -> str:
        """How the corner markers are made: what was asked for, or what suits the style."""
        return self.markers or ("print" if self.style == "plate" else "engrave")

    def gap_mm(self, printer: Printer) -> float:
        """Return the gap around what is pushed into each other."""
        return printer.clearance_mm if self.clearance_mm is None else self.clearance_mm

    def fitted(self, world: Map, side_mm: float) -> "RigOptions":
        """Return the options with the scale at which the rig's longer side has some length."""
        room_mm = side_mm - 2.0 * self.border_mm
        if not room_mm > 0.0:
            allowed = f"more than the border on both sides, {2.0 * self.border_mm:g} mm"
            raise BadInputError("--fit-mm", side_mm, allowed)
        return replace(self, scale=room_mm / max(world.size_mm))
