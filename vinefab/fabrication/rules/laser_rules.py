"""Rules about the laser's paths and their beams, the recipe, the film and the bed."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats, Ints
from vinefab.fabrication.job.passes import GUIDE, bodies_of_paths, closes, frees, sealed_by_hand
from vinefab.fabrication.job.placement import box_around_mm, fact_rows
from vinefab.fabrication.job.tiling import LEAST_PINS, PIN_HOLE
from vinefab.fabrication.processes import WORDS
from vinefab.fabrication.rules.as_built import flat_place_mm
from vinefab.fabrication.rules.rule import (
    Limits,
    MissingInputError,
    RuleApplied,
    Scope,
    Subject,
    Violation,
    design_rule,
    made,
    mark_point,
    needed,
    outline_violations,
)
from vinefab.fabrication.rules.spacing import closest
from vinefab.model.finding import Severity
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, RecipeStatus
from vinefab.model.machine import HeadMachine, Machine, Tool
from vinefab.model.outline import Part
from vinefab.outline.body_outline import ProblemKind
from vinefab.outline.joint import LEAST_ARC_RADIUS_MM, LEAST_CUT_MM


@dataclass(frozen=True, slots=True, kw_only=True)
class BandOverlap:
    """Two bands that overlap."""

    one: LaserPath
    two: LaserPath  # the same path where it meets itself
    branches: tuple[str, ...]  # ids of the branches that the two places belong to
    left_mm: float  # film left between the bands, negative
    at_mm: tuple[float, float]  # middle of the closest points, on the sheet


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """All paths as short straight pieces, k of them."""

    start_mm: Floats  # shape (k, 2)
    end_mm: Floats
    path: Ints  # number of its path
    way_mm: Floats  # from the path's start to the piece's
    half_mm: Floats  # half the width of its band
    is_mouth: NDArray[np.bool_]
    branch: NDArray[np.str_]  # id of its branch, or empty

    @classmethod
    def of(cls, paths: Sequence[LaserPath], profile: LaserProfile) -> "_Pieces":
        rows = [
            (number, segment, path.settings_in(profile), points)
            for number, path in enumerate(paths)
            for segment in path.contour.segments
            for points in [segment.flattened_mm(0.002)]
        ]
        count = [len(points) - 1 for *_, points in rows]
        start = np.concatenate([points[:-1] for *_, points in rows])
        end = np.concatenate([points[1:] for *_, points in rows])
        path = np.repeat([number for number, *_ in rows], count)
        length = np.hypot(*(end - start).T)
        before = np.cumsum(length) - length
        first = np.searchsorted(path, np.arange(len(paths)))
        half = [
            (beam.seam_width_mm if paths[number].operation is Operation.WELD else beam.kerf_mm)
            for number, _, beam, _ in rows
        ]
        return cls(
            start_mm=start,
            end_mm=end,
            path=path,
            way_mm=before - before[first][path],
            half_mm=np.repeat([width.value / 2.0 for width in half], count),
            is_mouth=np.repeat([segment.part is Part.MOUTH for _, segment, *_ in rows], count),
            branch=np.repeat([segment.branch for _, segment, *_ in rows], count),
        )


def meetings(paths: Sequence[LaserPath], profile: LaserProfile) -> Iterator[BandOverlap]:
    """Yield where bands overlap: the tightest place of every two branches and two paths.

    A band is what the beam takes to both sides of its path: half the kerf of a cut, half the seam
    of a weld. The seam of a weld-cut lies inward of its kerf. A path's neighbouring places are left
    out, and so are a mouth's cut and the ends of the seam that it crosses.
    """
    if not paths:
        return
    pieces = _Pieces.of(paths, profile)
    ends_mm = np.stack([pieces.start_mm, pieces.end_mm], axis=1)
    lines = np.asarray(shapely.linestrings(ends_mm))
    reach = 2.0 * float(pieces.half_mm.max())
    one, two = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=reach)
    one, two = (rows[one < two] for rows in (one, two))
    near = closest(
        *(ends[rows] for rows in (one, two) for ends in (pieces.start_mm, pieces.end_mm))
    )
    asked = pieces.half_mm[one] + pieces.half_mm[two]
    left = near.distance_mm - asked
    steps = [
        along[:, None] * (pieces.end_mm - pieces.start_mm)[rows]
        for rows, along in ((one, near.along_a), (two, near.along_b))
    ]
    places = [pieces.start_mm[rows] + step for rows, step in zip((one, two), steps, strict=True)]
    way_one, way_two = (
        pieces.way_mm[rows] + np.hypot(*step.T)
        for rows, step in zip((one, two), steps, strict=True)
    )
    same = pieces.path[one] == pieces.path[two]
    apart = np.abs(way_one - way_two)
    around = []  # once around each path; infinite for one that does not close
    for path in paths:
        ends_mm = path.contour.points_mm[[0, -1]]
        past_mm = 0.0 if path.contour.closed else math.dist(*ends_mm)
        around.append(path.contour.length_mm - past_mm if closes(path.contour) else math.inf)
    apart = np.minimum(apart, np.abs(np.array(around)[pieces.path[one]] - apart))
    # Places of one path are neighbours if the way between them is at most so many times what is
    # asked for: of a corner of 15 degrees, the least allowed, it is 7.7 times.
    beside = same & (apart <= 10.0 * asked)
    # A cut across a mouth crosses the ends of the seam by design, so near to them.
    ends = _near_own_end(paths, pieces, (one, two), places, 2.0 * asked + 0.5)
    seen = set[tuple[int, int, tuple[str, ...]]]()
    rows = np.flatnonzero((left < 0.0) & ~beside & ~ends)
    for row in rows[np.argsort(left[rows], kind="stable")].tolist():
        low, high = sorted((int(pieces.path[one[row]]), int(pieces.path[two[row]])))
        names = tuple(sorted({str(pieces.branch[side[row]]) for side in (one, two)} - {""}))
        if (low, high, names) in seen:
            continue
        seen.add((low, high, names))
        x, y = ((places[0][row] + places[1][row]) / 2.0).tolist()
        yield BandOverlap(
            one=paths[low],
            two=paths[high],
            branches=names,
            left_mm=float(left[row]),
            at_mm=(x, y),
        )


def _near_own_end(
    paths: Sequence[LaserPath],
    pieces: _Pieces,
    pair: tuple[Ints, Ints],
    places_mm: Sequence[Floats],
    within_mm: Floats,
) -> NDArray[np.bool_]:
    """Return where a mouth's cut meets a path of its body within some distance of its ends."""
    found = np.zeros(len(within_mm), dtype=np.bool_)
    of = np.array([path.of for path in paths])
    ends = np.array([path.contour.points_mm[[0, -1]] for path in paths])
    along = pieces.end_mm - pieces.start_mm
    (x0, y0), (x1, y1) = (along[side].T for side in pair)
    across = np.abs(x0 * y1 - y0 * x1) > 0.5 * np.hypot(x0, y0) * np.hypot(x1, y1)
    both = pieces.is_mouth[pair[0]] & pieces.is_mouth[pair[1]]
    own = of[pieces.path[pair[0]]] == of[pieces.path[pair[1]]]
    for mouth, other, place in ((0, 1, places_mm[1]), (1, 0, places_mm[0])):
        path = pieces.path[pair[other]]
        to_end = np.linalg.norm(ends[path] - place[:, None], axis=2).min(axis=1)
        # Paths of no robot may end across a seam: the sides of a peel strip do.
        found |= own & (of[path] == "") & (to_end <= within_mm) & across
        found |= own & pieces.is_mouth[pair[mouth]] & (to_end <= within_mm) & ~both
    return found


