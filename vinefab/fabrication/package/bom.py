"""Bill of materials: film, seam and cut lengths, mass of the robot, and the machine's time."""

import csv
import io
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from vinefab.core.codec import Record
from vinefab.core.plain_text import GENERATOR, counted
from vinefab.fabrication.formats.laser_formats import file_stems, formats_for
from vinefab.fabrication.job.passes import bodies_of_paths, enclosed_mm2
from vinefab.fabrication.package.piece_joining import (
    MINUTES_PER_JOINT,
    STRIP_HANDLE_MM,
    joining_order,
    needs_strips,
)
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import (
    LaserProfile,
    Machine,
    Material,
    OperationSettings,
    Quantity,
    Standing,
)
from vinefab.model.outline import Contour
from vinefab.model.tree import Partition

_COLUMNS = ("item", "value", "unit", "standing", "basis")


@dataclass(frozen=True, slots=True, kw_only=True)
class BomLine(Record):
    """One number of the bill of materials."""

    item: str
    value: float
    unit: str
    standing: Standing  # assumed as soon as one number that it rests on is
    basis: str  # how it was calculated


def bill_of_materials(job: Job, profile: LaserProfile) -> tuple[BomLine, ...]:
    """Return every line of a job's bill of materials; that of joints has `joint_lines`."""
    parts: tuple[BomLine, ...] = ()
    if job.sheets:
        parts = (_computed("sheets", len(job.sheets), "1", "a separate film each"),)
    elif job.tiles:
        basis = "on the same film, one after the other, aligned by targets"
        parts = (_computed("tiles", len(job.tiles), "1", basis),)
    sealed, cut = (Operation.WELD, Operation.WELDCUT), (Operation.WELDCUT, Operation.CUT)
    kinds = [
        ("weld length", sealed, "paths that seal, one pass"),
        ("cut length", cut, "paths that cut through, one pass"),
        ("mark length", (Operation.MARK,), "marks, one pass"),
    ]
    twice = "; where tiles meet, both count" if job.tiles else ""
    time = machine_time(job, profile)
    times_s = {f"machine time, {op}": seconds for op, seconds in time.work_s.items()}
    times_s |= {"machine time, travel": time.travel_s, "machine time, total": time.total_s}
    by = "speed up, along, slow down; full stop at corners, slower in tight arcs; passes"
    if job.tiles:
        by += "; all tiles, without the time to move and align the film"
    return (
        *_film_lines(job, profile),
        *parts,
        *[
            _computed(
                item,
                math.fsum(run.length_mm(op) for run in job.runs for op in operations),
                "mm",
                f"{basis}{twice}",
            )
            for item, operations, basis in kinds
        ],
        *(
            BomLine(item=item, value=value, unit="s", standing=weakest(time.inputs), basis=by)
            for item, value in times_s.items()
        ),
    )


def joint_lines(
    design: Design,
    partition: Partition,
    profile: LaserProfile,
    *,
    robots: int = 1,
) -> tuple[BomLine, ...]:
    """Return the needs of joining the pieces of robots; nothing for a robot in one piece.

    Parameters
    ----------
    robots
        Number of robots.
    """
    settings, sleeves = design.build.pieces, partition.sleeves
    if settings is None or not sleeves:
        return ()
    film, count = profile.material, len(sleeves)
    rims_mm = math.fsum(2.0 * sleeve.width_mm for sleeve in sleeves)
    laps_mm2 = math.fsum(
        (sleeve.width_mm + 2.0 * sleeve.rise_mm) * sleeve.lap_mm for sleeve in sleeves
    )
    lap_basis = (
        f"sockets over plugs, {counted(film.plies, 'ply')}, lumen; lap {settings.lap_mm:g} mm and"
        f" ease {settings.ease_mm:g} mm (assumed)"
    )
    minutes_basis = f"{MINUTES_PER_JOINT:g} min a joint (assumed: none has been timed)"
    each = (
        _computed("pieces", len(partition.pieces), "1", "flat parts of a robot"),
        _computed("sleeve joints", count, "1", "plug of one piece in the socket of another"),
        _assumed("film in laps, all plies", film.plies * laps_mm2 / 100.0, "cm2", lap_basis),
        _computed("bands around laps", count, "1", "one at each joint"),
        _computed("band length", rims_mm, "mm", "rims of all plugs: twice their lay-flat widths"),
        *_bond_lines(design, partition, profile, rims_mm),
        _assumed("assembly time", MINUTES_PER_JOINT * count, "min", minutes_basis),
    )
    return tuple(replace(line, value=robots * line.value) for line in each)


