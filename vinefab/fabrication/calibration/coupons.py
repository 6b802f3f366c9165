"""Coupons: test pieces, the energy matrix, and the table of results that is filled in and read.

The pieces measure kerf, seam, widths, burst pressure, fillets and joints. Every piece that is
inflated is a small robot: a design, outlined like any robot, with the recipe's offsets, and cut as
drawn, without compensation. A label next to it names the measurement.
"""

import csv
import io
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from shapely import box

from vinefab.core.errors import BadInputError, UnfitInputError, UnknownNameError
from vinefab.core.limits import STANDARD_GRAVITY_M_S2
from vinefab.core.plain_text import GENERATOR, counted
from vinefab.core.validation import Floats
from vinefab.fabrication.job.laser_job import laser_job, recipe_facts
from vinefab.fabrication.job.marks import fold_ticks, lettered
from vinefab.fabrication.job.passes import body_paths, sleeve_size, weldcut_offset_mm
from vinefab.fabrication.job.tiling import registration
from vinefab.fabrication.processes import WORDS
from vinefab.model.design import Branch, Build, Design, Level, PieceSettings, Pouch
from vinefab.model.files.shipped import read_text
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LapMethod, LaserProfile
from vinefab.model.machine import LaserMachine, LaserSettings
from vinefab.model.map import Map
from vinefab.model.outline import Contour
from vinefab.model.quantity import Quantity, Standing
from vinefab.model.start import Pose, Start
from vinefab.outline.body_outline import WHOLE_ROBOT, PieceEnds
from vinefab.outline.ends import OpenEnd
from vinefab.physics.tube import spot_at_mm

LADDER_MM = (5.0, 8.0, 10.0, 16.0, 20.0, 30.0, 40.0)
LENGTHS_MM = {40.0: 2, 160.0: 1, 280.0: 2}
"""Fingers of each length: most at the ends, which say most of a slope."""
FILLETS_MM = (2.0, 4.0, 8.0)
BALLOONS = 3
SQUARE_MM = 50.0
STRIP_MM = (80.0, 25.0)
STRIPS = 2
LAP_WIDTHS_MM = (10.0, 20.0)
LAP_COPIES = 3
LAP_MM = PieceSettings().lap_mm
JOINT_WIDTHS_MM = (20.0, 40.0)
JOINTS_DEG = {
    **{f"PAIR-{fan}": (-fan / 2.0, fan / 2.0) for fan in (40, 60, 80, 120)},
    "ELBOW-60": (60.0,),
}
"""Flat angles of the children of each kind of joint coupon."""
JOINT_KPA = 20.0
"""Pressure at which joint coupons are measured: that of robots whose own is not known."""
LETTER_MM = 4.0
_LADDER_LENGTH_MM, _LADDER_TAIL_MM = 40.0, 10.0
_LAP_TUBE_MM, _LAP_CLAMP_MM = 45.0, 30.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coupon:
    """One coupon."""

    name: str  # written next to it
    paths: tuple[LaserPath, ...]  # in process order, label included
    design: Design | None = None  # None for a piece that is not a robot
    ends: PieceEnds = WHOLE_ROBOT  # of a part of the design: where it begins and ends
    job: Job | None = None  # of a whole robot, without marks
    is_optional: bool = False  # whether it may be left out where the bed is too small

    @property
    def box_mm(self) -> tuple[float, float, float, float]:
        """Least x, least y, greatest x, greatest y of all paths."""
        boxes = np.array([path.contour.box_mm for path in self.paths])
        low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def shifted(self, dx_mm: float, dy_mm: float) -> "Coupon":
        """Return the piece elsewhere."""
        paths = tuple(
            replace(path, contour=path.contour.moved(0.0, dx_mm, dy_mm)) for path in self.paths
        )
        return replace(self, paths=paths)