@design_rule(
    "VF-L01",
    broken="a mark is missing or too near the body",
    unit="mm",
    error=3.0,
    on={Scope.SHEET, Scope.PATHS},
    reason="a mark weakens film under pressure; an unlabelled robot cannot be identified",
    remedy="more room around the robot for its label",
)
def check_marks(subject: Subject, limits: Limits) -> RuleApplied:
    """Every mark is made, clear of the body.

    Marks that were left out are reported.
    """
    job, profile = made(subject)
    marks = [path for path in job.along(Operation.MARK) if not _is_guide(path)]
    sealed = (*job.along(Operation.WELD), *job.along(Operation.WELDCUT))
    bodies = [_Body(runs) for runs in bodies_of_paths(sealed)] if marks else []
    lines = [mark.contour.flattened_mm() for mark in marks]
    shapes = np.array([_line(mark) for mark in marks], dtype=object)
    apart_mm = [body.apart_mm(lines, shapes) for body in bodies]
    nearest_mm = np.min(apart_mm, axis=0) if apart_mm else np.full(len(marks), math.inf)
    violations: dict[str, Violation] = {}
    for mark, away_mm in zip(marks, nearest_mm.tolist(), strict=True):
        broken = limits.least(away_mm)
        # The strokes of one label share its name: the nearest of them stands for all.
        if broken and (
            mark.label not in violations or away_mm < (violations[mark.label].measured or 0.0)
        ):
            message = f"{mark.label} weakens the body's rim: leave more room next to the robot"
            violations[mark.label] = replace(broken, message=message, aspect=mark.label)
    can_mark = Operation.MARK in profile.recipe.by_operation
    advice = Violation(severity=Severity.INFO)
    left_out = [
        replace(advice, message=f"{reason}: write it on the film by hand", aspect=reason)
        for reason in fact_rows(job, "marks_left_out")
    ]
    return RuleApplied(
        checked=len(marks),
        violations=(*violations.values(), *left_out, *_without_pins(job, profile)),
        note="" if can_mark else "the recipe has no mark: no fold line, no label",
    )


