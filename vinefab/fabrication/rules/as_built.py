"""Rules about what is made: widths and seams in the paths, files read back, rigs and corridors."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import shapely

from vinefab.core.plain_text import counted
from vinefab.fabrication.job.passes import bodies_of_paths, closes
from vinefab.fabrication.rules.rule import (
    Limits,
    RigFacts,
    RigSubject,
    RuleApplied,
    Scope,
    Subject,
    Violation,
    branch_point_mm,
    design_rule,
    made,
    mark_branches,
    needed,
)
from vinefab.model.finding import Severity
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour, Part
from vinefab.outline.joint import Point, taper_rad
from vinefab.physics.growth_pressure import planned_paths
from vinefab.physics.tube import inflated_diameter_mm


def _excess_widths_mm(
    subject: Subject, runs: Sequence[LaserPath], offset_mm: float
) -> dict[int, float]:
    """Return by how much branches are drawn wider than designed, where both sides are straight.

    A branch that lost a side to its neighbour's crotch is left out: VF-C03 reports it.

    Parameters
    ----------
    runs
        The paths that together seal one body, in order.
    """
    layout, rows = subject.layout, {name: row for row, name in enumerate(subject.names)}
    sides: dict[tuple[int, bool], tuple[float, float]] = {}
    contours = [path.contour for path in runs]
    back = _back_to_flat(subject, contours)
    collar, from_mm = subject.design.build.collar, -math.inf
    if collar is not None:  # its sides are as wide as its clamp
        from_mm = collar.reach_mm - 1e-3 - layout.tail_mm
    for segment in (one for run in contours for one in run.moved(*back).segments):
        is_tail, starts_mm = segment.part is Part.TAIL, (segment.start_mm[0], segment.end_mm[0])
        if segment.bulge or not segment.branch or not (is_tail or segment.part is Part.SIDE):
            continue
        if is_tail and min(starts_mm) <= from_mm:
            continue
        row = rows[segment.branch]
        # How far outside the design the segment lies at most, and on which side of its branch.
        along = np.array([math.cos(layout.heading_rad[row]), math.sin(layout.heading_rad[row])])
        ends = np.array([segment.start_mm, segment.end_mm]) - layout.start_mm[row]
        across = ends @ np.array([-along[1], along[0]])
        half, end_half = layout.width_mm[row] / 2.0, layout.end_width_mm[row] / 2.0
        lean_rad = taper_rad(half, end_half, float(layout.tree.length_mm[row]))
        designed = half + offset_mm - np.maximum(ends @ along, 0.0) * math.sin(lean_rad)
        designed /= math.cos(lean_rad)
        if is_tail:
            designed = np.full(2, half + offset_mm)
        excess = np.abs(across) - designed
        left, beyond = bool(across.mean() > 0.0), float(excess[np.abs(excess).argmax()])
        length = segment.length_mm
        if length > sides.get((row, left), (0.0, 0.0))[0]:
            sides[row, left] = length, beyond
    both = sorted(row for row, left in sides if left and (row, False) in sides)
    return {row: sides[row, True][1] + sides[row, False][1] for row in both}


def _back_to_flat(subject: Subject, runs: Sequence[Contour]) -> tuple[float, float, float]:
    """Return the turn (rad) and then the shift (mm) from the sheet to the flat layout.

    The first and the last point of the runs are the mouth: of the tail, or of a piece's base.
    """
    layout, root = subject.layout, subject.piece.root if subject.piece else 0
    (x, y), heading = (-layout.tail_mm, 0.0), 0.0
    if root and subject.partition is not None:
        along_mm = subject.partition.sleeve(root).outer_from_mm
        (x, y), heading = layout.start_mm[root].tolist(), float(layout.heading_rad[root])
        x, y = x + along_mm * math.cos(heading), y + along_mm * math.sin(heading)
    first, last = runs[0].points_mm[0], runs[-1].points_mm[-1]
    turn = heading - math.atan2(*(last - first)[::-1]) + math.pi / 2
    ends = Contour.polyline(np.array([first, last]), closed=False).moved(turn, 0.0, 0.0)
    low_x, low_y = ((ends.points_mm[0] + ends.points_mm[-1]) / 2.0).tolist()
    return turn, x - low_x, y - low_y


def flat_place_mm(subject: Subject, path: LaserPath, at_mm: Point) -> Point | None:
    """Return a place on the sheet in the flat layout; None on a path of another design."""
    own = subject.own(Operation.WELDCUT) or subject.own(Operation.WELD)
    if not own or path.of != own[0].of or not path.of:
        return None
    bodies = [[run.contour for run in runs] for runs in bodies_of_paths(own)]
    spot = shapely.Point(at_mm)
    near = min(bodies, key=lambda runs: spot.distance(shapely.multipoints(runs[0].points_mm)))
    point = Contour.polyline(np.array([at_mm, at_mm]), closed=False)
    x, y = point.moved(*_back_to_flat(subject, near)).points_mm[0].tolist()
    return x, y


def _owner(path: LaserPath, paths: tuple[LaserPath, ...]) -> str:
    """Return " of ..." with a path's label, or nothing where it is the only one."""
    return f" of {path.label!r}" if len(paths) > 1 else ""