def coupon_pieces(profile: LaserProfile) -> tuple[Coupon, ...]:
    """Return every coupon for a recipe but the energy matrix and the joints."""
    robots = [*balloon_designs(), *crotch_designs(), *ladder_designs()]
    lengths = (robot_piece(design, profile) for design in length_designs())
    return (
        *(robot_piece(design, profile) for design in robots),
        *(replace(piece, is_optional=True) for piece in lengths),
        *lap_pieces(profile),
        *square_pieces(profile),
        *strip_pieces(profile),
    )


def balloon_designs() -> tuple[Design, ...]:
    """Return the burst balloons: a pouch of 20 x 60 mm with a narrow port for a needle."""
    balloon_mm = (60.0, 20.0)
    length, width = balloon_mm
    pouch = Pouch(shape="rectangle", length_mm=length, width_mm=width)
    port_mm = 6.0
    build = Build(
        widths_mm=(port_mm,), fillet_mm=(), tail_mm=20.0, pouch=pouch, compensation="none"
    )
    # The pouch is centred on the end of the branch: 5 mm of port stand between it and the base.
    return tuple(
        Design(name=f"BURST-{number}", trunk_length_mm=length / 2 + 5.0, build=build)
        for number in range(1, BALLOONS + 1)
    )


def ladder_designs() -> tuple[Design, ...]:
    """Return the width ladder: plain fingers from 5 to 40 mm."""
    return tuple(_finger(f"W{width:g}", width, _LADDER_LENGTH_MM) for width in LADDER_MM)


def length_designs() -> tuple[Design, ...]:
    """Return the ladder of lengths, mouth to tip: fingers of one width, which show shrinkage."""
    length_width_mm = 10.0
    tip_mm = length_width_mm / 2
    return tuple(
        _finger(f"L{length:g}-{number}", length_width_mm, length - _LADDER_TAIL_MM - tip_mm)
        for length, copies in LENGTHS_MM.items()
        for number in range(1, copies + 1)
    )


def _finger(name: str, width_mm: float, trunk_mm: float) -> Design:
    build = Build(widths_mm=(width_mm,), fillet_mm=(), tail_mm=_LADDER_TAIL_MM, compensation="none")
    return Design(name=name, trunk_length_mm=trunk_mm, build=build)


def crotch_designs() -> tuple[Design, ...]:
    """Return the crotch coupons: a trunk with two branches, each with another fillet."""
    fork = Level(branches=2, length_mm=50.0, angle_deg=60.0)
    return tuple(
        Design(
            name=f"CROTCH-R{radius:g}",
            trunk_length_mm=30.0,
            levels=(fork,),
            build=Build(
                widths_mm=(20.0, 12.0), fillet_mm=(radius,), tail_mm=10.0, compensation="none"
            ),
        )
        for radius in FILLETS_MM
    )


@cache
def joint_designs() -> tuple[Design, ...]:
    """Return the joint coupons: pairs and an elbow in two sizes, of the same shape."""
    found = []
    for width_mm in JOINT_WIDTHS_MM:
        build = Build(
            widths_mm=(width_mm, 0.6 * width_mm),
            fillet_mm=(0.15 * width_mm,),
            tail_mm=30.0,
            compensation="none",
        )
        for kind, angles_deg in JOINTS_DEG.items():
            children = [
                Branch(name=f"child-{n}", angle_deg=angle_deg, length_mm=2.5 * width_mm)
                for n, angle_deg in enumerate(angles_deg)
            ]
            found.append(
                Design(
                    name=f"{kind}-W{width_mm:g}",
                    trunk_length_mm=2.0 * width_mm,
                    branches=tuple(children),
                    build=build,
                )
            )
    return tuple(found)


def joint_coupon(name: str) -> Design:
    """Return a joint coupon by its name.

    Raises
    ------
    UnknownNameError
        If there is no such coupon.
    """
    known = {joint.name: joint for joint in joint_designs()}
    if name not in known:
        raise UnknownNameError("joint coupon", name, known)
    return known[name]