def _is_guide(path: LaserPath) -> bool:
    """Whether a mark lies where the cut will run, and goes with it."""
    return path.label.startswith(GUIDE)


def _without_pins(job: Job, profile: LaserProfile) -> Iterator[Violation]:
    """Yield a violation for every sheet that is sealed by hand and cannot be put back."""
    for number, sheet in enumerate(() if job.tiles else job.runs, start=1):
        pins = sum(path.label == PIN_HOLE for path in sheet.paths)
        put_back = sheet.along(Operation.WELD) and sealed_by_hand(profile, separate=True)
        if put_back and pins < LEAST_PINS:
            yield Violation(
                message=f"sheet {number} leaves the bed to be sealed, and no film is free for two "
                "pin holes next to the robot: shorten it, or use a larger bed",
                severity=Severity.WARNING,
                measured=float(pins),
                limit=float(LEAST_PINS),
                aspect=f"pins {number}",
                title="no pin holes to put the sheet back by",
            )


@design_rule(
    "VF-L02",
    broken="paths run into each other or are too small to run",
    unit="mm",
    segment_error=LEAST_CUT_MM,
    radius_error=LEAST_ARC_RADIUS_MM,
    apart_error=0.0,
    shared_error=0.2,
    on={Scope.SHEET, Scope.PATHS},
    reason="a kerf in a neighbour's seam opens it; tiny pieces stop the head and burn",
    remedy="branches farther apart; larger details: longer branches, larger fillets",
)
def check_paths(subject: Subject, limits: Limits) -> RuleApplied:
    """Paths keep apart and are large enough to run."""
    job, profile = made(subject)
    paths = [path for path in job.paths if path.operation.is_machined]
    violations: list[Violation] = []
    for path in paths:
        segments = list(path.contour.segments)
        short = min(segments, key=lambda segment: segment.length_mm)
        sharp = min(segments, key=lambda segment: segment.radius_mm)
        for name, what, segment, size_mm in (
            ("segment", "a line or arc", short, short.length_mm),
            ("radius", "the radius of an arc", sharp, sharp.radius_mm),
        ):
            if broken := limits.least(size_mm, name):
                violations.append(
                    replace(
                        broken,
                        message=f"{what} of {path.label!r} is too small to be run: lengthen "
                        "the branch, or enlarge its fillet",
                        branches=(segment.branch,) if segment.branch else (),
                        aspect=f"{name} {path.label}",
                    )
                )
    mouth = outline_violations(subject, ProblemKind.MOUTH)
    violations += mouth or _meetings(subject, profile, paths, limits)
    violations += _marked_twice(paths, limits)
    violations += outline_violations(subject, ProblemKind.SHORT_SEGMENT, known=tuple(violations))
    return RuleApplied(checked=len(paths), violations=tuple(violations))