@design_rule(
    "VF-W04",
    broken="branches do not come out as wide as designed",
    unit="mm",
    error=0.1,
    on={Scope.PATHS, Scope.PIECES},
    reason="a forgotten seam and kerf offset narrows an 8 mm branch by 6 to 12 % (computed)",
    remedy="use the recipe's seam and kerf, and leave the machine's own kerf at 0",
)
def check_built_width(subject: Subject, limits: Limits) -> RuleApplied:
    """Branches come out as wide as designed.

    Both sides, less seam and kerf, leave the designed lumen between them.
    """
    job, profile = made(subject, "needs a recipe, for seam and kerf")
    operation = Operation.WELDCUT if job.along(Operation.WELDCUT) else Operation.WELD
    beam = profile.settings(operation)
    # How far outside the lumen the beam runs: s + k/2 in one pass, s/2 to weld alone. Not
    # `weldcut_offset_mm` that the paths were drawn with: the rule must notice if that is wrong.
    offset_mm = beam.seam_width_mm.value / 2.0
    if operation is Operation.WELDCUT:
        offset_mm = beam.seam_width_mm.value + beam.kerf_mm.value / 2.0
    paths = subject.own(operation)
    checked, worst = 0, dict[int, tuple[float, str]]()
    for runs in bodies_of_paths(paths):
        for row, excess_mm in _excess_widths_mm(subject, runs, offset_mm).items():
            checked += 1
            if abs(excess_mm) > abs(worst.get(row, (0.0, ""))[0]):
                worst[row] = excess_mm, _owner(runs[0], paths)
    violations = []
    for row, (excess_mm, of) in sorted(worst.items()):
        if broken := limits.most(abs(excess_mm)):
            layout = subject.layout
            built_mm = float(layout.width_mm[row] + layout.end_width_mm[row]) / 2.0 + excess_mm
            message = (
                f"the branch{of} comes out {built_mm:.2f} mm wide in the paths: its joint took "
                "its sides, or their seam and kerf are not the recipe's"
            )
            violations.append(broken.on(subject, [row], message))
    shrinkage = profile.material.shrinkage_percent
    if share := shrinkage.value / 100.0:  # the paths are drawn as designed
        widest_mm = float(subject.layout.width_mm.max())
        longest_mm = max(path.length_mm for path in planned_paths(subject.layout.tree))
        message = (
            f"film shrinks by {shrinkage.value:.2g} % where it is welded ({shrinkage.standing}), "
            f"which the paths leave out: {longest_mm:.0f} mm to the farthest tip come out as "
            f"{longest_mm * (1.0 - share):.0f}, a width of {widest_mm:g} mm as "
            f"{widest_mm * (1.0 - share):.1f} if it shrinks alike across"
        )
        lost_mm = abs(share) * widest_mm
        found = Violation(message=message, measured=lost_mm, aspect="shrinkage")
        if broken := limits.most(lost_mm):
            found = replace(found, severity=Severity.WARNING, limit=broken.limit)
        else:
            found = replace(found, severity=Severity.INFO)
        violations.append(found)
    return RuleApplied(checked=checked, violations=tuple(violations))


@design_rule(
    "VF-X01",
    broken="a file read back differs from the job",
    on={Scope.SHEET},
    reason="programs read files, not intentions",
    remedy="report it: a file that differs from its model is a fault of vinefab or of a disk",
)
def check_readback(subject: Subject, _: Limits) -> RuleApplied:
    """Files read back equal the job."""
    files = needed(subject.readback, "no file was written and read back")
    violations = [
        Violation(message=f"{name}: {problem}; write the package again", aspect=name)
        for name, problems in files.items()
        for problem in problems
    ]
    return RuleApplied(checked=len(files), violations=tuple(violations))


