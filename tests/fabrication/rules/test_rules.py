"""Every rule on fixtures within a tenth of each of its limits, on both sides."""

import math
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from shapely import box

from tests.fabrication.rules.conftest import LOOSE_FIT, make_design, measured
from vinefab.fabrication.checking import map_corridors
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.pieces.partition import in_pieces, partition_of
from vinefab.fabrication.rules.catalog import RULES, run_checks
from vinefab.fabrication.rules.rule import (
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
from vinefab.model.design import Collar, PieceSettings, Pouch
from vinefab.model.finding import Severity
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import RecipeStatus, read_profile
from vinefab.model.map import Map, Pose
from vinefab.model.outline import Contour, Part
from vinefab.model.quantity import Quantity, Standing
from vinefab.model.tree import Partition, Piece, Sleeve, fan_offsets_rad, piece_label

PROFILE = read_profile("co2_60w__stretchlon_200")
E, W, INFO = Severity.ERROR, Severity.WARNING, Severity.INFO
PAIR = (2, 200.0, 90.0)


def lazy(build):
    """Return a function that remembers arguments: a fixture is built once, when a test asks."""
    return lambda *args, **options: cache(partial(build, *args, **options))


@lazy
def of(*fans, **build):
    return Subject.of(make_design(*fans, **build), PROFILE)


def with_profile(design=None, *, material=None, recipe=None, machine=None):
    """Return a design (a plain vine) on the shipped recipe with some changes."""
    changed = {
        name: getattr(PROFILE, name).changed(**keys)
        for name, keys in {"material": material, "recipe": recipe, "machine": machine}.items()
        if keys
    }
    return Subject.of(design or make_design(), replace(PROFILE, **changed))


def operations(name, **values):
    """Return the recipe's operations, one with other values."""
    old = PROFILE.recipe.by_operation[name]
    new = old.changed(**{key: getattr(old, key).changed(value=v) for key, v in values.items()})
    return {**PROFILE.recipe.by_operation, name: new}


def cousins(gap_mm):
    """Two children 40 degrees apart, each with one straight child: its gap to its uncle is known.

    The grandchild begins L sin(40 deg) from the uncle's centre line; half widths are 12 and 7.
    """
    length_mm = (gap_mm + 12.0 + 7.0) / math.sin(math.radians(40.0))
    return of((2, length_mm, 40.0), (1, 60.0, 0.0), widths_mm=(40.0, 24.0, 14.0))


@lazy
def near_fillet(gap_mm):
    """A grandchild shrunk to a disc that floats before the arc of its uncle's fillet."""
    design = make_design((2, 200.0, 90.0), (2, 90.0, 60.0), fillet_mm=(9.0, 4.0))
    subject = Subject.of(design, PROFILE)
    arcs = [s for s in subject.outline.contour.segments if s.part is Part.FILLET]
    arc = next(s for s in arcs if s.branch == "0.0" and s.radius_mm > 8.9)
    ends = arc.flattened_mm(0.001)
    middle, center = ends[len(ends) // 2], np.array(arc.center_mm)
    disc = {"half_mm": 0.5, "end_half_mm": 0.5}
    disc |= dict.fromkeys(("start_mm", "end_mm"), middle + (center - middle) / 9.0 * (gap_mm + 0.5))
    moved = {name: getattr(subject.capsules, name).copy() for name in disc}
    for name, value in disc.items():
        moved[name][subject.names.index("0.1.1")] = value
    return replace(subject, capsules=replace(subject.capsules, **moved))


@lazy
def seam(extra_mm):
    """Paths drawn with another seam than the recipe's."""
    wide = PROFILE.recipe.by_operation["weldcut"].seam_width_mm.value + extra_mm
    recipe = PROFILE.recipe.changed(operations=operations("weldcut", seam_width_mm=wide))
    design = make_design((2, 150.0, 60.0))
    job = laser_job(design, replace(PROFILE, recipe=recipe))
    return replace(Subject.of(design, PROFILE), job=job)


@lazy
def material(**changes):
    return with_profile(material=changes)


@lazy
def status(value):
    return with_profile(recipe={"status": value})


@lazy
def speed(mm_s):
    return with_profile(recipe={"operations": operations("mark", speed_mm_s=mm_s)})


@lazy
def weldcut(**values):
    """A plain vine on a calibrated recipe with other values of the one-pass operation."""
    changed = operations("weldcut", **values)
    return with_profile(recipe={"operations": changed, "status": RecipeStatus.COUPON_OK})


@lazy
def rolled(roll_mm, *fans, **build):
    """A robot on a bed of 400 x 280 mm, or its pieces on sheets, and a roll of film."""
    film = PROFILE.material.changed(roll_width_mm=assumed(roll_mm))
    bed = {"bed_width_mm": assumed(400.0), "bed_height_mm": assumed(280.0)}
    narrow = replace(PROFILE, material=film, machine=PROFILE.machine.changed(**bed))
    design = make_design(*fans, trunk_mm=60.0, **build)
    partition = partition_of(design, narrow) if design.build.pieces else None
    job = laser_job(design, narrow, partition=partition)
    return replace(Subject.of(design), profile=narrow, job=job)


@lazy
def jobbed(change):
    """A plain vine whose paths were changed."""
    subject = Subject.of(make_design(), PROFILE)
    return replace(subject, job=replace(subject.job, paths=change(subject.job)))


def path(operation, points, *, closed=False):
    contour = Contour.polyline(np.array(points), closed=closed)
    return LaserPath(operation=operation, contour=contour, label="extra")


def marked(away_mm):
    """A mark above the robot."""

    def above(job):
        top = max(one.contour.box_mm[3] for one in job.along(Operation.WELDCUT)) + away_mm
        return (path(Operation.MARK, [[300.0, top], [310.0, top]]), *job.paths)

    return jobbed(above)


@lazy
def tipped(radius_mm, turn_deg=0.0):
    """A tube on a hot tip's recipe, its seam replaced by two lines with an arc or a corner."""
    subject = Subject.of(make_design(), read_profile("hot_tip_220__stretchlon_200"))
    turn = math.radians(turn_deg or 60.0)
    corner = (radius_mm * math.sin(turn), radius_mm * (1.0 - math.cos(turn)))
    bulges = [0.0, math.tan(turn / 4.0), 0.0] if radius_mm else [0.0, 0.0]
    points = [(-20.0, 0.0), (0.0, 0.0)]
    points += [corner] if radius_mm else []
    points += [(corner[0] + 20.0 * math.cos(turn), corner[1] + 20.0 * math.sin(turn))]
    line = Contour.polyline(np.array(points), closed=False)
    bent = replace(line, bulges=np.array(bulges)).moved(0.0, 100.0, 100.0)
    seam = LaserPath(operation=Operation.WELD, contour=bent, label="seam of bent", of="bent")
    return replace(subject, job=replace(subject.job, paths=(seam,)))


def closing(job):
    """The paths of a plain vine, with its seam drawn on across its mouth."""
    sealed = next(one for one in job.paths if one.operation is Operation.WELDCUT)
    points = sealed.contour.points_mm
    across = Contour.polyline(points[[-1, 0]], closed=False)
    return (replace(sealed, contour=across), *job.paths)


def square(low, high):
    corners = [[low, low], [high, low], [high, high], [low, high]]
    return path(Operation.CUT, corners, closed=True)


def cuts(*paths):
    """A plain vine with more paths, or squares to be cut, given by two corners."""
    more = [one if isinstance(one, LaserPath) else square(*one) for one in paths]
    return jobbed(lambda job: (*job.paths, *more))


@lazy
def rigged(height_mm=60.0, size_mm=(210.0, 100.0, 63.0), problems=()):
    """A plain vine and a rig of one part."""
    part = RigPartFacts(name="part_01", size_mm=size_mm, problems=problems)
    room = (210.0, 210.0, 250.0)
    rig = RigFacts(name="table", printer="bench", room_mm=room, height_mm=height_mm, parts=(part,))
    return replace(Subject.of(make_design(), PROFILE), rig=rig)


def in_course(*corridors, fans=()):
    """A robot and a map with corridors, narrowest first."""
    hall = MapCorridors(name="hall", corridors=corridors)
    return replace(Subject.of(make_design(*fans), PROFILE), corridors=(hall,))


@lazy
def corridor(width_mm):
    """A plain vine, 40 mm wide lay-flat, and a map with a narrow and a wide corridor."""
    return in_course(*(Corridor(width_mm=mm, x_mm=1.0, y_mm=2.0) for mm in (width_mm, 90.0)))


@lazy
def course(*widths_mm, **corridor):
    """A robot of 40 and 24 mm, and a map with corridors."""
    places = (Corridor(width_mm=mm, x_mm=3.0, y_mm=4.0, **corridor) for mm in widths_mm)
    return in_course(*places, fans=((2, 200.0, 60.0),))


@lazy
def hurried(mm_s, *fans, **build):
    """A robot that is cut in one pass at another speed."""
    changed = {"operations": operations("weldcut", speed_mm_s=mm_s)}
    return with_profile(make_design(*fans, **build), recipe=changed)


@lazy
def reading(*problems):
    files = {"outline.dxf": problems, "outline.svg": ()}
    return Subject.of(make_design(), PROFILE, readback=files)


def pouch(radius_mm, length_mm=200.0):
    """Two leaves 40 degrees apart: tips of 200 mm are 136.8 mm apart."""
    return of((2, length_mm, 40.0), pouch=Pouch(shape="round", radius_mm=radius_mm))


def rectangle(length_mm):
    rim = Pouch(shape="rectangle", length_mm=length_mm, width_mm=36.0)
    return of((2, 200.0, 60.0), pouch=rim)


def pouched(leaf_mm, branches=2, trunk_mm=60.0):
    """Leaves with a pouch that is 40 mm wide."""
    rim = Pouch(shape="rectangle", length_mm=40.0, width_mm=40.0)
    return of((branches, 200.0, 120.0), widths_mm=(trunk_mm, leaf_mm), pouch=rim)


def assumed(value):
    return Quantity(value=value, standing=Standing.ASSUMED, source="a test")


@lazy
def burst(*fans, growth=None, width=None, **build):
    """A film whose seam was measured: a tube of 20 mm burst at 70 kPa."""
    film = {"burst_kpa": measured(70.0), "burst_width_mm": width or measured(20.0)}
    film |= {"survived_kpa": None, "survived_width_mm": None}
    return with_profile(make_design(*fans, **build), material=film, recipe={"growth": growth})


@lazy
def collar_off(off_mm):
    """A tail whose mouth was drawn for another clamp."""
    drawn, meant = (
        make_design(collar=Collar(clamp_diameter_mm=30.0 + 2.0 * more_mm / math.pi))
        for more_mm in (0.0, off_mm)
    )
    return replace(Subject.of(drawn, PROFILE), design=meant)


def clamped(**collar):
    """110 mm wide at the clamp: too wide without a collar, right with one."""
    return of((2, 200.0, 60.0), collar=Collar(clamp_diameter_mm=70.0, **collar))


@lazy
def winding(fan_deg):
    """Seven joints, each half a fan off the way before; without paths, of so many branches."""
    widths_mm = tuple(40.0 * 0.8**level for level in range(8))
    return Subject.of(make_design(*[(2, 100.0, fan_deg)] * 7, widths_mm=widths_mm))


def piece(line_mm, radius_mm):
    """A cut with a line and a half circle of given sizes."""
    points = np.array([[500.0, 500.0], [500.0 + line_mm, 500.0], [500.0 + line_mm, 520.0]])
    line = Contour.polyline([*points, points[-1] + [2.0 * radius_mm, 0.0]], closed=False)
    contour = replace(line, bulges=np.array([0.0, 0.0, -1.0]))
    return cuts(LaserPath(operation=Operation.CUT, contour=contour, label="piece"))


def twice(shared_mm):
    """A mark of which a part lies on a cut."""
    return cuts(
        path(Operation.MARK, [[500.0, 500.0], [520.0, 500.0]]),
        path(Operation.CUT, [[520.0 - shared_mm, 500.0], [540.0, 500.0]]),
    )


def cuts_apart(between_mm):
    """Two cuts next to each other; the kerf of either is 0.2 mm wide."""
    low_high = (500.0, 500.0 + between_mm)
    return cuts(*(path(Operation.CUT, [[500.0, y], [520.0, y]]) for y in low_high))


def sleeve_at(branch, number=1, **changes):
    """A sleeve on a branch of 20 mm, of the piece with a number."""
    rims = {"plug_mm": 40.0, "socket_mm": 55.0, "blend_end_mm": 35.0}
    known = {"label": piece_label(number), "inner": "A", "branch": branch, **rims}
    return Sleeve(**{**known, "rise_mm": 1.0, "width_mm": 20.0, **changes})


def parted(count, *sleeves):
    """Return so many branches in pieces of a single branch each, but for the base's."""
    rows = tuple(sleeve.branch for sleeve in sleeves)
    kept = tuple(branch for branch in range(count) if branch not in rows)
    outer = [Piece(label=s.label, root=s.branch, branches=(s.branch,)) for s in sleeves]
    base = Piece(label="A", root=0, branches=kept, stubs=rows)
    return Partition(pieces=(base, *outer), sleeves=sleeves)


@lazy
def cut(*branches, load=None, bore=False, lap_mm=15.0, ease_mm=1.5, **build):
    """A fan of children of 20 mm of which some are cut, by index; the trunk is 60 mm wide."""
    settings = PieceSettings(lap_mm=lap_mm, ease_mm=ease_mm)
    design = make_design((8, 200.0, 280.0), pieces=settings, **{"widths_mm": (60.0, 20.0), **build})
    key = "survived_n_per_mm" if bore else "strength_n_per_mm"
    known = {"strength_n_per_mm": None, key: load or measured(0.2)}
    subject = with_profile(design, recipe={"lap": PROFILE.recipe.lap.changed(**known)})
    sleeves = (sleeve_at(branch, number) for number, branch in enumerate(branches, 1))
    return replace(subject, partition=parted(9, *sleeves))


@lazy
def inflated(*fans, off_deg=0.0, sensitivity=1.0, crotch_load=1.0, passage=1.0, **build):
    """A robot whose joints have given figures, the outer children deployed off their angles."""
    design = make_design(*fans, **build)
    joints, widths = [], design.build.widths_mm
    for place, level in enumerate(design.levels):
        wanted = tuple(np.degrees(fan_offsets_rad(level)).tolist())
        flat = JointShape(
            angles_deg=wanted,
            widths=(widths[place + 1] / widths[place],) * level.branches,
            fillets=(0.15,) * (level.branches + 1),
        )
        found = FlatJoint(
            flat=flat,
            deployed_deg=(*wanted[:-1], wanted[-1] + off_deg),
            pull_backs=(0.0,) * level.branches,
            side_offsets=(0.0,) * level.branches,
            sensitivity=sensitivity,
            crotch_load=crotch_load,
            passage=passage,
        )
        joints.append(
            PatternJoint(
                level=place + 2,
                width_mm=widths[place],
                child_widths_mm=(widths[place + 1],) * level.branches,
                rows=tuple(np.flatnonzero(design.tree.level == place + 1).tolist()),
                name=f"level {place + 2}",
                is_bend=False,
                wanted_deg=wanted,
                aimed_deg=wanted,
                found=found,
            )
        )
    pattern = Pattern(design=design, flat=design, deployed=design, joints=tuple(joints))
    return replace(Subject.of(design, PROFILE), pattern=pattern)


@lazy
def lapped(passage):
    """A leaf of 14 mm with a lap, which rides in a child of 24 mm, through its joint's passage."""
    known = {"widths_mm": (40.0, 24.0, 14.0), "pieces": PieceSettings()}
    subject = inflated(PAIR, (2, 90.0, 60.0), passage=passage, **known)()
    sleeve = sleeve_at(subject.names.index("0.1.0"), width_mm=14.0)
    return replace(subject, partition=parted(7, sleeve))


def meeting(gap_mm):
    """Two grandchildren that run together: their tips are where they are nearest when inflated.

    They begin 100 mm apart, head 30 degrees inwards, and are 28 / pi mm thick together.
    """
    length_mm = 100.0 - 28.0 / math.pi - gap_mm
    return inflated((2, 100.0, 60.0), (2, length_mm, 120.0), widths_mm=(40.0, 24.0, 14.0))


@lazy
def pieced(most=6, lap_mm=15.0, unmarked=""):
    """Two leaves that cross, in the fewest pieces; the labels named are missing on the film."""
    settings = PieceSettings(most=most, lap_mm=lap_mm)
    design = make_design((2, 100.0, 60.0), (2, 100.0, 120.0), pieces=settings)
    partition = partition_of(design, PROFILE)
    job = laser_job(design, PROFILE, partition=partition)
    paths = tuple(one for one in job.paths if not unmarked or unmarked not in one.label)
    flat = replace(Subject.of(design), profile=PROFILE, job=replace(job, paths=paths))
    return in_pieces(flat, partition)


def fives(passage):
    """Five leaves of 14 mm on a child of 24 mm, through the passage of their joint."""
    wide = (40.0, 24.0, 14.0)
    return inflated(PAIR, (5, 90.0, 160.0), widths_mm=wide, passage=passage)


def grown(**build):
    return burst((2, 200.0, 60.0), widths_mm=(40.0, 23.8), growth=LOOSE_FIT, **build)


FIXTURES = [
    ("VF-T01", of((2, 0.09, 60.0)), "E 0.0"),
    ("VF-T01", of((2, 0.11, 60.0)), ""),
    ("VF-T02", of((2, 100.0, 60.0), (2, 100.0, 120.0)), "E 0.0.1 0.1.0"),
    ("VF-T02", of((3, 200.0, 120.0), (2, 120.0, 50.0)), ""),
    ("VF-T03", cousins(-0.1), "E 0.0 0.1.0"),
    ("VF-T03", cousins(0.1), ""),
    ("VF-T04", of(widths_mm=(4.9,)), "E 0"),
    ("VF-T04", of(widths_mm=(5.1,)), ""),
    ("VF-W01", of(widths_mm=(4.9,)), "E 0"),
    ("VF-W01", of(widths_mm=(8.1,)), ""),
    ("VF-W02", of((2, 200.0, 60.0), widths_mm=(23.8, 20.0)), "E 0.0"),
    ("VF-W02", of((2, 200.0, 60.0), widths_mm=(30.2, 20.0)), ""),
    # 24 mm x 0.075 mm / 0.1 = 18 mm^2 each, in a lumen of 40^2 / pi = 509 mm^2
    ("VF-W03", of((17, 200.0, 300.0)), "E 0"),
    ("VF-W03", of((8, 200.0, 180.0)), ""),
    ("VF-W04", seam(0.052), "E 0"),
    ("VF-W04", seam(0.048), ""),
    ("VF-C01", cousins(2.0), "E 0.0 0.1.0"),
    ("VF-C01", cousins(4.3), ""),
    ("VF-C02", of((2, 200.0, 14.9)), "E 0.0 0.1"),
    ("VF-C02", of((2, 200.0, 20.1)), ""),
    # 24 mm wide at 60 degrees: the sides part 12 / sin(30) = 24 mm from the joint
    ("VF-C03", of((2, 47.9, 60.0)), "E 0.0 0.1"),
    ("VF-C03", of((2, 48.1, 60.0)), ""),
    ("VF-C04", of((2, 200.0, 60.0), fillet_mm=(0.9,)), "E 0 0.0"),
    ("VF-C04", of((2, 200.0, 60.0), fillet_mm=(6.0,)), ""),
    ("VF-C06", of((2, 200.0, 181.0)), "W 0.0"),
    ("VF-C06", of((2, 200.0, 179.0)), ""),
    ("VF-C05", near_fillet(2.0), "E 0.0 0.1.1"),
    ("VF-C05", near_fillet(4.3), ""),
    ("VF-C07", pouch(67.4), "E 0.0 0.1"),
    ("VF-C07", pouch(66.2), ""),
    # 70 kPa at 20 mm is 35 kPa at 40 mm, 23.3 kPa with the factor of 1.5
    ("VF-P01", burst(pressure_kpa=23.4), "E 0"),
    ("VF-P01", of(pressure_kpa=23.3), ""),
    # Narrow, so that the load of the test is not reached
    ("VF-P02", burst(widths_mm=(10.0,), pressure_kpa=70.1), "W 0"),
    ("VF-P02", burst(widths_mm=(10.0,), pressure_kpa=69.9), ""),
    # 40 mm, 0.0375 mm, 30 MPa: 50 % at 44.2 kPa
    ("VF-P04", of(pressure_kpa=44.5), "W 0"),
    ("VF-P04", of(pressure_kpa=44.0), ""),
    # Loosely stored film: 91.7 kPa mm / w on the leaf, 778 kPa mm / w allowed on the trunk
    ("VF-P03", burst((2, 200.0, 60.0), widths_mm=(100.0, 11.75), growth=LOOSE_FIT), "E 0.0"),
    ("VF-P03", of((2, 200.0, 60.0), widths_mm=(40.0, 23.8)), ""),
    ("VF-P05", seam(-0.0052), "W 0"),
    ("VF-P05", seam(-0.0048), ""),
    ("VF-I01", inflated(PAIR, off_deg=0.61), "E 0.0"),
    ("VF-I01", inflated(PAIR, off_deg=0.59), ""),
    ("VF-I02", inflated(PAIR, sensitivity=2.51), "W 0.0"),
    ("VF-I02", inflated(PAIR, sensitivity=2.49), ""),
    # 70 kPa at 20 mm is 1.75 times the load of 20 kPa at 40 mm
    ("VF-I03", inflated(PAIR, crotch_load=1.76, pressure_kpa=20.0), "W 0.0"),
    ("VF-I03", inflated(PAIR, crotch_load=1.74, pressure_kpa=20.0), ""),
    ("VF-I04", meeting(-0.1), "W 0.0.1 0.1.0"),
    ("VF-I04", meeting(0.1), ""),
    ("VF-B01", of(tail_mm=149.0), "E 0"),
    ("VF-B01", of(tail_mm=200.0), ""),
    ("VF-B02", of(widths_mm=(101.0,)), "E 0"),
    ("VF-B02", of(widths_mm=(99.0,)), ""),
    ("VF-B03", of(trunk_mm=249.0), "W 0"),
    ("VF-B03", of(trunk_mm=251.0), ""),
    # 1000 mm of width fit the bed neither whole nor in tiles; 1200 mm of length do
    ("VF-S01", of(widths_mm=(1000.0,)), "E"),
    ("VF-S01", of(trunk_mm=1000.0), ""),
    # 40 mm of lumen, 0.55 mm to the beam and 2 mm of overcut at the mouth, on both sides
    ("VF-S02", material(roll_width_mm=assumed(45.0)), "W"),
    ("VF-S02", material(roll_width_mm=assumed(45.2)), ""),
    ("VF-L01", marked(2.9), "E"),
    ("VF-L01", marked(3.1), ""),
    ("VF-L02", jobbed(lambda job: (*job.paths, job.paths[-1])), "E 0"),
    ("VF-L02", cuts((500.0, 520.0)), ""),
    ("VF-L03", cuts((400.0, 500.0), (420.0, 440.0)), "E"),
    ("VF-L03", cuts((420.0, 440.0), (400.0, 500.0)), ""),
    ("VF-L04", material(ply_mm=assumed(0.05)), "E"),
    ("VF-L04", material(ply_mm=assumed(0.0375)), ""),
    ("VF-L05", speed(501.0), "W"),
    ("VF-L05", speed(499.0), ""),
    ("VF-L06", status(RecipeStatus.UNVERIFIED), "W"),
    ("VF-L06", status(RecipeStatus.COUPON_OK), ""),
    # A seam of 1 mm: no bend under 0.5 mm, no corner over 5 degrees
    ("VF-L07", tipped(0.49), "E"),
    ("VF-L07", tipped(0.51), ""),
    ("VF-L07", tipped(0.0, 5.4), "E"),
    ("VF-L07", tipped(0.0, 4.6), ""),
    ("VF-L08", jobbed(closing), "E"),
    ("VF-L08", of(), ""),
    ("VF-R01", rigged(problems=("is not closed",)), "E"),
    ("VF-R01", rigged(), ""),
    ("VF-R02", rigged(size_mm=(100.0, 210.01, 63.0)), "E"),
    ("VF-R02", rigged(size_mm=(210.0, 210.0, 250.0)), ""),
    # 40 mm lay-flat inflates to 80 / pi = 25.46 mm; 1.2 times that is 30.56 mm
    ("VF-R03", corridor(25.4), "W"),
    ("VF-R03", corridor(25.5), ""),
    ("VF-R04", rigged(height_mm=30.5), "W"),
    ("VF-R04", rigged(height_mm=30.6), ""),
    ("VF-J01", pieced(lap_mm=80.0), "E 0.0.1 0.1.0"),
    ("VF-J01", pieced(), ""),
    ("VF-J02", pieced(most=1), "E"),
    ("VF-J02", pieced(most=2), ""),
    ("VF-J05", pieced(unmarked="socket B"), "W"),
    ("VF-J05", pieced(), ""),
    # 0.2 N/mm with the factor of 1.5 is 0.1333 N/mm: 41.89 kPa at 20 mm
    ("VF-J03", cut(2, pressure_kpa=41.95), "E 0.1"),
    ("VF-J03", cut(2, pressure_kpa=41.85), ""),
    # The film is 0.075 mm thick; a lap of 15 mm has 5 mm on each side of a band of 5 mm.
    ("VF-J06", cut(2, 3, ease_mm=0.074), "E 0.1 0.2"),
    ("VF-J06", cut(2, 3, ease_mm=0.076), ""),
    # 5 x 20 mm and three laps of 2 x 21 mm, times 0.75 mm, in a lumen of 29.8^2 / pi mm^2: 60 %
    ("VF-J04", cut(1, 5, 6, widths_mm=(29.7, 20.0)), "E 0"),
    ("VF-J04", cut(1, 5, 6, widths_mm=(42.2, 20.0)), ""),
    ("VF-X01", reading("area differs by 3 %"), "E"),
    ("VF-X01", reading(), ""),
    ("VF-W01", of(widths_mm=(7.9,)), "W 0"),
    ("VF-W02", of((2, 200.0, 60.0), widths_mm=(29.8, 20.0)), "W 0.0"),
    ("VF-W03", of((9, 200.0, 200.0)), "W 0"),
    # seam, kerf and melted rim take 1.1 mm on each side
    ("VF-C01", cousins(4.1), "W 0.0 0.1.0"),
    ("VF-C01", cousins(2.3), "W 0.0 0.1.0"),
    ("VF-C02", of((2, 200.0, 19.9)), "W 0.0 0.1"),
    ("VF-C04", of((2, 200.0, 60.0), fillet_mm=(5.9,)), "W 0 0.0"),
    ("VF-C04", of((2, 200.0, 60.0), widths_mm=(20.0, 6.0), fillet_mm=(1.9,)), "W 0 0.0"),
    ("VF-C04", of((2, 400.0, 150.0), fillet_mm=(23.9,)), ""),
    ("VF-C04", of((2, 400.0, 150.0), fillet_mm=(24.1,)), "W 0 0.0"),
    ("VF-C04", of((2, 400.0, 150.0), fillet_mm=(47.9,)), "W 0 0.0"),
    ("VF-C04", of((2, 400.0, 150.0), fillet_mm=(48.1,)), "E 0 0.0"),
    ("VF-C05", near_fillet(4.1), "W 0.0 0.1.1"),
    # 7 joints of 81 degrees: e^(0.234 * 9.9) = 10.1; of 80 degrees 9.8
    ("VF-C06", winding(162.0), "W 0.0.0.0.0.0.0.0"),
    ("VF-C06", winding(160.0), ""),
    ("VF-C07", pouch(66.35), "W 0.0 0.1"),
    # What was not measured warns: the seam, or what growth takes
    ("VF-P01", of(pressure_kpa=23.4), "W 0"),
    ("VF-P01", burst(pressure_kpa=23.3), ""),
    ("VF-P01", burst(pressure_kpa=23.4, width=assumed(20.0)), "W 0"),
    ("VF-P02", of(pressure_kpa=70.1), "W 0"),
    ("VF-P03", of((2, 200.0, 60.0), widths_mm=(100.0, 11.75)), "W 0.0"),
    ("VF-P03", burst((2, 200.0, 60.0), widths_mm=(100.0, 11.75)), "W 0.0"),
    ("VF-P03", burst((2, 200.0, 60.0), widths_mm=(100.0, 11.83), growth=LOOSE_FIT), ""),
    ("VF-P03", of((2, 200.0, 60.0), widths_mm=(100.0, 11.83)), ""),
    # 40 mm x 0.075 mm / 0.1 = 30 mm^2 of pouch, in a lumen of 12^2 / pi = 45.8 mm^2: 65.5 %
    ("VF-W03", pouched(12.0), "E 0.0"),
    ("VF-W03", pouched(12.6), "W 0.0"),
    ("VF-W03", pouched(17.8), ""),
    # Six pouches of 40 mm in a trunk of 30^2 / pi = 286 mm^2: 62.8 %
    ("VF-W03", pouched(17.8, 6, 30.0), "E 0"),
    ("VF-W03", pouched(17.8, 6, 31.0), "W 0"),
    # 24 / pi mm over the sine of half the gap, of 100 mm: half at 17.58 degrees
    ("VF-I04", inflated((2, 100.0, 17.4)), "W 0.0"),
    ("VF-I04", inflated((2, 100.0, 17.7)), ""),
    ("VF-I04", inflated((2, 50.0, 17.4)), "E 0.0"),
    # Five of 14 mm fill 28.6 % of the child, more where they pass into it
    ("VF-W03", fives(0.94), "W 0.0"),
    ("VF-W03", fives(0.96), ""),
    # Loosely stored film takes 3.85 kPa to grow there
    ("VF-P03", of((2, 200.0, 60.0), widths_mm=(40.0, 23.8), pressure_kpa=3.7), "W 0.0"),
    ("VF-P03", of((2, 200.0, 60.0), widths_mm=(40.0, 23.8), pressure_kpa=4.0), ""),
    # The same where growth was measured: it forbids
    ("VF-P03", grown(pressure_kpa=3.7), "E 0.0"),
    ("VF-P03", grown(pressure_kpa=4.0), ""),
    ("VF-L06", weldcut(kerf_mm=0.41, seam_width_mm=0.4), "W"),
    ("VF-L06", weldcut(kerf_mm=0.39, seam_width_mm=0.4), ""),
    # 274.6 mm of lumen in the narrowest strip, where the rectangle of least area is 328.4 mm wide
    ("VF-S02", rolled(276.0, (2, 250.0, 210.0)), ""),
    ("VF-S02", rolled(275.0, (2, 250.0, 210.0)), "W"),
    # Whole it is 407 mm wide; its pieces are nested on sheets of 63 and 256.5 mm
    ("VF-S02", rolled(257.0, (3, 250.0, 210.0), pieces=PieceSettings()), ""),
    ("VF-S02", rolled(256.0, (3, 250.0, 210.0), pieces=PieceSettings()), "W"),
    # What was not measured, or only bore its load, warns
    ("VF-J03", cut(2, pressure_kpa=41.95, load=assumed(0.2)), "W 0.1"),
    ("VF-J03", cut(2, pressure_kpa=41.85, load=assumed(0.2)), ""),
    ("VF-J03", cut(2, pressure_kpa=41.95, load=measured(0.2), bore=True), "W 0.1"),
    ("VF-J03", cut(2, pressure_kpa=1.0, lap_mm=4.9), "W 0.1"),
    ("VF-J03", cut(2, pressure_kpa=1.0, lap_mm=5.1), ""),
    ("VF-J06", cut(2, ease_mm=0.0), "E 0.1"),
    ("VF-J06", cut(2, ease_mm=10.1), "W 0.1"),
    ("VF-J06", cut(2, ease_mm=9.9), ""),
    ("VF-J06", cut(ease_mm=20.0), ""),
    ("VF-J04", cut(1, 5, 6, widths_mm=(29.9, 20.0)), "W 0"),
    ("VF-J04", cut(1, 5, 6, widths_mm=(42.0, 20.0)), "W 0"),
    ("VF-J04", cut(widths_mm=(25.2, 20.0)), ""),
    # 14 mm and a lap of 2 x 15 mm, times 0.75 mm, in a lumen of 24^2 / pi mm^2: 18 %
    ("VF-J04", lapped(0.59), "W 0.1"),
    ("VF-J04", lapped(0.61), ""),
    ("VF-B01", of(tail_mm=199.0), "W 0"),
    ("VF-B02", collar_off(0.104), "E 0"),
    ("VF-B02", collar_off(0.096), ""),
    ("VF-B03", of(trunk_mm=2001.0), "W 0"),
    ("VF-B03", of(trunk_mm=1999.0), ""),
    ("VF-L02", piece(0.19, 3.0), "E"),
    ("VF-L02", piece(0.21, 3.0), ""),
    ("VF-L02", piece(2.0, 0.49), "E"),
    ("VF-L02", piece(2.0, 0.51), ""),
    ("VF-L02", twice(0.21), "E"),
    ("VF-L02", twice(0.19), ""),
    ("VF-L02", cuts_apart(0.19), "E"),
    ("VF-L02", cuts_apart(0.21), ""),
    ("VF-L03", jobbed(lambda job: tuple(reversed(job.paths))), "E"),
    ("VF-L04", material(weldable=False), "E"),
    ("VF-C02", of((2, 300.0, 331.0)), "E 0 0.0"),
    ("VF-C07", of((2, 200.0, 60.0), pouch=Pouch(shape="round", radius_mm=11.9)), "E 0.0"),
    ("VF-W01", rectangle(4.9), "E 0.0"),
    ("VF-C07", rectangle(4.9), "E 0.0"),
    ("VF-W01", rectangle(23.9), ""),
    ("VF-C07", rectangle(23.9), "E 0.0"),
    ("VF-C07", rectangle(24.1), ""),
    ("VF-B02", clamped(), ""),
    ("VF-B02", clamped(length_mm=180.0, flare_mm=40.0), "E 0"),
    ("VF-B02", clamped(flare_mm=10.0), "E 0"),
]
"""Rule, fixture, and the findings asked for: their severity and the branches of the first."""


def found(subject, rule):
    report = run_checks(subject, only=(rule,))
    assert rule in {run.rule for run in report.run}
    return report.findings


def test_every_rule_has_fixtures_that_fire_and_some_that_do_not():
    for fires in (True, False):
        assert {rule for rule, _, asked in FIXTURES if bool(asked) == fires} == set(RULES)


@pytest.mark.parametrize(("rule", "build", "asked"), FIXTURES)
def test_rules_fire_beyond_their_limits_and_nowhere_else(rule, build, asked):
    subject = build()
    findings = found(subject, rule)
    assert {str(finding.severity)[0].upper() for finding in findings} == set(asked[:1])
    if asked:
        assert findings[0].branches == tuple(asked.split()[1:])
        assert ": " in findings[0].message, "it must say what helps"
        sentences = {problem.message for problem in subject.outline.problems}
        assert findings[0].message[-1] not in ".:" or findings[0].message in sentences
        assert findings[0].title != RULES[rule].title


def test_laps_of_a_recipe_that_knows_no_bond_are_not_passed_over(profile):
    subject = cut(2)()
    assert subject.profile is not None
    unbonded = replace(profile, recipe=profile.recipe.changed(lap=None))
    for known, words in ((unbonded, "no table [lap]"), (None, "needs a recipe")):
        skipped = run_checks(replace(subject, profile=known)).skipped
        assert any(words in skip.reason for skip in skipped if skip.rule == "VF-J03")


def test_film_with_laps_that_add_nothing_packs_as_without(random_design):
    """Branch by branch what VF-W03 says."""
    for seed in range(20):
        design = random_design(np.random.default_rng(seed), pouched=True)
        levels = design.tree.level.tolist()
        none = {"width_mm": 0.0, "rise_mm": 0.0}
        flat = [replace(sleeve_at(branch), **none) for branch in range(1, len(levels))]
        shares = lap_occupancies(design, flat, 0.075)
        expected = occupancies(design, 0.075)
        assert shares == {
            branch: pytest.approx(expected[branch])
            for branch, level in enumerate(levels)
            if level < design.depth
        }


def test_laps_count_where_they_are_and_below_one_parent_only(make):
    """Two children with two leaves each: a lap on one leaf is no matter of the other child."""
    design = make((2, 200.0, 90.0), (2, 90.0, 60.0), widths_mm=(40.0, 24.0, 14.0))
    ids = design.tree.ids
    sleeve = replace(sleeve_at(ids.index("0.1.0")), width_mm=14.0)
    shares = lap_occupancies(design, [sleeve], 0.075)
    assert {ids[branch] for branch in shares} == {"0", "0.1"}
    level_3_mm = 3 * 14.0 + 2 * 15.0
    assert shares[ids.index("0")] == pytest.approx(level_3_mm * 0.75 * math.pi / 40.0**2)
    assert shares[ids.index("0.1")] == pytest.approx(44.0 * 0.75 * math.pi / 24.0**2)


def test_a_notch_in_a_wall_of_a_map_is_no_corridor(make, profile):
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


def test_taper_is_no_fault_of_the_width_as_built(make, profile):
    tapered = make((3, 200.0, 120.0), taper=(0.9, 0.6))
    for rule in ("VF-W04", "VF-P05"):
        assert found(Subject.of(tapered, profile), rule) == ()
    even = replace(Subject.of(make((3, 200.0, 120.0)), profile), job=laser_job(tapered, profile))
    assert {f.branches[0] for f in found(even, "VF-W04")} == {"0", "0.0", "0.1", "0.2"}


def test_turns_at_contacts_count_when_a_deployment_is_given(make):
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


@pytest.mark.parametrize(
    ("build", "rule", "note"),
    [
        (of(trunk_mm=1000.0), "VF-S01", "3 tiles"),
        (of(trunk_mm=300.0), "VF-S01", ""),
        (of((2, 200.0, 60.0), (1, 60.0, 40.0)), "VF-C02", "level 3 has one child"),
        (of((2, 200.0, 60.0), (1, 60.0, 0.0)), "VF-C02", ""),
    ],
)
def test_what_happens_to_a_design_without_being_wrong_is_noted(build, rule, note):
    (run,) = run_checks(build(), only=(rule,)).run
    assert note in run.note
    assert bool(run.note) == bool(note)


CAPPED_MM = (35.5 * math.sin(math.radians(20.0)) - 12.0) / (1.0 - math.sin(math.radians(20.0)))
SLIM = {"widths_mm": (24.0, 8.0), "fillet_mm": (2.0,)}
MEASURED = [
    (
        "VF-J03",
        cut(0, widths_mm=(20.0, 12.0), pressure_kpa=42.0),
        [(E, 42.0 * 20.0 / 2000.0 / math.pi, 0.2 / 1.5)],
    ),
    # 40, 24 mm lay-flat: 25.46 and 15.28 mm inflated
    ("VF-R03", course(15.0, 20.0), [(W, 15.0, 80.0 / math.pi), (W, 15.0, 48.0 / math.pi)]),
    # A dead end of 20 mm: its area is between those of the cross-sections.
    ("VF-R03", course(2.0, dead_end_mm=20.0), [(W, 2.0, 48.0 / math.pi)]),
    # 40 degrees: the fillet ends at half of the child, 35.5 mm from the joint.
    (
        "VF-C04",
        of((2, 71.0, 40.0), fillet_mm=(6.0,)),
        [(E, CAPPED_MM, 1.0), (INFO, CAPPED_MM, 6.0)],
    ),
    ("VF-W01", of((2, 200.0, 60.0), widths_mm=(30.0, 16.0), taper=(1.0, 0.3)), [(E, 4.8, 5.0)]),
    ("VF-W02", of((2, 200.0, 60.0), widths_mm=(30.0, 16.0), taper=(0.6, 1.0)), [(E, 1.125, 1.2)]),
    # A pouch 60 mm wide; a trunk as wide at 50 kPa: 15.56 kPa
    ("VF-P01", pouch(30.0), [(W, 20.0, 70.0 * 20.0 / 60.0 / 1.5)]),
    ("VF-P01", of(widths_mm=(60.0,), pressure_kpa=50.0), [(W, 50.0, 70.0 * 20.0 / 60.0 / 1.5)]),
    # weldcut at 60 mm/s: a fillet of 2 mm less the beam's offset asks for 2.5 m/s^2, of 3 allowed
    ("VF-L05", of((2, 200.0, 60.0), **SLIM), []),
    ("VF-L05", hurried(70.0, (2, 200.0, 60.0), **SLIM), [(W, 70.0, math.sqrt(3000.0 * 1.45))]),
    ("VF-L05", speed(501.0), [(W, 501.0, 500.0)]),
    # The window is closed, and the working pressure is too low as well.
    (
        "VF-P03",
        of((2, 200.0, 60.0), widths_mm=(100.0, 11.75), pressure_kpa=2.0),
        [(W, 7.805, 7.778), (W, 7.805, 2.0)],
    ),
]
"""Rule, fixture, and severity, value and limit of each of its findings."""


@pytest.mark.parametrize(("rule", "build", "asked"), MEASURED)
def test_findings_say_what_was_measured(rule, build, asked):
    findings = found(build(), rule)
    assert [one.severity for one in findings] == [severity for severity, *_ in asked]
    for finding, (_, measured_value, limit) in zip(findings, asked, strict=True):
        assert (finding.measured, finding.limit) == pytest.approx((measured_value, limit), rel=1e-3)
    # A waiver of a note waives no error of the same rule.
    assert len({finding.fingerprint for finding in findings}) == len(findings)