def _meetings(
    subject: Subject,
    profile: LaserProfile,
    paths: Sequence[LaserPath],
    limits: Limits,
    most: int = 100,
) -> Iterator[Violation]:
    """Yield a violation for every two places at which a kerf reaches into a kerf or a seam.

    One more counts those beyond ``most``.
    """
    found = list(meetings([p for p in paths if p.operation is not Operation.MARK], profile))
    for meeting in found[:most]:
        if broken := limits.least(meeting.left_mm, "apart"):
            other = "itself" if meeting.one is meeting.two else f"{meeting.one.label!r}"
            point = WORDS[meeting.one.settings_in(profile).tool].point
            message = f"{point} reaches into {other} along {meeting.two.label!r}"
            at_mm = flat_place_mm(subject, meeting.one, meeting.at_mm)
            yield replace(
                broken,
                message=f"{message}: move the branches apart",
                branches=meeting.branches,
                at_mm=at_mm,
                marker=mark_point(at_mm) if at_mm else "",
                aspect=f"{meeting.one.operation} {meeting.two.operation}",
            )
    if len(found) > most:
        rest = f"{len(found) - most} more places at which paths run into each other"
        yield Violation(message=rest, severity=Severity.INFO, aspect="rest")


def _marked_twice(paths: Sequence[LaserPath], limits: Limits) -> Iterator[Violation]:
    """Yield a violation for every mark that another mark or a cut runs over."""
    marks = [path.operation is Operation.MARK for path in paths]
    lines = np.array([_line(path) for path in paths], dtype=object)
    first, second = shapely.STRtree(lines).query(lines, predicate="intersects")
    for one, two in zip(*(rows[first < second].tolist() for rows in (first, second)), strict=True):
        if not (marks[one] or marks[two]) or any(_is_guide(paths[row]) for row in (one, two)):
            continue
        shared_mm = float(shapely.length(shapely.intersection(lines[one], lines[two])))
        if broken := limits.most(shared_mm, "shared"):
            message = f"{paths[one].label!r} and {paths[two].label!r} burn one place: part them"
            yield replace(broken, message=message, aspect="shared")


@design_rule(
    "VF-L03",
    broken="paths run in the wrong order",
    on={Scope.SHEET, Scope.PATHS},
    reason="film that is cut free moves",
    remedy="let vinefab order the paths; do not reorder them by hand",
)
def check_order(subject: Subject, _: Limits) -> RuleApplied:
    """Paths run in order: weld before cut, inner before outer.

    Marks, welds, weld-cuts, cuts.
    """
    job, _recipe = made(subject)
    paths = [path for path in job.paths if path.operation.is_machined]
    order, violations = tuple(Operation), []
    for before, after in pairwise(paths):
        if order.index(before.operation) > order.index(after.operation):
            message = f"{after.operation} {after.label!r} comes after {before.operation}"
            message += f" {before.label!r}, when film has moved: keep the order of the files"
            violations.append(
                Violation(message=message, aspect=f"{before.operation} {after.operation}")
            )
    for place, before in enumerate(paths):
        around = before.contour.flattened_mm() if frees(before) else np.empty((0, 2))
        if len(around) < 3:
            continue
        area = shapely.Polygon(around)
        for after in paths[place + 1 :]:
            if before.operation is not after.operation:
                continue
            x, y = after.contour.flattened_mm().T
            if shapely.contains_xy(area, x, y).all():
                message = (
                    f"{before.label!r} frees the sheet before {after.label!r} inside it is cut: "
                    "cut what lies inside first"
                )
                violations.append(Violation(message=message, aspect="inner"))
    return RuleApplied(checked=len(paths), violations=tuple(violations))