def joint_tables() -> dict[str, Map]:
    """Return the bare tables on which joint coupons are photographed, one for each width."""
    found = {}
    for width_mm in JOINT_WIDTHS_MM:
        side, name = 6.5 * width_mm, f"joints_W{width_mm:g}"
        start = Start(pose=Pose(x_mm=side / 2.0, y_mm=0.4 * width_mm, heading_rad=math.pi / 2.0))
        found[name] = Map(name=name, bounds=box(0.0, 0.0, side, side), starts=(start,))
    return found


def joint_pieces(profile: LaserProfile) -> tuple[Coupon, ...]:
    """Return the joint coupons, which are cut from a sheet for themselves."""
    joints = (robot_piece(design, profile) for design in joint_designs())
    return tuple(replace(piece, is_optional=True) for piece in joints)


def that_fit(
    pieces: Sequence[Coupon], profile: LaserProfile
) -> tuple[tuple[Coupon, ...], tuple[str, ...]]:
    """Return the coupons that the bed holds, and the names of the others that may be left out."""
    wide_mm, high_mm = profile.machine.usable_mm

    def stays(piece: Coupon) -> bool:
        width, height = _size(piece)
        return not piece.is_optional or (width <= wide_mm and height <= high_mm)

    left_out = tuple(piece.name for piece in pieces if not stays(piece))
    return tuple(piece for piece in pieces if stays(piece)), left_out


def robot_piece(design: Design, profile: LaserProfile) -> Coupon:
    """Return a design as a coupon: what the laser does for a robot, and its name below it."""
    # Room for a robot's marks takes long to find, and no coupon has them.
    unmarked, operations = profile.recipe, profile.recipe.operations
    if operations is not None:
        unmarked = unmarked.changed(operations=operations.changed(mark=None))
    job = laser_job(design, replace(profile, recipe=unmarked), pinned=False)
    sealed_or_cut = (Operation.WELD, Operation.WELDCUT, Operation.CUT)
    paths = tuple(path for path in job.paths if path.operation in sealed_or_cut)
    return _labelled(Coupon(name=design.name, paths=paths, design=design, job=job), profile)


def lap_name(width_mm: float, number: int) -> str:
    """Return the name of a lap coupon; its parts are A and B.

    >>> lap_name(10.0, 1)
    'LAP-10-1'
    """
    return f"LAP-{width_mm:g}-{number}"


def lap_pieces(profile: LaserProfile) -> tuple[Coupon, ...]:
    """Return the lap coupons, each in two parts: an open tube with a socket, and its end, the plug.

    The lap is that of a robot in pieces as it is by default. The socket's rim is where the trunk
    begins, so that the fold line next to part B is the depth of its plug.
    """
    size = sleeve_size(Build.standard(1), profile)
    socket = OpenEnd(
        rim_mm=0.0, blend_mm=(-size.lap_mm, -size.lap_mm - size.blend_mm), rise_mm=size.rise_mm
    )
    tube, end = PieceEnds(stubs=((0, socket),)), PieceEnds(base=OpenEnd(rim_mm=-size.lap_mm))
    found = []
    for width in LAP_WIDTHS_MM:
        for number in range(1, LAP_COPIES + 1):
            for part, ends in (("A", tube), ("B", end)):
                design = lap_design(f"{lap_name(width, number)}{part}", width, size.blend_mm)
                body = body_paths(design, profile, ends=ends)
                ticks: list[LaserPath] = []
                if ends.base and Operation.MARK in profile.recipe.by_operation:
                    ticks = [
                        LaserPath(
                            operation=Operation.MARK, contour=tick, label=f"depth of {design.name}"
                        )
                        for tick in fold_ticks(design, body.reach_mm)
                    ]
                paths = (*ticks, *body.paths)
                found.append(
                    _labelled(
                        Coupon(name=design.name, paths=paths, design=design, ends=ends), profile
                    )
                )
    return tuple(found)


def lap_design(name: str, width_mm: float, blend_mm: float) -> Design:
    """Return the whole tube of a lap coupon.

    It has no narrow port: once joined, it is turned inside out through its open end.
    """
    tail_mm = _LAP_CLAMP_MM + _LAP_TUBE_MM + blend_mm + LAP_MM
    build = Build(widths_mm=(width_mm,), fillet_mm=(), tail_mm=tail_mm, compensation="none")
    return Design(name=name, trunk_length_mm=_LAP_TUBE_MM, build=build)


