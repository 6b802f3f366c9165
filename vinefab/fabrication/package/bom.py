"""Bill of materials: film, seam and cut lengths, mass of the robot, and the machine's time."""

import csv
import io
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from vinefab.core.codec import Record
from vinefab.core.plain_text import GENERATOR, counted
from vinefab.fabrication.formats.laser_drawing import package_spec
from vinefab.fabrication.formats.laser_formats import files_by_run
from vinefab.fabrication.job.passes import bodies_of_paths, enclosed_mm2
from vinefab.fabrication.job.timing import schedule
from vinefab.fabrication.package.piece_joining import (
    MINUTES_PER_JOINT,
    STRIP_HANDLE_MM,
    joining_order,
    needs_strips,
)
from vinefab.fabrication.processes import WORDS
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, Material
from vinefab.model.machine import HeadMachine, LaserMachine, LaserSettings, OperationSettings
from vinefab.model.quantity import Quantity, Standing
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
    files = files_by_run(package_spec(job, profile), requested)
    plan = [one for run in files.values() for one in run]
    suffixes = dict.fromkeys(one.kind.suffix for one in plan)
    basis = f"for each of {', '.join(files)}, whole and by operation: {', '.join(suffixes)}"
    drawn = _computed("files with paths", len(plan), "1", basis)
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


def operation_energy_mj_mm(machine: LaserMachine, settings: LaserSettings) -> Quantity:
    """Return the energy per length of path, all passes: power over speed."""
    used = machine.power_w, settings.power_percent, settings.speed_mm_s
    return Quantity(
        value=settings.line_energy_mj_mm(machine),
        standing=weakest(used),
        source="power / speed x passes",
    )


def fluence_mj_mm2(machine: LaserMachine, settings: LaserSettings) -> Quantity:
    """Return the energy per area under the beam: line energy over spot diameter."""
    line = operation_energy_mj_mm(machine, settings)
    return Quantity(
        value=line.value / settings.spot_mm.value,
        standing=weakest((line, settings.spot_mm)),
        source="line energy / spot",
    )


def computed_energies(profile: LaserProfile, settings: OperationSettings) -> dict[str, Quantity]:
    """Return what follows from the settings of a beam, by key; nothing of other tools."""
    machine = profile.machine_of(settings.tool)
    if not isinstance(settings, LaserSettings) or not isinstance(machine, LaserMachine):
        return {}
    return {
        "line_energy_mj_mm": operation_energy_mj_mm(machine, settings),
        "fluence_mj_mm2": fluence_mj_mm2(machine, settings),
    }


def _film_lines(job: Job, profile: LaserProfile) -> list[BomLine]:
    film, area = profile.material, body_area_mm2(job)
    path = WORDS[profile.settings(profile.recipe.seals).tool].whose
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
        _computed("robot area", area / 100.0, "cm2", f"one ply, within {path} path"),
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
    work_s: dict[Operation, list[float]] = {}
    travel_s: list[float] = []
    inputs: list[Quantity] = []
    for sheet in job.runs:
        for machine in profile.machines:
            if isinstance(machine, HeadMachine):
                inputs += [machine.acceleration_mm_s2, machine.speed_max_mm_s]
        rest_s = 0.0
        for run in schedule(sheet, profile):
            work_s.setdefault(run.path.operation, []).extend(run.times_s)
            travel_s.append(run.begins_s - rest_s)
            speed = run.path.settings_in(profile).head_speed
            inputs += [] if speed is None else [speed]
            rest_s = run.ends_s
    return MachineTime(
        work_s={op: math.fsum(work_s[op]) for op in Operation if op in work_s},
        travel_s=math.fsum(travel_s),
        inputs=tuple(inputs),
    )