def _bond_lines(
    design: Design, partition: Partition, profile: LaserProfile, rims_mm: float
) -> Iterator[BomLine]:
    """Yield the materials for the bond of the joints, except the film."""
    lap = profile.recipe.lap
    if needs_strips(profile):
        steps = joining_order(design, partition)
        yield _computed("release strips", len(steps), "1", "one for each plug, drawn out again")
        length_mm = math.fsum(step.strip_mm for step in steps)
        basis = f"from each stub to the base of its piece, and {STRIP_HANDLE_MM:g} mm (assumed)"
        yield _assumed("release strip length", length_mm, "mm", basis)
    elif lap is not None:
        yield BomLine(
            item="adhesive film",
            value=rims_mm * lap.band_mm.value / 100.0,
            unit="cm2",
            standing=weakest((lap.band_mm,)),
            basis=f"band length x {lap.band_mm.value:g} mm ({lap.band_mm.standing})",
        )


def bom_text(
    job: Job,
    profile: LaserProfile,
    joints: Sequence[BomLine] = (),
    requested: Collection[str] = (),
) -> str:
    """Return the bill of materials as CSV; its last row names job and program.

    Parameters
    ----------
    joints
        Lines of `joint_lines`, for a robot in pieces.
    requested
        Laser formats that are written on request.
    """
    formats, stems = formats_for(profile, requested).values(), file_stems(job)
    basis = f"for each of {', '.join(stems)}: {', '.join(one.suffix for one in formats)}"
    drawn = _computed("laser files", len(formats) * len(stems), "1", basis)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for line in (*bill_of_materials(job, profile), *joints, drawn):
        writer.writerow([line.item, f"{line.value:.6g}", line.unit, line.standing, line.basis])
    writer.writerow(["bill of materials", "", "", "", f"{GENERATOR}: {job.name}"])
    return stream.getvalue()


def robot_count(job: Job) -> int:
    """Return the number of robots that a job makes."""
    if job.pieces:
        return max(piece.copy for piece in job.pieces)
    return len(_outlines(job))  # one path that forms the body of each


def body_area_mm2(job: Job) -> float:
    """Return the flat area of the robots of a job, one ply, within the path that forms them.

    That is the weld-cut outline or, where sealing and cutting are separate, the weld line; an
    outline that is open at the mouth is closed with a straight line.
    """
    return math.fsum(enclosed_mm2(runs) for runs in bodies_of_paths(_outlines(job)))


def _outlines(job: Job) -> tuple[LaserPath, ...]:
    return job.along(Operation.WELDCUT) or job.along(Operation.WELD)


def film_piece_mm(job: Job, profile: LaserProfile) -> tuple[float, float]:
    """Return width and height of the least piece of film: what is machined and a rim around it.

    The rim is the machine's margin, so that a piece laid into the bed's lower left corner fits.
    The film of a robot in tiles also holds the targets by which they are aligned. Of several sheets
    each takes no more than this.
    """
    if job.sheets:
        wide, high = zip(*(film_piece_mm(sheet, profile) for sheet in job.sheets), strict=True)
        return max(wide), max(high)
    if job.tiles:
        return job.sheet_width_mm, job.sheet_height_mm
    boxes = [path.contour.box_mm for path in job.paths if path.operation.is_machined]
    low_x, low_y, high_x, high_y = zip(*boxes, strict=True)
    rim = 2.0 * profile.machine.margin_mm.value
    return max(high_x) - min(low_x) + rim, max(high_y) - min(low_y) + rim


def weakest(quantities: Iterable[Quantity]) -> Standing:
    """Return the standing of a number calculated from others."""
    assumed = any(quantity.standing is Standing.ASSUMED for quantity in quantities)
    return Standing.ASSUMED if assumed else Standing.COMPUTED


def operation_energy_mj_mm(machine: Machine, settings: OperationSettings) -> Quantity:
    """Return the energy per length of path, all passes: power over speed."""
    used = machine.power_w, settings.power_percent, settings.speed_mm_s
    return Quantity(
        value=settings.line_energy_mj_mm(machine),
        standing=weakest(used),
        source="power / speed x passes",
    )


def fluence_mj_mm2(machine: Machine, settings: OperationSettings) -> Quantity:
    """Return the energy per area under the beam: line energy over spot diameter."""
    line = operation_energy_mj_mm(machine, settings)
    return Quantity(
        value=line.value / settings.spot_mm.value,
        standing=weakest((line, settings.spot_mm)),
        source="line energy / spot",
    )