def cutting_operations(profile: LaserProfile) -> tuple[Operation, ...]:
    """Return the operations by which a machine cuts, and leaves a kerf that is worth measuring."""
    known = profile.recipe.by_operation
    return tuple(
        operation
        for operation in (Operation.WELDCUT, Operation.CUT)
        if operation in known and not known[operation].tool.by_hand
    )


def square_pieces(profile: LaserProfile) -> tuple[Coupon, ...]:
    """Return a 50 mm square for every operation that cuts; the beam runs on the square itself."""
    pieces = []
    for operation in cutting_operations(profile):
        over = profile.settings(operation).overcut_mm.value
        half, side = SQUARE_MM / 2, SQUARE_MM
        corners = [(half, 0.0), (side, 0.0), (side, side), (0.0, side), (0.0, 0.0)]
        # It starts in the middle of a side and runs on past its start.
        points = np.array([*corners, (half + over, 0.0)])
        name = f"KERF-{operation}"
        path = LaserPath(
            operation=operation, contour=Contour.polyline(points, closed=False), label=name
        )
        pieces.append(_labelled(Coupon(name=name, paths=(path,)), profile))
    return tuple(pieces)


def strip_pieces(profile: LaserProfile) -> tuple[Coupon, ...]:
    """Return the peel strips: two plies joined by one seam at an end, cut apart elsewhere.

    Without an operation that cuts and seals at once there are none.
    """
    if Operation.WELDCUT not in profile.recipe.by_operation:
        return ()
    length, width = STRIP_MM
    over = profile.settings(Operation.WELDCUT).overcut_mm.value
    half = profile.settings(Operation.CUT).kerf_mm.value / 2
    seam = np.array([(0.0, -half - over), (0.0, width + half + over)])
    # The sides end on the seam; the beam of the cut stays half a kerf outside the strip.
    sides = np.array([(0.0, -half), (length, -half), (length, width + half), (0.0, width + half)])
    pieces = []
    for number in range(1, STRIPS + 1):
        name = f"PEEL-{number}"
        paths = (
            _line(Operation.WELDCUT, seam, f"seam of {name}"),
            _line(Operation.CUT, sides, f"sides of {name}"),
        )
        pieces.append(_labelled(Coupon(name=name, paths=paths), profile))
    return tuple(pieces)


def _line(operation: Operation, points: Floats, label: str) -> LaserPath:
    contour = Contour.polyline(points, closed=False)
    return LaserPath(operation=operation, contour=contour, label=label)


def text_marks(text: str, corner_mm: tuple[float, float], profile: LaserProfile) -> list[LaserPath]:
    """Return a line of text as marks; none where the recipe cannot mark."""
    if Operation.MARK not in profile.recipe.by_operation:
        return []
    lines, label = lettered(text, corner_mm, LETTER_MM), f"text {text}"
    return [LaserPath(operation=Operation.MARK, contour=line, label=label) for line in lines]


def _labelled(piece: Coupon, profile: LaserProfile) -> Coupon:
    x0, y0, _, _ = piece.box_mm
    label_gap_mm = 5.0
    label = text_marks(piece.name, (x0, y0 - label_gap_mm - LETTER_MM), profile)
    return replace(piece, paths=(*label, *piece.paths))


ROW_MM = 300.0
"""Longest row, so that the film piece stays handy on large beds."""

JOINT_ROW_MM = 2.0 * ROW_MM
"""Of joint coupons: all lie on one sheet of a bed of 1000 x 600 mm."""

_PROCESS_ORDER = tuple(Operation)