@design_rule(
    "VF-P05",
    broken="a seam or overcut is narrower than the recipe's",
    unit="mm",
    slack=0.005,
    on={Scope.PATHS, Scope.PIECES},
    reason="a narrower seam was never tested, and a mouth that is not cut through tears it open; "
    "a laser's steps round the slack away (assumed)",
    remedy="use the recipe's seam width and overcut, or test the narrower seam with coupons",
)
def check_seams(subject: Subject, limits: Limits) -> RuleApplied:
    """Seams and overcuts are as wide as the recipe's."""
    _, profile = made(subject, "needs a recipe, for seam and overcut")
    slack_mm = limits["slack"]
    seams_mm = _seams_mm(subject, profile)
    overcuts_mm, cuts = list(_overcuts_mm(subject)), subject.own(Operation.CUT)
    # By how much each closed cut runs past its start.
    laps_mm = [
        (math.dist(*path.contour.points_mm[[0, -1]]), _owner(path, cuts))
        for path in cuts
        if closes(path.contour) and not path.contour.closed
    ]
    violations = []
    if seams_mm:  # one violation by all branches whose seam is too narrow, at the narrowest
        seam_mm = profile.settings(Operation.WELDCUT).seam_width_mm.value
        low = {name: seam for name, seam in seams_mm.items() if seam[0] < seam_mm - slack_mm}
        if low:
            worst = min(low, key=lambda name: round(low[name][0], 6))  # the first of those alike
            least, of = low[worst]
            violations.append(
                Violation(
                    message=f"the paths of {counted(len(low), 'branch')} leave less seam than the "
                    f"recipe makes{f', least on the sides{of}' if of else ''}, and no burst test "
                    "covers it: draw them with the recipe's seam",
                    severity=Severity.WARNING,
                    measured=least,
                    limit=seam_mm,
                    branches=(worst,),
                    at_mm=branch_point_mm(subject.layout, subject.names.index(worst), 0.5),
                    marker=mark_branches(subject.layout, map(subject.names.index, low)),
                    aspect="seam",
                )
            )
    least_mm = profile.settings(Operation.CUT).overcut_mm.value
    ways = (
        (
            overcuts_mm,
            "at the mouth",
            "cross the outline",
            "the part stays attached at its corners",
        ),
        (laps_mm, "around the robot", "pass its start", "a bridge may be left there"),
    )
    for found, where, fails, so in ways:
        overcut_mm, of = min(found, default=(math.inf, ""))
        if overcut_mm < least_mm - slack_mm:
            violations.append(
                Violation(
                    message=f"the cut {where}{of} does not {fails} by the recipe's overcut, "
                    f"and {so}: draw it with that overcut",
                    severity=Severity.WARNING,
                    measured=overcut_mm,
                    limit=least_mm,
                    branches=subject.ids(0),
                    at_mm=(-subject.design.build.tail_mm, 0.0),
                    aspect="overcut",
                )
            )
    checked = len(seams_mm) + len(overcuts_mm) + len(laps_mm)
    return RuleApplied(checked=checked, violations=tuple(violations))


def _seams_mm(subject: Subject, profile: LaserProfile) -> dict[str, tuple[float, str]]:
    """Return the seam between lumen and kerf of each branch with two sides, and its owner.

    Of several copies of a robot, the narrowest seam counts.
    """
    found: dict[str, tuple[float, str]] = {}
    paths = subject.own(Operation.WELDCUT)
    for runs in bodies_of_paths(paths):
        half_kerf_mm = profile.settings(Operation.WELDCUT).kerf_mm.value / 2.0
        for row, wider_mm in _excess_widths_mm(subject, runs, 0.0).items():
            seam_mm = wider_mm / 2.0 - half_kerf_mm
            name = subject.names[row]
            if seam_mm < found.get(name, (math.inf, ""))[0]:
                found[name] = seam_mm, _owner(runs[0], paths)
    return found


def _overcuts_mm(subject: Subject, near_mm: float = 0.05) -> Iterator[tuple[float, str]]:
    """Yield by how much a cut at a mouth runs past each end of an outline on it, and its owner.

    An end that is as near to the cut lies on it.
    """
    ends = [
        path.contour.points_mm[row]
        for path in subject.own(Operation.WELDCUT)
        if not path.contour.closed
        for row in (0, -1)
    ]
    cuts = subject.own(Operation.CUT)
    for path in cuts:
        for segment in path.contour.segments:
            if segment.part is not Part.MOUTH or segment.bulge:
                continue
            start = np.array(segment.start_mm)
            along = (np.array(segment.end_mm) - start) / segment.length_mm
            for end in ends:
                x, y = end - start
                across_mm = abs(along[0] * y - along[1] * x)
                at_mm = float(along[0] * x + along[1] * y)
                past_mm = min(at_mm, segment.length_mm - at_mm)
                if across_mm < near_mm and past_mm > -near_mm:
                    yield past_mm, _owner(path, cuts)


def _rig(subject: RigSubject) -> RigFacts:
    return needed(subject.rig, "needs a test rig: vinefab rig makes one, --rig names one")