def _film_lines(job: Job, profile: LaserProfile) -> list[BomLine]:
    film, area = profile.material, body_area_mm2(job)
    width, height = film_piece_mm(job, profile)
    mass_g = area * film.plies * film.ply_mm.value * film.density_kg_m3.value
    g_per_kg = 1000.0
    mm3_per_m3 = 1e9
    mass_g *= g_per_kg / mm3_per_m3
    mass_basis = (
        f"area x {counted(film.plies, 'ply')} x {film.ply_mm.value:g} mm ({film.ply_mm.standing})"
        f" x {film.density_kg_m3.value:g} kg/m3 ({film.density_kg_m3.standing})"
    )
    margin = profile.machine.margin_mm
    rim = f"paths and a rim of {margin.value:g} mm ({margin.standing})"
    sizes = [("film width", width, "mm"), ("film height", height, "mm")]
    count = len(job.sheets) or 1
    sizes.append(("film area, all plies", count * film.plies * width * height / 100.0, "cm2"))
    if count > 1:
        rim += f"; {counted(count, 'sheet')} of one size"
    return [
        *(
            BomLine(item=item, value=value, unit=unit, standing=weakest((margin,)), basis=rim)
            for item, value, unit in sizes
        ),
        _roll_line(film, count, (width, height), weakest((margin, film.roll_width_mm))),
        _computed("plies", film.plies, "1", f"of {film.title}, one on the other"),
        _computed("robot area", area / 100.0, "cm2", "one ply, within the beam's path"),
        BomLine(
            item="robot film mass",
            value=mass_g,
            unit="g",
            standing=weakest((film.ply_mm, film.density_kg_m3)),
            basis=mass_basis,
        ),
    ]