def coupon_sheets(
    pieces: Sequence[Coupon],
    profile: LaserProfile,
    name: str = "coupons",
    row_mm: float = ROW_MM,
) -> tuple[Job, ...]:
    """Return the jobs that hold all pieces, in rows from the lower left, highest pieces first."""
    (bed_x, bed_y), margin = profile.machine.usable_mm, profile.machine.margin_mm.value
    room = min(bed_x, row_mm), bed_y
    sheets: list[list[Coupon]] = [[]]
    x, y, row = 0.0, 0.0, 0.0
    # Gap between pieces, above the limit of rule VF-L01 for a mark next to a body.
    coupon_gap_mm = 8.0
    for piece in sorted(pieces, key=lambda piece: -_size(piece)[1]):
        width, height = _size(piece)
        if width > room[0] or height > room[1]:
            problem = f"coupon {piece.name} needs {width:.0f} x {height:.0f} mm of the bed, and "
            problem += f"{bed_x:g} x {bed_y:g} mm are usable"
            raise UnfitInputError("machine", problem, "use a machine with a larger bed")
        if x > 0.0 and x + width > room[0]:
            x, y, row = 0.0, y + row + coupon_gap_mm, 0.0
        if y > 0.0 and y + height > room[1]:
            sheets.append([])
            x, y, row = 0.0, 0.0, 0.0
        low_x, low_y, _, _ = piece.box_mm
        sheets[-1].append(piece.shifted(margin + x - low_x, margin + y - low_y))
        x, row = x + width + coupon_gap_mm, max(row, height)
    names = [name] if len(sheets) == 1 else [f"{name}_{k + 1}" for k in range(len(sheets))]
    facts = _coupon_facts(profile)
    within = (margin, margin, margin + bed_x, margin + bed_y)
    jobs = []
    for title, sheet in zip(names, sheets, strict=True):
        paths = [path for piece in sheet for path in piece.paths]
        pins = registration(paths, profile, within)
        jobs.append(sheet_job(title, [*paths, *pins], profile, facts))
    return tuple(jobs)


def sheet_job(
    name: str, paths: Sequence[LaserPath], profile: LaserProfile, facts: Mapping[str, object]
) -> Job:
    """Return paths as one job on the machine's bed, in process order."""
    return Job(
        name=name,
        sheet_width_mm=profile.machine.bed_width_mm.value,
        sheet_height_mm=profile.machine.bed_height_mm.value,
        paths=tuple(sorted(paths, key=lambda path: _PROCESS_ORDER.index(path.operation))),
        facts=facts,
    )


def _coupon_facts(profile: LaserProfile) -> dict[str, object]:
    """Return the facts that every coupon file states."""
    facts = recipe_facts(profile)
    if Operation.WELDCUT in profile.recipe.by_operation:
        facts["weldcut_offset_mm"] = weldcut_offset_mm(profile)
    return facts


def _size(piece: Coupon) -> tuple[float, float]:
    x0, y0, x1, y1 = piece.box_mm
    return x1 - x0, y1 - y0


FOCUS_MM = (0.0, 3.0, 6.0, 10.0)
LEAST_MJ_MM, MOST_MJ_MM, LEVELS = 5.0, 250.0, 8
LINE_MM, ZONE_MM = 80.0, 20.0
_TEXT_MM = 40.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matrix:
    """The energy matrix of a recipe."""

    jobs: tuple[Job, ...]  # one per focus offset, for the lens is set by hand
    energies_mj_mm: tuple[float, ...]  # line energies that are drawn
    # line energies that the machine cannot give on a line this short; not drawn
    out_of_reach_mj_mm: tuple[float, ...]


