"""Every rule with a case that must fire and one that must not, both close to the limit."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest
from shapely import box

from vinefab.fabrication.checking import map_corridors
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.pieces.partition import in_pieces, partition_of
from vinefab.fabrication.rules.catalog import RULES, run_checks
from vinefab.fabrication.rules.rule import Limits, RuleNotApplicable
from vinefab.fabrication.rules.subject import (
    Corridor,
    MapCorridors,
    RigFacts,
    RigPartFacts,
    Subject,
)
from vinefab.fabrication.rules.tree_rules import lap_occupancies, occupancies
from vinefab.inflation.compensation import FlatJoint
from vinefab.inflation.joint import JointShape
from vinefab.inflation.pattern import Pattern, PatternJoint
from vinefab.model.deployment import Deployment
from vinefab.model.design import Collar, Design, PieceSettings, Pouch
from vinefab.model.finding import Finding, Severity
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, Quantity, RecipeStatus, Standing
from vinefab.model.map import Map, Pose
from vinefab.model.outline import Contour, Part
from vinefab.model.pieces import Partition, Piece, Sleeve, piece_label
from vinefab.model.tree import branch_tree, fan_offsets_rad

Make = Callable[..., Design]
Build = Callable[[Make, LaserProfile], Subject]
E, W = Severity.ERROR, Severity.WARNING


@dataclass(frozen=True, kw_only=True)
class Case:
    fires: Build
    severity: Severity
    branches: tuple[str, ...]
    quiet: Build


def of(*fans: tuple[int, float, float], **build: object) -> Build:
    return lambda make, profile: Subject.of(make(*fans, **build), profile)


def cousins(gap_mm: float) -> Build:
    """Two children 40 degrees apart, each with one straight child: its gap to its uncle is known.

    The grandchild begins L sin(40 deg) from the uncle's centre line; half widths are 12 and 7.
    """
    length_mm = (gap_mm + 12.0 + 7.0) / math.sin(math.radians(40.0))
    return of((2, length_mm, 40.0), (1, 60.0, 0.0), widths_mm=(40.0, 24.0, 14.0))


def near_fillet(gap_mm: float) -> Build:
    """A grandchild shrunk to a disc that floats before the arc of its uncle's fillet."""

    def build(make: Make, profile: LaserProfile) -> Subject:
        subject = Subject.of(make((2, 200.0, 90.0), (2, 90.0, 60.0), fillet_mm=(9.0, 4.0)), profile)
        arcs = [s for s in subject.outline.contour.segments if s.part is Part.FILLET]
        arc = next(s for s in arcs if s.branch == "0.0" and s.radius_mm > 8.9)
        ends = arc.flattened_mm(0.001)
        middle, center = ends[len(ends) // 2], np.array(arc.center_mm)
        at = middle + (center - middle) / 9.0 * (gap_mm + 0.5)
        row, capsules = subject.names.index("0.1.1"), subject.capsules
        moved = {name: getattr(capsules, name).copy() for name in ("start_mm", "end_mm")}
        halves = {name: getattr(capsules, name).copy() for name in ("half_mm", "end_half_mm")}
        for ends in moved.values():
            ends[row] = at
        for half in halves.values():
            half[row] = 0.5
        return replace(subject, capsules=replace(capsules, **moved, **halves))

    return build


def scaled(number: Quantity, value: float) -> Quantity:
    return number.changed(value=value)


def seam(extra_mm: float) -> Build:
    """Paths drawn with another seam than the recipe's."""

    def build(make: Make, profile: LaserProfile) -> Subject:
        operations = dict(profile.recipe.by_operation)
        weldcut = operations["weldcut"]
        width = scaled(weldcut.seam_width_mm, weldcut.seam_width_mm.value + extra_mm)
        operations["weldcut"] = weldcut.changed(seam_width_mm=width)
        other = replace(profile, recipe=profile.recipe.changed(operations=operations))
        design = make((2, 150.0, 60.0))
        return replace(Subject.of(design, profile), job=laser_job(design, other))

    return build


def material(**changes: object) -> Build:
    def build(make: Make, profile: LaserProfile) -> Subject:
        return Subject.of(make(), replace(profile, material=profile.material.changed(**changes)))

    return build


def status(value: RecipeStatus) -> Build:
    def build(make: Make, profile: LaserProfile) -> Subject:
        return Subject.of(make(), replace(profile, recipe=profile.recipe.changed(status=value)))

    return build


def speed(mm_s: float) -> Build:
    def build(make: Make, profile: LaserProfile) -> Subject:
        operations = dict(profile.recipe.by_operation)
        operations["mark"] = operations["mark"].changed(
            speed_mm_s=scaled(operations["mark"].speed_mm_s, mm_s)
        )
        return Subject.of(
            make(), replace(profile, recipe=profile.recipe.changed(operations=operations))
        )

    return build


def weldcut(**values: float) -> Build:
    """A plain vine on a calibrated recipe with other values of the one-pass operation."""

    def build(make: Make, profile: LaserProfile) -> Subject:
        operations = dict(profile.recipe.by_operation)
        old = operations["weldcut"]
        changed = {name: scaled(getattr(old, name), value) for name, value in values.items()}
        operations["weldcut"] = old.changed(**changed)
        recipe = profile.recipe.changed(operations=operations, status=RecipeStatus.COUPON_OK)
        return Subject.of(make(), replace(profile, recipe=recipe))

    return build


def rolled(roll_mm: float, *fans: tuple[int, float, float], **build: object) -> Build:
    """A robot on a bed of 400 x 280 mm, or its pieces on sheets, and a roll of film."""

    def built(make: Make, profile: LaserProfile) -> Subject:
        film = profile.material.changed(roll_width_mm=assumed(roll_mm))
        bed = {"bed_width_mm": assumed(400.0), "bed_height_mm": assumed(280.0)}
        narrow = replace(profile, material=film, machine=profile.machine.changed(**bed))
        design = make(*fans, trunk_mm=60.0, **build)
        partition = partition_of(design, narrow) if design.build.pieces else None
        job = laser_job(design, narrow, partition=partition)
        return replace(Subject.of(design), profile=narrow, job=job)

    return built


def jobbed(change: Callable[[Job], tuple[LaserPath, ...]]) -> Build:
    """A plain vine whose job was changed."""

    def build(make: Make, profile: LaserProfile) -> Subject:
        subject = Subject.of(make(), profile)
        assert subject.job is not None
        return replace(subject, job=replace(subject.job, paths=change(subject.job)))

    return build


def path(operation: Operation, points: list[list[float]], *, closed: bool = False) -> LaserPath:
    contour = Contour.polyline(np.array(points), closed=closed)
    return LaserPath(operation=operation, contour=contour, label="extra")


def mark_above(job: Job, away_mm: float) -> tuple[LaserPath, ...]:
    top = max(one.contour.box_mm[3] for one in job.along(Operation.WELDCUT))
    return (path(Operation.MARK, [[300.0, top + away_mm], [310.0, top + away_mm]]), *job.paths)


def rigged(
    height_mm: float = 60.0,
    size_mm: tuple[float, float, float] = (210.0, 100.0, 63.0),
    problems: tuple[str, ...] = (),
) -> Build:
    """A plain vine and a rig of one part."""
    part = RigPartFacts(name="part_01", size_mm=size_mm, problems=problems)
    rig = RigFacts(
        name="table",
        printer="bench",
        room_mm=(210.0, 210.0, 250.0),
        height_mm=height_mm,
        parts=(part,),
    )

    def build(make: Make, profile: LaserProfile) -> Subject:
        return replace(Subject.of(make(), profile), rig=rig)

    return build


def corridor(width_mm: float) -> Build:
    """A plain vine, 40 mm wide lay-flat, and a map with a narrow and a wide corridor."""
    corridors = tuple(Corridor(width_mm=mm, x_mm=1.0, y_mm=2.0) for mm in (width_mm, 90.0))

    def build(make: Make, profile: LaserProfile) -> Subject:
        return replace(
            Subject.of(make(), profile), corridors=(MapCorridors(name="hall", corridors=corridors),)
        )

    return build


def square(low: float, high: float) -> LaserPath:
    corners = [[low, low], [high, low], [high, high], [low, high]]
    return path(Operation.CUT, corners, closed=True)


def reading(*problems: str) -> Build:
    return lambda make, profile: Subject.of(
        make(), profile, readback={"outline.dxf": problems, "outline.svg": ()}
    )


def pouch(radius_mm: float, length_mm: float = 200.0) -> Build:
    """Two leaves 40 degrees apart: tips of 200 mm are 136.8 mm apart."""
    return of((2, length_mm, 40.0), pouch=Pouch(shape="round", radius_mm=radius_mm))


def pouched(leaf_mm: float, branches: int = 2, trunk_mm: float = 60.0) -> Build:
    """Leaves with a pouch that is 40 mm wide."""
    rim = Pouch(shape="rectangle", length_mm=40.0, width_mm=40.0)
    return of((branches, 200.0, 120.0), widths_mm=(trunk_mm, leaf_mm), pouch=rim)


def measured(value: float) -> Quantity:
    return Quantity(value=value, standing=Standing.MEASURED, source="a test")


def assumed(value: float) -> Quantity:
    return Quantity(value=value, standing=Standing.ASSUMED, source="a test")


LOOSE_FIT = {
    "yield_kpa": measured(1.92),
    "drag_kpa_m": measured(0.771),
    "storage_kpa": measured(0.0),
    "friction": measured(0.234),
    "width_mm": measured(25.0 * math.pi / 2.0),
}
"""The published growth constants of a loosely stored tube, as if they were one's own."""


def burst(
    *fans: tuple[int, float, float], growth: Mapping[str, Quantity] | None = None, **build: object
) -> Build:
    """A film whose seam was measured: a tube of 20 mm burst at 70 kPa."""

    def built(make: Make, profile: LaserProfile) -> Subject:
        seam = {"burst_kpa": measured(70.0), "burst_width_mm": measured(20.0)}
        none = {"survived_kpa": None, "survived_width_mm": None}
        tested = replace(
            profile,
            material=profile.material.changed(**seam, **none),
            recipe=profile.recipe.changed(growth=growth),
        )
        return Subject.of(make(*fans, **build), tested)

    return built


def collar_off(off_mm: float) -> Build:
    """A tail whose mouth was drawn for another clamp."""

    def build(make: Make, profile: LaserProfile) -> Subject:
        drawn, meant = (
            make(collar=Collar(clamp_diameter_mm=30.0 + 2.0 * more_mm / math.pi))
            for more_mm in (0.0, off_mm)
        )
        return replace(Subject.of(drawn, profile), design=meant)

    return build


def winding(fan_deg: float) -> Build:
    """Seven joints, each half a fan off the way before."""
    widths_mm = tuple(40.0 * 0.8**level for level in range(8))
    return of(*[(2, 100.0, fan_deg)] * 7, widths_mm=widths_mm)


def piece(line_mm: float, radius_mm: float) -> Build:
    """A cut with a line and a half circle of given sizes."""
    points = np.array([[500.0, 500.0], [500.0 + line_mm, 500.0], [500.0 + line_mm, 520.0]])
    end = points[-1] + [2.0 * radius_mm, 0.0]
    contour = Contour(
        points_mm=np.array([*points, end]),
        bulges=np.array([0.0, 0.0, -1.0]),
        parts=(Part.OTHER,) * 3,
        branches=("",) * 3,
        closed=False,
    )
    cut = LaserPath(operation=Operation.CUT, contour=contour, label="piece")
    return jobbed(lambda job: (*job.paths, cut))


def twice(shared_mm: float) -> Build:
    """A mark of which a part lies on a cut."""
    one = path(Operation.MARK, [[500.0, 500.0], [520.0, 500.0]])
    two = path(Operation.CUT, [[520.0 - shared_mm, 500.0], [540.0, 500.0]])
    return jobbed(lambda job: (*job.paths, one, two))


def cuts_apart(between_mm: float) -> Build:
    """Two cuts next to each other; the kerf of either is 0.2 mm wide."""
    cuts = [path(Operation.CUT, [[500.0, y], [520.0, y]]) for y in (500.0, 500.0 + between_mm)]
    return jobbed(lambda job: (*job.paths, *cuts))


def sleeve_at(branch: int, number: int = 1) -> Sleeve:
    """A sleeve on a branch of 20 mm, of the piece with a number."""
    return Sleeve(
        label=piece_label(number),
        inner="A",
        branch=branch,
        plug_mm=40.0,
        socket_mm=55.0,
        blend_end_mm=35.0,
        rise_mm=1.0,
        width_mm=20.0,
    )


def cut(
    *branches: int,
    load: Quantity | None = None,
    bore: bool = False,
    lap_mm: float = 15.0,
    ease_mm: float = 1.5,
    **build: object,
) -> Build:
    """A fan of children of 20 mm of which some are cut, by index; the trunk is 60 mm wide."""

    def built(make: Make, profile: LaserProfile) -> Subject:
        settings = PieceSettings(lap_mm=lap_mm, ease_mm=ease_mm)
        wide = {"widths_mm": (60.0, 20.0), **build}
        design = make((8, 200.0, 280.0), pieces=settings, **wide)
        sleeves = tuple(sleeve_at(branch, number) for number, branch in enumerate(branches, 1))
        outer = [Piece(label=s.label, root=s.branch, branches=(s.branch,)) for s in sleeves]
        kept = tuple(branch for branch in range(9) if branch not in branches)
        pieces = (Piece(label="A", root=0, branches=kept, stubs=branches), *outer)
        key = "survived_n_per_mm" if bore else "strength_n_per_mm"
        known = {"strength_n_per_mm": None, key: load or measured(0.2)}
        bond = profile.recipe.lap.changed(**known)
        tested = replace(profile, recipe=profile.recipe.changed(lap=bond))
        return replace(
            Subject.of(design, tested),
            partition=Partition(pieces=pieces, sleeves=sleeves),
        )

    return built


def inflated(*fans: tuple[int, float, float], off_deg: float = 0.0, **figures: object) -> Build:
    """A robot whose joints have given figures, the outer children deployed off their angles."""
    names = ("sensitivity", "crotch_load", "passage")
    known = {name: figures.pop(name, 1.0) for name in names}

    def joint(design: Design, place: int) -> PatternJoint:
        level, build = design.levels[place], design.build
        wanted = tuple(np.degrees(fan_offsets_rad(level)).tolist())
        flat = JointShape(
            angles_deg=wanted,
            widths=(build.widths_mm[place + 1] / build.widths_mm[place],) * level.branches,
            fillets=(0.15,) * (level.branches + 1),
        )
        return PatternJoint(
            level=place + 2,
            width_mm=build.widths_mm[place],
            count=1,
            wanted_deg=wanted,
            aimed_deg=wanted,
            found=FlatJoint(
                flat=flat,
                deployed_deg=(*wanted[:-1], wanted[-1] + off_deg),
                pull_backs=(0.0,) * level.branches,
                side_offsets=(0.0,) * level.branches,
                **known,
            ),
        )

    def build(make: Make, profile: LaserProfile) -> Subject:
        design = make(*fans, **figures)
        joints = tuple(joint(design, place) for place in range(len(design.levels)))
        pattern = Pattern(design=design, flat=design, deployed=design, joints=joints)
        return replace(Subject.of(design, profile), pattern=pattern)

    return build


PAIR = (2, 200.0, 90.0)


def lapped(passage: float) -> Build:
    """A leaf of 14 mm with a lap, which rides in a child of 24 mm, through its joint's passage."""
    known = {"widths_mm": (40.0, 24.0, 14.0), "pieces": PieceSettings()}
    tree = inflated(PAIR, (2, 90.0, 60.0), passage=passage, **known)

    def built(make: Make, profile: LaserProfile) -> Subject:
        subject = tree(make, profile)
        leaf = subject.ids(0)[0] + ".1.0"
        row = branch_tree(subject.design).ids.index(leaf)
        sleeve = replace(sleeve_at(row), width_mm=14.0)
        kept = tuple(branch for branch in range(7) if branch != row)
        pieces = (
            Piece(label="A", root=0, branches=kept, stubs=(row,)),
            Piece(label=sleeve.label, root=row, branches=(row,)),
        )
        return replace(subject, partition=Partition(pieces=pieces, sleeves=(sleeve,)))

    return built


def meeting(gap_mm: float) -> Build:
    """Two grandchildren that run together: their tips are where they are nearest when inflated.

    They begin 100 mm apart, head 30 degrees inwards, and are 28 / pi mm thick together.
    """
    length_mm = 100.0 - 28.0 / math.pi - gap_mm
    return inflated((2, 100.0, 60.0), (2, length_mm, 120.0), widths_mm=(40.0, 24.0, 14.0))


def pieced(*, most: int = 6, lap_mm: float = 15.0, unmarked: str = "") -> Build:
    """Two leaves that cross, in the fewest pieces; the labels named are missing on the film."""

    def built(make: Make, profile: LaserProfile) -> Subject:
        settings = PieceSettings(most=most, lap_mm=lap_mm)
        design = make((2, 100.0, 60.0), (2, 100.0, 120.0), pieces=settings)
        partition = partition_of(design, profile)
        job = laser_job(design, profile, partition=partition)
        paths = tuple(one for one in job.paths if not unmarked or unmarked not in one.label)
        flat = replace(Subject.of(design), profile=profile, job=replace(job, paths=paths))
        return in_pieces(flat, partition)

    return built


TREE = of((3, 200.0, 120.0), (2, 120.0, 50.0))
CROSSING = of((2, 100.0, 60.0), (2, 100.0, 120.0))

CASES: Mapping[str, Case] = {
    "VF-T01": Case(
        fires=of((2, 0.09, 60.0)), severity=E, branches=("0.0",), quiet=of((2, 0.11, 60.0))
    ),
    "VF-T02": Case(fires=CROSSING, severity=E, branches=("0.0.1", "0.1.0"), quiet=TREE),
    "VF-T03": Case(fires=cousins(-0.1), severity=E, branches=("0.0", "0.1.0"), quiet=cousins(0.1)),
    "VF-T04": Case(
        fires=of(widths_mm=(4.9,)), severity=E, branches=("0",), quiet=of(widths_mm=(5.1,))
    ),
    "VF-W01": Case(
        fires=of(widths_mm=(4.9,)), severity=E, branches=("0",), quiet=of(widths_mm=(8.1,))
    ),
    "VF-W02": Case(
        fires=of((2, 200.0, 60.0), widths_mm=(23.8, 20.0)),
        severity=E,
        branches=("0.0",),
        quiet=of((2, 200.0, 60.0), widths_mm=(30.2, 20.0)),
    ),
    # 24 mm x 0.075 mm / 0.1 = 18 mm^2 each, in a lumen of 40^2 / pi = 509 mm^2
    "VF-W03": Case(
        fires=of((17, 200.0, 300.0)), severity=E, branches=("0",), quiet=of((8, 200.0, 180.0))
    ),
    "VF-W04": Case(fires=seam(0.052), severity=E, branches=("0",), quiet=seam(0.048)),
    "VF-C01": Case(fires=cousins(2.0), severity=E, branches=("0.0", "0.1.0"), quiet=cousins(4.3)),
    "VF-C02": Case(
        fires=of((2, 200.0, 14.9)),
        severity=E,
        branches=("0.0", "0.1"),
        quiet=of((2, 200.0, 20.1)),
    ),
    # 24 mm wide at 60 degrees: the sides part 12 / sin(30) = 24 mm from the joint
    "VF-C03": Case(
        fires=of((2, 47.9, 60.0)), severity=E, branches=("0.0", "0.1"), quiet=of((2, 48.1, 60.0))
    ),
    "VF-C04": Case(
        fires=of((2, 200.0, 60.0), fillet_mm=(0.9,)),
        severity=E,
        branches=("0", "0.0"),
        quiet=of((2, 200.0, 60.0), fillet_mm=(6.0,)),
    ),
    "VF-C06": Case(
        fires=of((2, 200.0, 181.0)), severity=W, branches=("0.0",), quiet=of((2, 200.0, 179.0))
    ),
    "VF-C05": Case(
        fires=near_fillet(2.0), severity=E, branches=("0.0", "0.1.1"), quiet=near_fillet(4.3)
    ),
    "VF-C07": Case(fires=pouch(67.4), severity=E, branches=("0.0", "0.1"), quiet=pouch(66.2)),
    # 70 kPa at 20 mm is 35 kPa at 40 mm, 23.3 kPa with the factor of 1.5
    "VF-P01": Case(
        fires=burst(pressure_kpa=23.4), severity=E, branches=("0",), quiet=of(pressure_kpa=23.3)
    ),
    # Narrow, so that the load of the test is not reached
    "VF-P02": Case(
        fires=burst(widths_mm=(10.0,), pressure_kpa=70.1),
        severity=W,
        branches=("0",),
        quiet=burst(widths_mm=(10.0,), pressure_kpa=69.9),
    ),
    # 40 mm, 0.0375 mm, 30 MPa: 50 % at 44.2 kPa
    "VF-P04": Case(
        fires=of(pressure_kpa=44.5), severity=W, branches=("0",), quiet=of(pressure_kpa=44.0)
    ),
    # Loosely stored film: 91.7 kPa mm / w on the leaf, 778 kPa mm / w allowed on the trunk
    "VF-P03": Case(
        fires=burst((2, 200.0, 60.0), widths_mm=(100.0, 11.75), growth=LOOSE_FIT),
        severity=E,
        branches=("0.0",),
        quiet=of((2, 200.0, 60.0), widths_mm=(40.0, 23.8)),
    ),
    "VF-P05": Case(fires=seam(-0.0052), severity=W, branches=("0",), quiet=seam(-0.0048)),
    "VF-I01": Case(
        fires=inflated(PAIR, off_deg=0.61),
        severity=E,
        branches=("0.0",),
        quiet=inflated(PAIR, off_deg=0.59),
    ),
    "VF-I02": Case(
        fires=inflated(PAIR, sensitivity=2.51),
        severity=W,
        branches=("0.0",),
        quiet=inflated(PAIR, sensitivity=2.49),
    ),
    # 70 kPa at 20 mm is 1.75 times the load of 20 kPa at 40 mm
    "VF-I03": Case(
        fires=inflated(PAIR, crotch_load=1.76, pressure_kpa=20.0),
        severity=W,
        branches=("0.0",),
        quiet=inflated(PAIR, crotch_load=1.74, pressure_kpa=20.0),
    ),
    "VF-I04": Case(
        fires=meeting(-0.1), severity=W, branches=("0.0.1", "0.1.0"), quiet=meeting(0.1)
    ),
    "VF-B01": Case(fires=of(tail_mm=149.0), severity=E, branches=("0",), quiet=of(tail_mm=200.0)),
    "VF-B02": Case(
        fires=of(widths_mm=(101.0,)), severity=E, branches=("0",), quiet=of(widths_mm=(99.0,))
    ),
    "VF-B03": Case(fires=of(trunk_mm=249.0), severity=W, branches=("0",), quiet=of(trunk_mm=251.0)),
    # 1000 mm of width fit the bed neither whole nor in tiles; 1200 mm of length do
    "VF-S01": Case(
        fires=of(widths_mm=(1000.0,)), severity=E, branches=(), quiet=of(trunk_mm=1000.0)
    ),
    # 40 mm of lumen, 0.55 mm to the beam and 2 mm of overcut at the mouth, on both sides
    "VF-S02": Case(
        fires=material(
            roll_width_mm=Quantity(value=45.0, standing=Standing.ASSUMED, source="a test")
        ),
        severity=W,
        branches=(),
        quiet=material(
            roll_width_mm=Quantity(value=45.2, standing=Standing.ASSUMED, source="a test")
        ),
    ),
    "VF-L01": Case(
        fires=jobbed(lambda job: mark_above(job, 2.9)),
        severity=E,
        branches=(),
        quiet=jobbed(lambda job: mark_above(job, 3.1)),
    ),
    "VF-L02": Case(
        fires=jobbed(lambda job: (*job.paths, job.paths[-1])),
        severity=E,
        branches=("0",),
        quiet=jobbed(lambda job: (*job.paths, square(500.0, 520.0))),
    ),
    "VF-L03": Case(
        fires=jobbed(lambda job: (*job.paths, square(400.0, 500.0), square(420.0, 440.0))),
        severity=E,
        branches=(),
        quiet=jobbed(lambda job: (*job.paths, square(420.0, 440.0), square(400.0, 500.0))),
    ),
    "VF-L04": Case(
        fires=material(ply_mm=Quantity(value=0.05, standing=Standing.PAPER, source="a test")),
        severity=E,
        branches=(),
        quiet=material(ply_mm=Quantity(value=0.0375, standing=Standing.PAPER, source="a test")),
    ),
    "VF-L05": Case(fires=speed(501.0), severity=W, branches=(), quiet=speed(499.0)),
    "VF-L06": Case(
        fires=status(RecipeStatus.UNVERIFIED),
        severity=W,
        branches=(),
        quiet=status(RecipeStatus.COUPON_OK),
    ),
    "VF-R01": Case(
        fires=rigged(problems=("is not closed",)), severity=E, branches=(), quiet=rigged()
    ),
    "VF-R02": Case(
        fires=rigged(size_mm=(100.0, 210.01, 63.0)),
        severity=E,
        branches=(),
        quiet=rigged(size_mm=(210.0, 210.0, 250.0)),
    ),
    # 40 mm lay-flat inflates to 80 / pi = 25.46 mm; 1.2 times that is 30.56 mm
    "VF-R03": Case(fires=corridor(25.4), severity=W, branches=(), quiet=corridor(25.5)),
    "VF-R04": Case(
        fires=rigged(height_mm=30.5), severity=W, branches=(), quiet=rigged(height_mm=30.6)
    ),
    "VF-J01": Case(
        fires=pieced(lap_mm=80.0),
        severity=E,
        branches=("0.0.1", "0.1.0"),
        quiet=pieced(),
    ),
    "VF-J02": Case(fires=pieced(most=1), severity=E, branches=(), quiet=pieced(most=2)),
    "VF-J05": Case(fires=pieced(unmarked="socket B"), severity=W, branches=(), quiet=pieced()),
    # 0.2 N/mm with the factor of 1.5 is 0.1333 N/mm: 41.89 kPa at 20 mm
    "VF-J03": Case(
        fires=cut(2, pressure_kpa=41.95),
        severity=E,
        branches=("0.1",),
        quiet=cut(2, pressure_kpa=41.85),
    ),
    # The film is 0.075 mm thick; a lap of 15 mm has 5 mm on each side of a band of 5 mm.
    "VF-J06": Case(
        fires=cut(2, 3, ease_mm=0.074),
        severity=E,
        branches=("0.1", "0.2"),
        quiet=cut(2, 3, ease_mm=0.076),
    ),
    # 5 x 20 mm and three laps of 2 x 21 mm, times 0.75 mm, in a lumen of 29.8^2 / pi mm^2: 60 %
    "VF-J04": Case(
        fires=cut(1, 5, 6, widths_mm=(29.7, 20.0)),
        severity=E,
        branches=("0",),
        quiet=cut(1, 5, 6, widths_mm=(42.2, 20.0)),
    ),
    "VF-X01": Case(fires=reading("area differs by 3 %"), severity=E, branches=(), quiet=reading()),
}


def grown(**build: object) -> Build:
    return burst((2, 200.0, 60.0), widths_mm=(40.0, 23.8), growth=LOOSE_FIT, **build)


NEAR_LIMITS: list[tuple[str, Build, set[Severity]]] = [
    ("VF-W01", of(widths_mm=(7.9,)), {W}),
    ("VF-W02", of((2, 200.0, 60.0), widths_mm=(29.8, 20.0)), {W}),
    ("VF-W03", of((9, 200.0, 200.0)), {W}),
    # seam, kerf and melted rim take 1.1 mm on each side
    ("VF-C01", cousins(4.1), {W}),
    ("VF-C01", cousins(2.3), {W}),
    ("VF-C02", of((2, 200.0, 19.9)), {W}),
    ("VF-C04", of((2, 200.0, 60.0), fillet_mm=(5.9,)), {W}),
    ("VF-C04", of((2, 200.0, 60.0), widths_mm=(20.0, 6.0), fillet_mm=(1.9,)), {W}),
    ("VF-C04", of((2, 400.0, 150.0), fillet_mm=(23.9,)), set()),
    ("VF-C04", of((2, 400.0, 150.0), fillet_mm=(24.1,)), {W}),
    ("VF-C04", of((2, 400.0, 150.0), fillet_mm=(47.9,)), {W}),
    ("VF-C04", of((2, 400.0, 150.0), fillet_mm=(48.1,)), {E}),
    ("VF-C05", near_fillet(4.1), {W}),
    # 7 joints of 81 degrees: e^(0.234 * 9.9) = 10.1; of 80 degrees 9.8
    ("VF-C06", winding(162.0), {W}),
    ("VF-C06", winding(160.0), set()),
    ("VF-C07", pouch(66.35), {W}),
    # What was not measured warns: the seam, or what growth takes
    ("VF-P01", of(pressure_kpa=23.4), {W}),
    ("VF-P01", burst(pressure_kpa=23.3), set()),
    ("VF-P02", of(pressure_kpa=70.1), {W}),
    ("VF-P03", of((2, 200.0, 60.0), widths_mm=(100.0, 11.75)), {W}),
    ("VF-P03", burst((2, 200.0, 60.0), widths_mm=(100.0, 11.75)), {W}),
    ("VF-P03", burst((2, 200.0, 60.0), widths_mm=(100.0, 11.83), growth=LOOSE_FIT), set()),
    ("VF-P03", of((2, 200.0, 60.0), widths_mm=(100.0, 11.83)), set()),
    # 40 mm x 0.075 mm / 0.1 = 30 mm^2 of pouch, in a lumen of 12^2 / pi = 45.8 mm^2: 65.5 %
    ("VF-W03", pouched(12.0), {E}),
    ("VF-W03", pouched(12.6), {W}),
    ("VF-W03", pouched(17.8), set()),
    # Six pouches of 40 mm in a trunk of 30^2 / pi = 286 mm^2: 62.8 %
    ("VF-W03", pouched(17.8, 6, 30.0), {E}),
    ("VF-W03", pouched(17.8, 6, 31.0), {W}),
    # 24 / pi mm over the sine of half the gap, of 100 mm: half at 17.58 degrees
    ("VF-I04", inflated((2, 100.0, 17.4)), {W}),
    ("VF-I04", inflated((2, 100.0, 17.7)), set()),
    ("VF-I04", inflated((2, 50.0, 17.4)), {E}),
    # Five of 14 mm fill 28.6 % of the child, more where they pass into it
    ("VF-W03", inflated(PAIR, (5, 90.0, 160.0), widths_mm=(40.0, 24.0, 14.0), passage=0.94), {W}),
    ("VF-W03", inflated(PAIR, (5, 90.0, 160.0), widths_mm=(40.0, 24.0, 14.0), passage=0.96), set()),
    # Loosely stored film takes 3.85 kPa to grow there
    ("VF-P03", of((2, 200.0, 60.0), widths_mm=(40.0, 23.8), pressure_kpa=3.7), {W}),
    ("VF-P03", of((2, 200.0, 60.0), widths_mm=(40.0, 23.8), pressure_kpa=4.0), set()),
    # The same where growth was measured: it forbids
    ("VF-P03", grown(pressure_kpa=3.7), {E}),
    ("VF-P03", grown(pressure_kpa=4.0), set()),
    ("VF-L06", weldcut(kerf_mm=0.41, seam_width_mm=0.4), {W}),
    ("VF-L06", weldcut(kerf_mm=0.39, seam_width_mm=0.4), set()),
    # 274.6 mm of lumen in the narrowest strip, where the rectangle of least area is 328.4 mm wide
    ("VF-S02", rolled(276.0, (2, 250.0, 210.0)), set()),
    ("VF-S02", rolled(275.0, (2, 250.0, 210.0)), {W}),
    # Whole it is 407 mm wide; its pieces are nested on sheets of 63 and 256.5 mm
    ("VF-S02", rolled(257.0, (3, 250.0, 210.0), pieces=PieceSettings()), set()),
    ("VF-S02", rolled(256.0, (3, 250.0, 210.0), pieces=PieceSettings()), {W}),
    # What was not measured, or only bore its load, warns
    ("VF-J03", cut(2, pressure_kpa=41.95, load=assumed(0.2)), {W}),
    ("VF-J03", cut(2, pressure_kpa=41.85, load=assumed(0.2)), set()),
    ("VF-J03", cut(2, pressure_kpa=41.95, load=measured(0.2), bore=True), {W}),
    ("VF-J03", cut(2, pressure_kpa=1.0, lap_mm=4.9), {W}),
    ("VF-J03", cut(2, pressure_kpa=1.0, lap_mm=5.1), set()),
    ("VF-J06", cut(2, ease_mm=0.0), {E}),
    ("VF-J06", cut(2, ease_mm=10.1), {W}),
    ("VF-J06", cut(2, ease_mm=9.9), set()),
    ("VF-J06", cut(ease_mm=20.0), set()),
    ("VF-J04", cut(1, 5, 6, widths_mm=(29.9, 20.0)), {W}),
    ("VF-J04", cut(1, 5, 6, widths_mm=(42.0, 20.0)), {W}),
    ("VF-J04", cut(widths_mm=(25.2, 20.0)), set()),
    # 14 mm and a lap of 2 x 15 mm, times 0.75 mm, in a lumen of 24^2 / pi mm^2: 18 %
    ("VF-J04", lapped(0.59), {W}),
    ("VF-J04", lapped(0.61), set()),
    ("VF-B01", of(tail_mm=199.0), {W}),
    ("VF-B02", collar_off(0.104), {E}),
    ("VF-B02", collar_off(0.096), set()),
    ("VF-B03", of(trunk_mm=2001.0), {W}),
    ("VF-B03", of(trunk_mm=1999.0), set()),
    ("VF-L02", piece(0.19, 3.0), {E}),
    ("VF-L02", piece(0.21, 3.0), set()),
    ("VF-L02", piece(2.0, 0.49), {E}),
    ("VF-L02", piece(2.0, 0.51), set()),
    ("VF-L02", twice(0.21), {E}),
    ("VF-L02", twice(0.19), set()),
    ("VF-L02", cuts_apart(0.19), {E}),
    ("VF-L02", cuts_apart(0.21), set()),
]
"""Builds close to single limits, with the severities that they must have."""


def found(subject: Subject, rule: str) -> tuple[Finding, ...]:
    report = run_checks(subject)
    assert rule in {run.rule for run in report.run}
    return tuple(finding for finding in report.findings if finding.rule == rule)


def test_every_rule_has_a_case_that_fires_and_one_that_does_not() -> None:
    assert set(CASES) == set(RULES)


@pytest.mark.parametrize("rule", CASES)
def test_rule_fires_at_the_right_place(rule: str, make: Make, profile: LaserProfile) -> None:
    case = CASES[rule]
    findings = found(case.fires(make, profile), rule)
    assert findings, "the rule must fire here"
    assert findings[0].severity is case.severity
    assert findings[0].branches == case.branches
    assert findings[0].message[-1] not in ".:"
    assert findings[0].title != RULES[rule].title
    assert ": " in findings[0].message, "it must say what helps"


@pytest.mark.parametrize("rule", CASES)
def test_rule_stays_quiet(rule: str, make: Make, profile: LaserProfile) -> None:
    assert found(CASES[rule].quiet(make, profile), rule) == ()


def test_laps_of_a_recipe_that_knows_no_bond_are_not_passed_over(
    make: Make, profile: LaserProfile
) -> None:
    subject = cut(2)(make, profile)
    assert subject.profile is not None
    unbonded = replace(profile, recipe=profile.recipe.changed(lap=None))
    for known, words in ((unbonded, "no table [lap]"), (None, "needs a recipe")):
        skipped = run_checks(replace(subject, profile=known)).skipped
        assert any(words in skip.reason for skip in skipped if skip.rule == "VF-J03")


def test_a_weak_lap_is_named_and_marked_where_it_begins(make: Make, profile: LaserProfile) -> None:
    (finding,) = found(cut(0, widths_mm=(20.0, 12.0), pressure_kpa=42.0)(make, profile), "VF-J03")
    assert finding.message.startswith("the lap of plug B, 20.0 mm wide,")
    assert (finding.x_mm, finding.y_mm) == (40.0, 0.0)
    assert (finding.measured, finding.limit) == (
        pytest.approx(42.0 * 20.0 / 2000.0 / math.pi),
        pytest.approx(0.2 / 1.5),
    )


def test_film_with_laps_that_add_nothing_packs_as_without(
    random_design: Callable[..., Design],
) -> None:
    """Branch by branch what VF-W03 says of their level."""
    for seed in range(20):
        design = random_design(np.random.default_rng(seed), pouched=True)
        levels = branch_tree(design).level.tolist()
        none = {"width_mm": 0.0, "rise_mm": 0.0}
        flat = [replace(sleeve_at(branch), **none) for branch in range(1, len(levels))]
        shares = lap_occupancies(design, flat, 0.075)
        expected = occupancies(design, 0.075)
        assert shares == {
            branch: pytest.approx(expected[level - 1])
            for branch, level in enumerate(levels)
            if level < design.depth
        }


def test_laps_count_where_they_are_and_below_one_parent_only(make: Make) -> None:
    """Two children with two leaves each: a lap on one leaf is no matter of the other child."""
    design = make((2, 200.0, 90.0), (2, 90.0, 60.0), widths_mm=(40.0, 24.0, 14.0))
    ids = branch_tree(design).ids
    sleeve = replace(sleeve_at(ids.index("0.1.0")), width_mm=14.0)
    shares = lap_occupancies(design, [sleeve], 0.075)
    assert {ids[branch] for branch in shares} == {"0", "0.1"}
    level_3_mm = 3 * 14.0 + 2 * 15.0
    assert shares[ids.index("0")] == pytest.approx(level_3_mm * 0.75 * math.pi / 40.0**2)
    assert shares[ids.index("0.1")] == pytest.approx(44.0 * 0.75 * math.pi / 24.0**2)


@pytest.mark.parametrize("rule", ["VF-R01", "VF-R02", "VF-R03", "VF-R04"])
def test_skipped_rules_about_rigs_say_what_is_missing(rule: str, make: Make) -> None:
    outcome = RULES[rule].apply(Subject.of(make()), Limits({}))
    assert isinstance(outcome, RuleNotApplicable)
    assert "needs a" in outcome.reason


def test_corridors_are_compared_with_every_level(make: Make, profile: LaserProfile) -> None:
    # 40, 24 mm lay-flat: 25.46 and 15.28 mm inflated
    subject = Subject.of(make((2, 200.0, 60.0)), profile)
    wide, narrow = (Corridor(width_mm=mm, x_mm=3.0, y_mm=4.0) for mm in (20.0, 15.0))
    course = MapCorridors(name="hall", corridors=(narrow, wide))
    findings = found(replace(subject, corridors=(course,)), "VF-R03")
    assert [(f.measured, f.limit) for f in findings] == [
        (15.0, pytest.approx(80.0 / math.pi)),
        (15.0, pytest.approx(48.0 / math.pi)),
    ]
    assert "all of the 2 narrowest" in findings[0].message
    assert "1 of the 2 narrowest" in findings[1].message
    assert "(3.0, 4.0) mm" in findings[1].message


def test_a_dead_end_is_a_corridor_for_branches_that_have_room_in_it(
    make: Make, profile: LaserProfile
) -> None:
    # 25.46 and 15.28 mm inflated: the dead end's area is between those of their cross-sections
    subject = Subject.of(make((2, 200.0, 60.0)), profile)
    notch = Corridor(width_mm=2.0, x_mm=3.0, y_mm=4.0, dead_end_mm=20.0)
    course = MapCorridors(name="hall", corridors=(notch,))
    (finding,) = found(replace(subject, corridors=(course,)), "VF-R03")
    assert finding.measured == 2.0
    assert "level 2" in finding.message


def test_a_notch_in_a_wall_of_a_map_is_no_corridor(make: Make, profile: LaserProfile) -> None:
    """A gap of the same width between two walls is one."""
    block = box(100, 100, 200, 200)
    notched = Map(
        name="notched", bounds=box(0, 0, 400, 300), obstacles=(block - box(150, 195, 150.5, 200),)
    )
    parted = Map(
        name="parted", bounds=box(0, 0, 400, 300), obstacles=(block, box(200.5, 100, 250, 200))
    )
    design = make((2, 200.0, 60.0))
    subject = Subject.of(design, profile)
    for world, widths in ((notched, []), (parted, [0.5, 0.5])):
        measured = replace(subject, corridors=(map_corridors(world, design),))
        assert [f.measured for f in found(measured, "VF-R03")] == pytest.approx(widths)


@pytest.mark.parametrize(("rule", "build", "severities"), NEAR_LIMITS)
def test_each_limit_applies_at_its_value(
    rule: str, build: Build, severities: set[Severity], make: Make, profile: LaserProfile
) -> None:
    assert {finding.severity for finding in found(build(make, profile), rule)} == severities


def test_a_child_folded_onto_its_parent_is_found(make: Make) -> None:
    findings = found(Subject.of(make((2, 300.0, 331.0))), "VF-C02")
    assert [(f.severity, f.branches) for f in findings] == [(E, ("0", "0.0"))]


def test_a_fillet_cut_down_by_a_narrow_angle_is_found(make: Make) -> None:
    # 40 degrees: the bare crotch is 35.1 mm long, half of the child 35.5 mm
    findings = found(Subject.of(make((2, 71.0, 40.0), fillet_mm=(6.0,))), "VF-C04")
    assert [f.severity for f in findings] == [E, Severity.INFO]
    assert findings[0].measured is not None
    assert findings[0].measured < 1.0
    assert findings[1].limit == 6.0


def test_a_pouch_narrower_than_its_branch_is_found(make: Make) -> None:
    subject = Subject.of(make((2, 200.0, 60.0), pouch=Pouch(shape="round", radius_mm=11.9)))
    assert [f.measured for f in found(subject, "VF-C07")] == [23.8]


@pytest.mark.parametrize(
    ("length_mm", "rules"),
    [(4.9, {"VF-W01", "VF-C07"}), (23.9, {"VF-C07"}), (24.1, set())],
)
def test_a_rectangular_pouch_of_senseless_length_is_found(
    length_mm: float, rules: set[str], make: Make
) -> None:
    rim = Pouch(shape="rectangle", length_mm=length_mm, width_mm=36.0)
    report = run_checks(Subject.of(make((2, 200.0, 60.0), pouch=rim)))
    assert {f.rule for f in report.findings if f.rule in ("VF-W01", "VF-C07")} == rules


@pytest.mark.parametrize(
    ("collar", "errors"),
    [
        (Collar(clamp_diameter_mm=70.0), 0),
        (Collar(clamp_diameter_mm=70.0, length_mm=180.0, flare_mm=40.0), 1),
        (Collar(clamp_diameter_mm=70.0, flare_mm=10.0), 1),
    ],
)
def test_a_collar_fits_clamp_and_tail(collar: Collar, errors: int, make: Make) -> None:
    # 110 mm wide at the clamp: too wide without a collar, right with one
    findings = found(Subject.of(make((2, 200.0, 60.0), collar=collar)), "VF-B02")
    assert [f.severity for f in findings] == [E] * errors


def test_widths_of_tapered_branches_count_where_they_end(make: Make) -> None:
    narrow = make((2, 200.0, 60.0), widths_mm=(30.0, 16.0), taper=(1.0, 0.3))
    assert [f.measured for f in found(Subject.of(narrow), "VF-W01")] == pytest.approx([4.8])
    close = make((2, 200.0, 60.0), widths_mm=(30.0, 16.0), taper=(0.6, 1.0))
    assert [f.measured for f in found(Subject.of(close), "VF-W02")] == pytest.approx([18 / 16])


def test_taper_is_no_fault_of_the_width_as_built(make: Make, profile: LaserProfile) -> None:
    tapered = make((3, 200.0, 120.0), taper=(0.9, 0.6))
    for rule in ("VF-W04", "VF-P05"):
        assert found(Subject.of(tapered, profile), rule) == ()
    even = replace(Subject.of(make((3, 200.0, 120.0)), profile), job=laser_job(tapered, profile))
    assert {f.branches[0] for f in found(even, "VF-W04")} == {"0", "0.0", "0.1", "0.2"}


def test_a_wide_pouch_limits_the_pressure(make: Make, profile: LaserProfile) -> None:
    wide = make((2, 200.0, 60.0), pouch=Pouch(shape="round", radius_mm=30.0), pressure_kpa=20.0)
    finding = found(Subject.of(wide, profile), "VF-P01")[0]
    assert finding.limit == pytest.approx(70.0 * 20.0 / 60.0 / 1.5)
    assert finding.branches == ("0.0",)
    assert "assumed" in finding.message


def test_the_60_mm_trunk_at_50_kpa_fails(make: Make, profile: LaserProfile) -> None:
    trunk = make(widths_mm=(60.0,), pressure_kpa=50.0)
    finding = found(Subject.of(trunk, profile), "VF-P01")[0]
    assert (finding.measured, finding.limit) == (50.0, pytest.approx(15.56, abs=0.01))


def test_a_path_with_many_turns_is_found_by_its_capstan_factor(make: Make) -> None:
    # 7 joints of 81 degrees: e^(0.234 * 9.9) = 10.1
    winding = make(*[(2, 100.0, 162.0)] * 7, widths_mm=tuple(40.0 * 0.8**n for n in range(8)))
    findings = found(Subject.of(winding), "VF-C06")
    assert [f.severity for f in findings] == [W]
    assert "10.1" in findings[0].message


def test_turns_at_contacts_count_when_a_deployment_is_given(make: Make) -> None:
    subject = Subject.of(make())
    turned = Deployment(
        tree=subject.layout.tree,
        pose=Pose(x_mm=0.0, y_mm=0.0, heading_rad=0.0),
        points_mm=np.array([[0.0, 0.0], [300.0, 0.0]]),
        first_point=np.array([0, 2]),
        stop=np.array([0]),
        grown_mm=np.array([300.0]),
        contact_turn_rad=np.array([10.0]),
    )
    assert found(subject, "VF-C06") == ()
    assert len(found(replace(subject, deployments=(turned,)), "VF-C06")) == 1


def test_a_weld_after_a_cut_is_found(make: Make, profile: LaserProfile) -> None:
    backwards = jobbed(lambda job: tuple(reversed(job.paths)))
    assert {f.severity for f in found(backwards(make, profile), "VF-L03")} == {E}


def test_tiny_pieces_are_found(make: Make, profile: LaserProfile) -> None:
    short = path(Operation.CUT, [[500.0, 500.0], [500.19, 500.0], [520.0, 500.0]])
    tight = LaserPath(
        operation=Operation.CUT,
        contour=Contour(
            points_mm=np.array([[600.0, 500.0], [600.98, 500.0]]),
            bulges=np.array([1.0]),
            parts=short.contour.parts[:1],
            branches=("",),
            closed=False,
        ),
        label="tight",
    )
    build = jobbed(lambda job: (*job.paths, short, tight))
    findings = found(build(make, profile), "VF-L02")
    assert sorted(f.measured or 0.0 for f in findings) == pytest.approx([0.19, 0.49])


def test_fast_small_arcs_are_found(make: Make, profile: LaserProfile) -> None:
    # weldcut at 60 mm/s: a fillet of 2 mm less the beam's offset asks for 2.5 m/s^2, of 3 allowed
    operations = dict(profile.recipe.by_operation)
    weldcut = operations["weldcut"]
    operations["weldcut"] = weldcut.changed(speed_mm_s=scaled(weldcut.speed_mm_s, 70.0))
    fast = replace(profile, recipe=profile.recipe.changed(operations=operations))
    design = make((2, 200.0, 60.0), widths_mm=(24.0, 8.0), fillet_mm=(2.0,))
    assert found(Subject.of(design, profile), "VF-L05") == ()
    (slowed,) = found(Subject.of(design, fast), "VF-L05")
    assert (slowed.measured, slowed.unit) == (70.0, "mm/s")
    assert f"{slowed.limit:.0f} mm/s" in slowed.message
    (top,) = found(speed(501.0)(make, profile), "VF-L05")
    assert (top.measured, top.limit) == (501.0, 500.0)


def test_a_pressure_too_low_to_grow_is_said_also_where_the_window_is_closed(
    make: Make, profile: LaserProfile
) -> None:
    subject = of((2, 200.0, 60.0), widths_mm=(100.0, 11.75), pressure_kpa=2.0)(make, profile)
    window, working = found(subject, "VF-P03")
    assert window.fingerprint != working.fingerprint
    assert (working.severity, working.limit) == (W, 2.0)
    assert working.measured == pytest.approx(7.81, abs=0.01)
    assert "2 kPa" in working.message


@pytest.mark.parametrize(
    ("build", "rule", "note"),
    [
        (of(trunk_mm=1000.0), "VF-S01", "2 tiles"),
        (of(trunk_mm=300.0), "VF-S01", ""),
        (of((2, 200.0, 60.0), (1, 60.0, 40.0)), "VF-C02", "level 3 has one child"),
        (of((2, 200.0, 60.0), (1, 60.0, 0.0)), "VF-C02", ""),
    ],
)
def test_what_happens_to_a_design_without_being_wrong_is_noted(
    make: Make, profile: LaserProfile, build: Build, rule: str, note: str
) -> None:
    (run,) = run_checks(build(make, profile), only=(rule,)).run
    assert note in run.note
    assert bool(run.note) == bool(note)


def test_a_film_that_does_not_weld_is_found(make: Make, profile: LaserProfile) -> None:
    assert len(found(material(weldable=False)(make, profile), "VF-L04")) == 1