def _roll_line(
    film: Material, sheets: int, piece_mm: tuple[float, float], standing: Standing
) -> BomLine:
    """Return the length of roll for all plies, pieces side by side where the roll is wide enough.

    A piece that is wider than the roll both ways takes its longer side; rule VF-S02 reports it.
    """
    roll, pieces = film.roll_width_mm, sheets * film.plies
    lengths = []
    for across, along in (piece_mm, piece_mm[::-1]):
        beside = int(roll.value // across)
        if beside:
            lengths.append(math.ceil(pieces / beside) * along)
    basis = f"{counted(pieces, 'piece')}, roll {roll.value:g} mm wide ({roll.standing})"
    if not lengths:
        basis += "; wider than the roll"
    return BomLine(
        item="film off the roll",
        value=min(lengths, default=pieces * max(piece_mm)),
        unit="mm",
        standing=standing,
        basis=basis,
    )


def _assumed(item: str, value: float, unit: str, basis: str) -> BomLine:
    return BomLine(item=item, value=value, unit=unit, standing=Standing.ASSUMED, basis=basis)


def _computed(item: str, value: float, unit: str, basis: str) -> BomLine:
    return BomLine(item=item, value=value, unit=unit, standing=Standing.COMPUTED, basis=basis)


CORNER_RAD = math.radians(5.0)
"""The head stops where a path turns by more than this at a point."""


def move_time_s(
    length_mm: float,
    speed_mm_s: float,
    acceleration_mm_s2: float,
    ends_mm_s: tuple[float, float] = (0.0, 0.0),
) -> float:
    """Return the time of a move between two speeds: up, along at full speed, down.

    >>> move_time_s(100.0, 50.0, 1000.0)
    2.05
    >>> move_time_s(0.4, 50.0, 1000.0)  # too short to reach full speed
    0.04
    """
    if length_mm == 0.0:
        return 0.0
    first, last = ends_mm_s
    peak = min(speed_mm_s, math.sqrt((first**2 + last**2) / 2.0 + acceleration_mm_s2 * length_mm))
    ramps_mm = (2.0 * peak**2 - first**2 - last**2) / (2.0 * acceleration_mm_s2)
    along_s = max(0.0, length_mm - ramps_mm) / peak
    return (2.0 * peak - first - last) / acceleration_mm_s2 + along_s


def segment_times_s(
    contour: Contour, speed_mm_s: float, acceleration_mm_s2: float
) -> tuple[float, ...]:
    """Return the time that each line and arc of a contour takes in one pass."""
    segments = list(contour.segments)
    lengths = [segment.length_mm for segment in segments]
    tops = [min(speed_mm_s, math.sqrt(acceleration_mm_s2 * s.radius_mm)) for s in segments]
    # At the start, at every joint between segments, and at the end.
    speeds = [0.0]
    speeds += [
        0.0 if abs(math.remainder(turn_rad, math.tau)) > CORNER_RAD else min(two)
        for (before, after), two in zip(pairwise(segments), pairwise(tops), strict=True)
        for turn_rad in [after.direction_rad() - before.direction_rad(at_end=True)]
    ]
    speeds.append(0.0)
    for at, length in enumerate(lengths):
        speeds[at + 1] = min(speeds[at + 1], _reached(speeds[at], length, acceleration_mm_s2))
    for at in range(len(lengths) - 1, -1, -1):
        speeds[at] = min(speeds[at], _reached(speeds[at + 1], lengths[at], acceleration_mm_s2))
    return tuple(
        move_time_s(length, top, acceleration_mm_s2, ends)
        for length, top, ends in zip(lengths, tops, pairwise(speeds), strict=True)
    )


def _reached(speed: float, length: float, acceleration: float) -> float:
    return math.sqrt(speed**2 + 2.0 * acceleration * length)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathPass:
    """One pass along one path."""

    path: LaserPath
    begins_s: float  # when the beam is switched on, from the start of the job
    times_s: tuple[float, ...]  # how long each line and arc takes

    @property
    def ends_s(self) -> float:
        """When the beam goes off."""
        return self.begins_s + math.fsum(self.times_s)


def schedule(job: Job, profile: LaserProfile) -> tuple[PathPass, ...]:
    """Return every pass of a job in the order in which the laser runs it.

    The head rests at both ends of a path. Travel is straight at the machine's top speed, in process
    order, from the sheet's lower left. Seams made by an impulse sealer are not included.
    """
    machine = profile.machine
    acceleration, top = machine.acceleration_mm_s2.value, machine.speed_max_mm_s.value
    runs: list[PathPass] = []
    now, head = 0.0, (0.0, 0.0)
    for path in (path for op in laser_on_passes(job, profile) for path in job.along(op)):
        settings, (start, end) = path.settings_in(profile), path_ends(path)
        times = segment_times_s(path.contour, settings.speed_mm_s.value, acceleration)
        for _ in range(settings.passes):
            now += move_time_s(math.dist(head, start), top, acceleration)
            runs.append(PathPass(path=path, begins_s=now, times_s=times))
            now, head = runs[-1].ends_s, end
    return tuple(runs)


def laser_on_passes(job: Job, profile: LaserProfile) -> tuple[Operation, ...]:
    """Return the operations of a job that the laser runs, in process order."""
    machined = (op for op in Operation if op.is_machined and job.along(op))
    return tuple(
        op for op in machined if all(p.settings_in(profile).by_laser for p in job.along(op))
    )


def path_ends(path: LaserPath) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return where a path begins and where it ends."""
    first, last = path.contour.points_mm[0], path.contour.points_mm[-1]
    start = float(first[0]), float(first[1])
    return start, start if path.contour.closed else (float(last[0]), float(last[1]))


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineTime:
    """An estimate of a job's time on the machine."""

    work_s: Mapping[Operation, float]  # time with the beam on, by operation, all passes
    travel_s: float  # time between paths with the beam off
    inputs: tuple[Quantity, ...]  # the quantities that the estimate rests on

    @property
    def total_s(self) -> float:
        """Work and travel together."""
        return math.fsum(self.work_s.values()) + self.travel_s


def machine_time(job: Job, profile: LaserProfile) -> MachineTime:
    """Return the expected time of a job, the sum of `schedule` over all its tiles if it has any.

    Moving and aligning the film between tiles is not included.
    """
    machine = profile.machine
    work_s: dict[Operation, list[float]] = {}
    travel_s: list[float] = []
    inputs: list[Quantity] = []
    for sheet in job.runs:
        inputs += [machine.acceleration_mm_s2, machine.speed_max_mm_s]
        rest_s = 0.0
        for run in schedule(sheet, profile):
            work_s.setdefault(run.path.operation, []).extend(run.times_s)
            travel_s.append(run.begins_s - rest_s)
            inputs.append(run.path.settings_in(profile).speed_mm_s)
            rest_s = run.ends_s
    return MachineTime(
        work_s={op: math.fsum(work_s[op]) for op in Operation if op in work_s},
        travel_s=math.fsum(travel_s),
        inputs=tuple(inputs),
    )