def energies_mj_mm() -> tuple[float, ...]:
    """Return the line energies of the matrix, in even steps of their logarithm.

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
    _, settings, machine = sealing_beam(profile)
    ramp_mm = (LINE_MM - ZONE_MM) / 2
    comes_up_to = math.sqrt(2.0 * machine.acceleration_mm_s2.value * ramp_mm)
    top_mm_s = min(comes_up_to, machine.speed_max_mm_s.value)
    reached = [
        energy
        for energy in energies_mj_mm()
        if line_settings(energy, 0.0, settings, machine).speed_mm_s.value <= top_mm_s
    ]
    jobs = tuple(_job(focus_mm, reached, profile) for focus_mm in FOCUS_MM if reached)
    return Matrix(
        jobs=jobs,
        energies_mj_mm=tuple(reached),
        out_of_reach_mj_mm=tuple(e for e in energies_mj_mm() if e not in reached),
    )


def sealing_beam(profile: LaserProfile) -> tuple[Operation, LaserSettings, LaserMachine]:
    """Return the operation by which the laser makes seams, its settings and the laser."""
    beams = {name: (settings, machine) for name, settings, machine in profile.beams}
    for operation in (Operation.WELDCUT, Operation.WELD):
        if operation in beams:
            return operation, *beams[operation]
    problem = "its seam is not made by a laser"
    remedy = "name a recipe whose laser makes it"
    raise UnfitInputError(f"recipe {profile.recipe.name}", problem, remedy)


def line_settings(
    energy_mj_mm: float, focus_mm: float, settings: LaserSettings, machine: LaserMachine
) -> LaserSettings:
    """Return the settings of one line of the matrix: one pass, constant power.

    A recipe that names no least power has its lines at the power that it runs.
    """
    least = settings.min_power_percent
    power = least if least.value else settings.power_percent
    power_w = machine.power_w.value * power.value / 100.0
    spot = spot_at_mm(machine.spot_mm.value, focus_mm, machine.rayleigh_mm.value)
    return settings.changed(
        power_percent=power,
        min_power_percent=power,
        speed_mm_s=_computed(1000.0 * power_w / energy_mj_mm, f"{energy_mj_mm:.1f} mJ/mm"),
        passes=1,
        focus_offset_mm=_computed(focus_mm, "energy matrix"),
        spot_mm=_computed(spot, "spot at this focus offset"),
    )


def _computed(value: float, source: str) -> Quantity:
    return Quantity(value=value, standing=Standing.COMPUTED, source=source)


def _job(focus_mm: float, energies: Sequence[float], profile: LaserProfile) -> Job:
    operation, settings, machine = sealing_beam(profile)
    margin = machine.margin_mm.value
    tick_mm = 2.0
    low = margin + 2.0 * tick_mm
    pitch_mm = 9.0
    top = low + pitch_mm * len(energies)
    start = margin + _TEXT_MM
    paths = text_marks(f"FOCUS {focus_mm:g}", (margin, top), profile)
    for row, energy in enumerate(energies):
        y = low + LETTER_MM / 2 + pitch_mm * row
        paths += text_marks(f"{energy:.1f}", (margin, y - LETTER_MM / 2), profile)
        line = np.array([(start, y), (start + LINE_MM, y)])
        paths.append(
            LaserPath(
                operation=operation,
                contour=Contour.polyline(line, closed=False),
                label=f"{energy:.1f} mJ/mm at focus {focus_mm:g} mm",
                variant=f"E{energy:.1f}",
                settings=line_settings(energy, focus_mm, settings, machine),
            )
        )
    if Operation.MARK in profile.recipe.by_operation:
        # Ticks above and below the lines, between which the seam is judged.
        left = start + (LINE_MM - ZONE_MM) / 2
        ends = ((low - tick_mm, -1.0), (top, 1.0))
        for x, (y, towards) in itertools.product((left, left + ZONE_MM), ends):
            tick = np.array([(x, y), (x, y + towards * tick_mm)])
            paths.append(_line(Operation.MARK, tick, "zone"))
    facts = {**_coupon_facts(profile), "focus_offset_mm": focus_mm}
    return sheet_job(f"matrix_focus_{focus_mm:02.0f}", paths, profile, facts)


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
    "grid": "",
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


OUTCOMES = ("nothing", "weld", "weldcut", "cut", "burnt")
"""Outcomes of a line of the energy matrix."""

GRID_OUTCOMES = ("nothing", "peels", "seals", "burnt")
"""Outcomes of a line of the grid of a hot tip."""

_OUTCOMES = {"matrix": OUTCOMES, "grid": GRID_OUTCOMES}


def results_text(profile: LaserProfile, matrix: Matrix | None, grid: Sequence[str] = ()) -> str:
    """Return the table of results, CSV, one row per reading, values to be filled in.

    Parameters
    ----------
    grid
        Settings of the lines of a hot tip's grid.
    """
    lines = [
        f"# coupon results, {GENERATOR}",
        f"{RECIPE_NOTE} {profile.recipe.name}",
    ]
    if Operation.WELDCUT in profile.recipe.by_operation:
        lines.append(f"{OFFSET_NOTE} {weldcut_offset_mm(profile):.6g}")
    names = cutting_operations(profile)
    rows: list[Row] = [
        ("kerf_piece", name, "mm", f"side of the piece that came out of KERF-{name}")
        for name in names
    ]
    seal = Operation.WELDCUT if Operation.WELDCUT in names else Operation.WELD
    seam = WORDS[profile.settings(seal).tool].seam
    rows += [("seam", seal, "mm", seam) for _ in range(3)]
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
    rows += [("grid", setting, "", " / ".join(GRID_OUTCOMES)) for setting in grid]
    girths = 3  # readings of each girth: so many coupons of a width
    rows += [
        ("joint_girth", f"{width:g} {kpa:g}", "mm", "around a trunk; setting: width and kPa")
        for width in JOINT_WIDTHS_MM
        for kpa in (SLACK_KPA, JOINT_KPA)
        for _ in range(girths)
    ]
    between = "between the axes of the children; setting: coupon and kPa"
    elbow = "from the axis of the trunk to that of the child; setting: coupon and kPa"
    rows += [
        (
            "joint_angle",
            f"{joint.name} {JOINT_KPA:g}",
            "deg",
            between if joint.branch_count > 2 else elbow,
        )
        for joint in joint_designs()
    ]
    rows += [
        (
            "children_out",
            f"{joint.name} {JOINT_KPA:g}",
            "children",
            f"of {joint.branch_count - 1} that came out of the trunk; setting: coupon and kPa",
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
    outcome: str  # one of its measure's outcomes; empty for a number
    place: str  # file and line, for errors

    def wrong(self, value: object, allowed: str) -> BadInputError:
        """Return an error that names this row."""
        return BadInputError(f"{self.measure} {self.setting}".strip(), value, allowed, self.place)

    def two_numbers(self, allowed: str) -> tuple[float, float]:
        """Return the two numbers that the setting consists of; ``allowed`` says which."""
        try:
            first, second = (float(word) for word in self.setting.split())
        except ValueError as error:
            raise self.wrong(self.setting, allowed) from error
        return first, second


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
            problem = f"the line cannot be read as cells ({error})"
            remedy = "mend its quotes, or shorten it"
            raise UnfitInputError("", problem, remedy, place) from None
        if not header:
            if not {"measure", "setting", "value", "unit"} <= set(cells) <= set(_COLUMNS):
                problem = f"the first row {','.join(cells)!r} does not name the columns"
                raise UnfitInputError("", problem, f"begin with {','.join(_COLUMNS)}", place)
            header = cells
            continue
        if len(cells) > len(header):
            problem = f"the row has {counted(len(cells), 'cell')} for {len(header)} columns"
            raise UnfitInputError("", problem, "put a note with commas into quotes", place)
        row = dict(zip(header, cells, strict=False))
        if row.get("value"):
            yield _reading(row, place)


def _reading(row: dict[str, str], place: str) -> Reading:
    measure = row["measure"]
    if measure not in _MEASURES:
        raise UnknownNameError("measure", measure, _MEASURES, place)
    base, text = _MEASURES[measure], row["value"]
    if not base:
        if text not in _OUTCOMES[measure]:
            raise BadInputError(measure, text, ", ".join(_OUTCOMES[measure]), place)
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
    except ValueError:
        raise BadInputError(key, text, "a number", place) from None
    largest = 1e9  # of a reading, in any unit: profiles hold no larger number
    if not 0.0 <= value <= largest:
        raise BadInputError(key, text, f"a finite number, 0 or more, at most {largest:g}", place)
    return value