class _Body:
    """A body that marks must keep clear of: the area enclosed by its outline, and the outline."""

    def __init__(self, runs: Sequence[LaserPath]) -> None:
        points = np.concatenate([path.contour.flattened_mm() for path in runs])
        # A single straight seam encloses nothing.
        self.area = shapely.Polygon(points if len(points) > 2 else None)
        # Line to line: making an area of an outline that crosses itself can take minutes.
        self.edge = shapely.LineString(np.concatenate([points, points[:1]]))
        shapely.prepare([self.area, self.edge])

    def apart_mm(self, lines_mm: Sequence[Floats], shapes: NDArray[np.object_]) -> Floats:
        """Return the distances of marks from the body, 0 for those that reach inside.

        Parameters
        ----------
        lines_mm, shapes
            The marks as points and as lines.
        """
        points = np.concatenate(lines_mm)
        inside = shapely.contains_xy(self.area, points[:, 0], points[:, 1])
        first = np.cumsum([0, *map(len, lines_mm[:-1])])
        reaches: NDArray[np.bool_] = np.logical_or.reduceat(inside, first)
        return np.where(reaches, 0.0, shapely.distance(self.edge, shapes))


def _line(path: LaserPath) -> shapely.LineString:
    points = path.contour.flattened_mm()
    closing = points[: 1 if path.contour.closed else 0]
    return shapely.LineString(np.concatenate([points, closing]))


@design_rule(
    "VF-L04",
    broken="the laser cannot weld the film",
    unit="mm",
    error=0.0475,
    on={Scope.SHEET},
    reason="0.0375 mm film welded and 0.05 mm film did not (paper); the limit between is assumed",
    remedy="another film, or a recipe that seals without a laser",
)
def check_ply(subject: Subject, limits: Limits) -> RuleApplied:
    """The laser can weld the film."""
    profile = needed(subject.profile, "needs a recipe")
    seals = profile.settings(profile.recipe.seals).tool
    if seals is not Tool.LASER:
        raise MissingInputError(f"{WORDS[seals].actor} makes the seams of this recipe")
    material = profile.material
    broken = limits.most(material.ply_mm.value)
    if material.weldable and not broken:
        return RuleApplied(checked=1)
    message = f"{material.title} does not weld with a laser: use a thinner film, or a recipe "
    message += "with a [sealer] (vinefab profiles)"
    return RuleApplied.of_one(
        Violation(message=message, measured=material.ply_mm.value, limit=limits["error"])
    )


@design_rule(
    "VF-L05",
    broken="the recipe is too fast for the machine",
    unit="mm/s",
    on={Scope.SHEET, Scope.PATHS},
    reason="a head that must slow down in an arc puts more energy there than the recipe says",
    remedy="a lower speed in the recipe, or larger radii",
)
def check_machine(subject: Subject, _: Limits) -> RuleApplied:
    """The machine reaches the recipe's speeds."""
    job, profile = made(subject, "needs a recipe")
    operations = profile.recipe.by_operation
    violations = []
    for operation, settings in operations.items():
        machine = profile.machine_of(settings.tool)
        if settings.head_speed is None or not isinstance(machine, HeadMachine):
            continue
        speed, top = settings.head_speed.value, machine.speed_max_mm_s.value
        if speed > top:
            message = f"{operation} is faster than the machine runs: set its speed to {top:g} mm/s"
            violations.append(_warning(message, f"speed {operation}", speed, top))
        # What frees a hole, or goes with the cut, may burn more than its recipe says.
        paths = [
            path
            for path in job.along(Operation(operation))
            if path.label != PIN_HOLE and not _is_guide(path)
        ]
        radius_mm = min(
            (s.radius_mm for path in paths for s in path.contour.segments), default=math.inf
        )
        if speed**2 / radius_mm > machine.acceleration_mm_s2.value:
            fit = math.sqrt(machine.acceleration_mm_s2.value * radius_mm)
            message = f"{operation} takes arcs of {radius_mm:.2f} mm too fast: the machine slows"
            message += f" there and {WORDS[settings.tool].slow}; run it at {fit:.0f} mm/s or less"
            violations.append(_warning(message, f"arcs {operation}", speed, fit))
    return RuleApplied(checked=len(operations), violations=tuple(violations))