@design_rule(
    "VF-R01",
    broken="a rig part is not a closed solid of the right volume",
    on={Scope.RIG},
    reason="slicers guess what an open mesh means",
    remedy="make the rig anew; report it if the part still is not closed",
)
def check_solids(subject: RigSubject, _: Limits) -> RuleApplied:
    """Every rig part is a closed solid of the right volume."""
    rig = _rig(subject)
    violations = [
        Violation(message=f"{part.name} {problem}: make the rig anew", aspect=part.name)
        for part in rig.parts
        for problem in part.problems
    ]
    return RuleApplied(checked=len(rig.parts), violations=tuple(violations))


@design_rule(
    "VF-R02",
    broken="a rig part is too large for the machine",
    unit="mm",
    on={Scope.RIG},
    reason="a part that does not fit cannot be printed",
    remedy="another printer, a smaller scale, or lower obstacles",
)
def check_fits(subject: RigSubject, _: Limits) -> RuleApplied:
    """Every rig part fits the machine.

    The margin of its bed is kept.
    """
    rig, violations = _rig(subject), []
    for part in rig.parts:
        axes = zip(part.size_mm, rig.room_mm, ("wide", "deep", "high"), strict=True)
        size_mm, most_mm, axis = max(axes, key=lambda axis: axis[0] - axis[1])
        if size_mm > most_mm + 1e-3:  # files hold sizes in single precision
            message = f"{part.name} is too {axis} for {rig.printer}: split or scale the rig"
            violations.append(
                Violation(message=message, measured=size_mm, limit=most_mm, aspect=part.name)
            )
    return RuleApplied(checked=len(rig.parts), violations=tuple(violations))


@design_rule(
    "VF-R03",
    broken="corridors are too narrow for inflated branches",
    unit="mm",
    limits_in="times the inflated diameter",
    warning=1.0,
    on={Scope.RIG},
    reason="an inflated body does not pass a narrower gap. A dead "
    "end with less free area than the body's cross-section is a notch in a wall and no corridor, "
    "unless a start is in it",
    remedy="narrower tubes, a larger scale, or another map",
)
def check_corridors(subject: RigSubject, limits: Limits) -> RuleApplied:
    """Corridors let every inflated branch through."""
    why = "to compare corridors with the robot"
    design = needed(subject.design, f"needs a design (--design), {why}")
    corridors = needed(subject.corridors or None, f"needs a map or a rig (--map), {why}")
    violations = []
    for place, tubes in product(corridors, design.tubes):
        words, diameter_mm = design.words(tubes.rows), inflated_diameter_mm(tubes.width_mm)
        one = len(tubes.rows) == 1 or design.branches is None
        inflate = "inflates" if one else "inflate"
        # A dead end with less free area than the branch's cross-section is a notch.
        usable = [one for one in place.corridors if one.dead_end_mm >= diameter_mm]
        narrow = [one for one in usable if limits.least(one.width_mm / diameter_mm)]
        least = min(narrow, key=lambda one: one.width_mm, default=None)
        broken = limits.least(least.width_mm / diameter_mm) if least else None
        if least is None or broken is None:
            continue
        every = "all" if len(narrow) == len(usable) else f"{len(narrow)}"
        violations.append(
            replace(
                broken,
                measured=least.width_mm,
                limit=broken.limit * diameter_mm,
                message=f"{words} {inflate} to {diameter_mm:.1f} mm: {every} of the "
                f"{len(usable)} narrowest corridors of {place.name} are narrower, the least at "
                f"({least.x_mm:.1f}, {least.y_mm:.1f}) mm: narrow the tubes, or scale up the map",
                aspect=f"{place.name} {words}",
            )
        )
    return RuleApplied(
        checked=sum(len(place.corridors) for place in corridors),
        violations=tuple(violations),
    )


@design_rule(
    "VF-R04",
    broken="obstacles are too low: the inflated trunk climbs over them",
    unit="mm",
    limits_in="times the inflated diameter of the trunk",
    warning=1.2,
    on={Scope.RIG},
    reason="a tube climbs over an obstacle that is lower; 1.2 diameters are assumed",
    remedy="higher obstacles, or a narrower trunk",
)
def check_height(subject: RigSubject, limits: Limits) -> RuleApplied:
    """Obstacles are higher than the inflated trunk climbs."""
    why = "to compare heights with the trunk"
    rig = needed(subject.rig, f"needs a test rig (--rig), {why}")
    design = needed(subject.design, f"needs a design (--design), {why}")
    diameter_mm = inflated_diameter_mm(design.build.widths_mm[0])
    broken = limits.least(rig.height_mm / diameter_mm)
    message = f"a trunk that inflates to {diameter_mm:.1f} mm climbs over them: make them higher "
    message += "(--height-mm)"
    return RuleApplied.of_one(
        broken
        and replace(
            broken,
            message=message,
            measured=rig.height_mm,
            limit=broken.limit * diameter_mm,
        )
    )