@design_rule(
    "VF-L06",
    broken="recipe not calibrated",
    kerf_warning=1.0,
    on={Scope.SHEET},
    reason="no laser settings for this film were found in any source; only coupons tell. A kerf "
    "wider than the seam leaves little that holds (assumed)",
    remedy="cut the coupons of `vinefab coupon`, measure them, and run `vinefab calibrate`",
)
def check_status(subject: Subject, limits: Limits) -> RuleApplied:
    """Recipe calibrated.

    The coupons were cut on the user's machine, and the recipe runs energies that passed.
    """
    profile = needed(subject.profile, "needs a recipe")
    recipe = profile.recipe
    violations = []
    beams = {name: (run, machine) for name, run, machine in profile.beams}
    for window in recipe.coupons.windows:
        run, machine = beams.get(window.operation, (None, None))
        if run is None or machine is None or run.focus_offset_mm.value != window.focus_mm:
            continue
        energy = run.line_energy_mj_mm(machine)
        if not window.holds(energy):
            message = f"{window.operation} runs {energy:.1f} mJ/mm, but the coupons say: "
            one = _warning(f"{message}{window.words()}", f"energy {window.operation}")
            title = "settings differ from those that coupons confirmed"
            violations.append(replace(one, title=title))
    if stale := profile.stale_words:
        title = "settings were derived for another film"
        violations.append(replace(_warning(stale, "film"), title=title))
    if settings := recipe.by_operation.get(Operation.WELDCUT):
        kerf, seam = settings.kerf_mm, settings.seam_width_mm
        if broken := limits.most(kerf.value / seam.value if seam.value else math.inf, "kerf"):
            message = (
                f"weldcut removes {kerf.value:g} mm ({kerf.standing}) and fuses only "
                f"{seam.value:g} mm ({seam.standing}) next to it: measure both on coupons, or "
                "focus less"
            )
            title = "the kerf is wider than the seam"
            violations.append(replace(broken, message=message, aspect="kerf", title=title))
    if profile.status is RecipeStatus.UNVERIFIED:
        message = (
            f"no coupon has confirmed recipe {recipe.name}: cut the coupons of `vinefab coupon`, "
            "measure them, and run `vinefab calibrate`"
        )
        violations.insert(0, _warning(message, ""))
    return RuleApplied(checked=1 + len(recipe.coupons.windows), violations=tuple(violations))


def _warning(
    message: str, aspect: str, measured: float | None = None, limit: float | None = None
) -> Violation:
    return Violation(
        message=message, severity=Severity.WARNING, measured=measured, limit=limit, aspect=aspect
    )


@design_rule(
    "VF-S01",
    broken="the robot does not fit the bed",
    unit="mm",
    on={Scope.SHEET, Scope.PATHS},
    reason="what hangs over the bed is not cut; tiles need targets to be aligned by",
    remedy="shorten the robot, allow tiles or pieces, or use a machine with a larger bed",
)
def check_bed(subject: Subject, _: Limits) -> RuleApplied:
    """Everything fits the bed.

    Every machined path lies inside the bed's margins.
    """
    job, profile = made(subject, "needs a recipe, for the machine's bed")
    machine, facts = profile.machine, job.facts
    wanted, placed = facts.get("robots_wanted", 1), facts.get("robots_placed", 1)
    if wanted != placed:
        message = f"only {placed} of {wanted} robots find room on the bed: make fewer at once"
        return RuleApplied(checked=1, violations=(Violation(message=message, aspect="copies"),))
    if job.tiles:
        count = len(job.tiles)
        note = f"the robot is larger than the bed and cut in {counted(count, 'tile')}, one after "
        note += "the other: its film is moved and aligned between them"
        violations = []
        for number, tile in enumerate(job.tiles, start=1):
            over_mm = _over_mm(tile, machine)
            if over_mm > 0.0:
                message, aspect = f"tile {number} lies over the rim: allow pieces", f"tile {number}"
                violations.append(
                    Violation(message=message, measured=over_mm, limit=0.0, aspect=aspect)
                )
            if number > 1 and len(fact_rows(tile, "targets_found_mm")) < 2:
                message = f"tile {number} lacks two targets to align it by: allow pieces"
                violations.append(Violation(message=message, aspect=f"targets {number}"))
        return RuleApplied(checked=count, violations=tuple(violations), note=note)
    over_mm = max(_over_mm(sheet, machine) for sheet in job.runs)
    checked = sum(path.operation.is_machined for sheet in job.runs for path in sheet.paths)
    if over_mm <= 0.0:
        return RuleApplied(checked=checked, violations=tuple(_beside_cutter(job, profile)))
    wide_mm, high_mm = machine.usable_mm
    reason = facts.get("tiling")
    violation = Violation(
        message=f"the robot does not fit the {wide_mm:g} x {high_mm:g} mm of the bed in any "
        f"rotation tried{f' and cannot be cut in tiles: {reason}' if reason else ''}: shorten it, "
        "scale it down or use a larger machine",
        measured=over_mm,
        limit=0.0,
    )
    return RuleApplied(checked=checked, violations=(violation,))


def _beside_cutter(job: Job, profile: LaserProfile) -> Iterator[Violation]:
    """Yield a violation where a sheet that was sealed on one bed does not lie on the cutter's."""
    cutter = profile.cutter
    if cutter is None:
        return
    cuts = [
        replace(one, paths=tuple(p for p in one.paths if _cuts_on(p, cutter, profile)))
        for one in job.runs
    ]
    over_mm = max(_over_mm(one, cutter) for one in cuts)
    if over_mm > 0.0:
        message = f"what {cutter.name} cuts does not lie on its bed, corner on corner with that of "
        message += f"{profile.machine.name}: shorten the robot, or use a larger cutter"
        yield Violation(message=message, measured=over_mm, limit=0.0, aspect="cutter")


def _cuts_on(path: LaserPath, cutter: Machine, profile: LaserProfile) -> bool:
    return path.operation.is_machined and path.settings_in(profile).tool is cutter.tool


def _over_mm(job: Job, machine: Machine) -> float:
    """Return the length by which a job's paths exceed the usable bed; 0 within rounding."""
    margin_mm = machine.margin_mm.value
    right_mm = machine.bed_width_mm.value - margin_mm
    top_mm = machine.bed_height_mm.value - margin_mm
    contours = [path.contour for path in job.paths if path.operation.is_machined]
    if not contours:
        return 0.0
    x0, y0, x1, y1 = box_around_mm(contours)
    over_mm = max(margin_mm - x0, margin_mm - y0, x1 - right_mm, y1 - top_mm)
    return over_mm if over_mm > 1e-6 else 0.0


@design_rule(
    "VF-S02",
    broken="a sheet is too wide for the roll of film",
    unit="mm",
    on={Scope.PIECES},
    reason="a robot or sheet wider than the roll needs a seam across the film",
    remedy="shorten or narrow the robot, allow pieces, nest fewer, or use a wider roll",
)
def check_film(subject: Subject, _: Limits) -> RuleApplied:
    """Every sheet fits the roll of film.

    What is cut from one sheet lies on the roll in its best rotation.
    """
    roll_mm = needed(
        subject.profile, "needs a recipe, for the width of its film"
    ).material.roll_width_mm.value
    if subject.job is None:
        cut = {"the robot": [subject.outline.contour]}
    else:
        # Tiles lie on one film; marks may be made shorter or left out.
        sheets = subject.job.sheets or (subject.job,)
        cut = {
            f"sheet {number}" if len(sheets) > 1 else "the robot": [
                path.contour
                for path in sheet.paths
                if path.operation.is_machined and path.operation is not Operation.MARK
            ]
            for number, sheet in enumerate(sheets, start=1)
        }
    violations = []
    cut = {name: contours for name, contours in cut.items() if contours}  # none find room: VF-S01
    for name, contours in cut.items():
        width_mm = least_width_mm(np.concatenate([c.flattened_mm(0.05) for c in contours]))
        if width_mm > roll_mm:
            message = f"{name} does not lie on the roll in any turn: shorten branches, "
            message += "narrow fans or nest less on one sheet"
            aspect = "" if name == "the robot" else name
            violations.append(_warning(message, aspect, width_mm, roll_mm))
    return RuleApplied(checked=len(cut), violations=tuple(violations))


def least_width_mm(points_mm: Floats) -> float:
    """Return the width of the narrowest strip that holds some points, shape (n, 2).

    One side of it lies along an edge of their convex hull.

    >>> round(least_width_mm(np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]])), 6)
    2.4
    """
    hull = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(points_mm)))
    if len(hull) < 3:  # points of one straight line lie in a strip without width
        return 0.0
    along_x, along_y = np.diff(hull, axis=0).T
    across = np.array([-along_y, along_x]) / np.hypot(along_x, along_y)
    return float(np.ptp(hull @ across, axis=0).min())
