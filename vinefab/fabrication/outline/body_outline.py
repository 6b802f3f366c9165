"""The outline of a design: one walk around its tree, in exact lines and arcs.

From the mouth's right corner up one side of tail and trunk, at each joint on to the next branch
counter-clockwise, around each tip, and back down to the mouth's left corner. The body is always to
the left. Reasons why pieces do not form an exact outline are found first; whether far parts of the
body cross each other is for the rules.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import lru_cache

import numpy as np

from vinefab.core.plain_text import counted
from vinefab.core.validation import LARGEST_MM
from vinefab.fabrication.outline.ends import (
    BranchSide,
    OpenEnd,
    Tail,
    TipStroke,
    least_convex_radius_mm,
    tail_of,
    tip_of,
)
from vinefab.fabrication.outline.joint import (
    STEEPEST,
    Joint,
    allowed_reach_mm,
    crotch_reach_mm,
    joint_of,
    level_lengths_mm,
    level_tapers_rad,
    taper_rad,
)
from vinefab.fabrication.outline.layout import FlatLayout, flat_layout
from vinefab.fabrication.outline.stroke import (
    LEAST_CUT_MM,
    LEAST_SEGMENT_MM,
    WORST_ERROR_MM,
    LocalFrame,
    Pen,
    Point,
    StrokeRun,
    StrokeSegment,
    placed,
)
from vinefab.model.design import Build, Design, Level
from vinefab.model.outline import Contour, Part


class ProblemKind(StrEnum):
    """The ways in which a design has no exact outline."""

    CHILD_WIDTH = "child_width"
    """A child is not narrower than its parent."""

    NARROW_CROTCH = "narrow_crotch"
    """Two neighbours at a joint part only beyond half the shorter of them."""

    NO_ROOM = "no_room"
    """Fillets, joints or a pouch at the two ends of a branch overlap along its side."""

    POUCH_WIDTH = "pouch_width"
    """A pouch is not wider than its branch."""

    VANISHED = "vanished"
    """An inward offset leaves nothing of a branch."""

    COLLAR = "collar"
    """A collar takes the whole tail."""

    COLLAR_FLARE = "collar_flare"
    """A collar goes over into the tail too suddenly."""

    SHORT_SEGMENT = "short_segment"
    """A line or arc would be too short to draw."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlineProblem:
    """One reason why an outline is not exact."""

    kind: ProblemKind
    branches: tuple[str, ...]  # ids of the branches concerned, at the first place of the problem
    x_mm: float  # of that place in the flat layout
    y_mm: float
    count: int = 1  # number of places: all joints of a level are alike
    measured_mm: float
    limit_mm: float
    message: str  # one sentence: the problem and its remedy


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlineParts:
    """The pieces that an outline repeats."""

    offset_mm: float  # how far outside the lumen's edge they run
    tail: Tail  # from the mouth to the trunk's base
    # For each level with children, trunk first: one kind of joint, or, where the level tapers, one
    # for each child of a fan.
    joints: tuple[tuple[Joint, ...], ...]
    tips: tuple[TipStroke, ...]  # the far end of a leaf: one, or one for each child of a fan

    def joint(self, level: int, sibling: int) -> Joint:
        """Return the joint at the end of a branch."""
        kinds = self.joints[level - 1]
        return kinds[sibling % len(kinds)]

    def tip(self, sibling: int) -> TipStroke:
        """Return the far end of a leaf."""
        return self.tips[sibling % len(self.tips)]


def outline_parts(design: Design, offset_mm: float, least_fillet_mm: float = 0.0) -> OutlineParts:
    """Return the pieces of a design's outline at an offset; smaller fillets there are corners."""
    return _outline_parts(drawn_of(design), offset_mm, least_fillet_mm)


DrawnDesign = tuple[float, tuple[Level, ...], Build]
"""What of a design its outline is drawn from: length of the trunk, levels, build."""


def drawn_of(design: Design) -> DrawnDesign:
    """Return the part of a design that its outline is drawn from; it can be a cache's key."""
    return design.trunk_length_mm, design.levels, design.build


def design_drawn(drawn: DrawnDesign) -> Design:
    """Return a design with a fixed name that has the same outline."""
    trunk_mm, levels, build = drawn
    return Design(name="drawn", trunk_length_mm=trunk_mm, levels=levels, build=build)


@lru_cache(maxsize=16)
def _outline_parts(drawn: DrawnDesign, offset_mm: float, least_fillet_mm: float) -> OutlineParts:
    # Whatever looks at a robot asks for the same few patterns: of its lumen and of its paths.
    design = design_drawn(drawn)
    return OutlineParts(
        offset_mm=offset_mm,
        tail=tail_of(design, offset_mm),
        joints=tuple(
            tuple(
                joint_of(design, level, offset_mm, sibling, least_fillet_mm=least_fillet_mm)
                for sibling in range(_kinds(design, level))
            )
            for level in range(1, design.depth)
        ),
        tips=tuple(
            tip_of(design, offset_mm, lean, least_fillet_mm)
            for lean in level_tapers_rad(design, design.depth)[: _kinds(design, design.depth)]
        ),
    )


def _kinds(design: Design, level: int) -> int:
    """Return the number of kinds of ends in a level's branches: one if all are even."""
    leans = level_tapers_rad(design, level)
    return 1 if len(set(leans)) == 1 else len(leans)


LEAST_STEP_MM = 0.1
"""A child must be narrower than its parent, and a pouch wider than its branch, by this much."""

LEAST_COLLAR_RADIUS_MM = 1.0
"""The arcs that lead from a collar to the trunk's width keep at least this radius (assumed)."""


class _Places:
    """Where the pieces of a pattern first occur: branch ids and coordinates."""

    def __init__(self, layout: FlatLayout) -> None:
        self.layout = layout
        self.ids = layout.tree.ids
        self.first = {
            level: int(np.flatnonzero(layout.tree.level == level)[0])
            for level in np.unique(layout.tree.level).tolist()
        }

    def branch(self, joint: Joint, owner: int) -> str:
        """Return the id of a strip at the first joint of its level."""
        if owner == 0:
            return self.ids[self.first[joint.level]]
        return self.ids[self.first[joint.level + 1] + owner - 1]

    def problem(
        self, kind: ProblemKind, level: int, branches: tuple[str, ...], found: tuple[float, float]
    ) -> OutlineProblem:
        """Return a problem that occurs at the end of every branch of one level."""
        count = int(np.count_nonzero(self.layout.tree.level == level))
        x, y = self.layout.end_mm[self.first[level]].tolist()
        message = _MESSAGES[kind].format(
            names=" and ".join(branches), found=found[0], limit=found[1]
        )
        return OutlineProblem(
            kind=kind,
            branches=branches,
            x_mm=x,
            y_mm=y,
            count=count,
            measured_mm=min(max(found[0], -LARGEST_MM), LARGEST_MM),
            limit_mm=found[1],
            message=message
            if count == 1
            else f"{message} It is so at {counted(count, 'place')} alike.",
        )


_MESSAGES = {
    ProblemKind.CHILD_WIDTH: (
        "Of {names} the child is {found:.3g} mm wide and its parent leaves it {limit:.3g} mm: "
        "make the child's level narrower."
    ),
    ProblemKind.NARROW_CROTCH: (
        "The sides of {names} part only {found:.4g} mm from their joint, more than the "
        "{limit:.4g} mm that are half the shorter one: widen the angle between them, make them "
        "narrower or longer."
    ),
    ProblemKind.NO_ROOM: (
        "Fillets, joints or pouches at the two ends of {names} leave {found:.3g} mm of straight "
        "side, {limit:.3g} mm are needed: make it longer, or fillets, pouch or taper smaller."
    ),
    ProblemKind.POUCH_WIDTH: (
        "The pouch of {names} is {found:.4g} mm wide, its branch asks for at least {limit:.4g} mm."
    ),
    ProblemKind.VANISHED: (
        "The offset leaves {names} a half width or corner radius of {found:.3g} mm, at least "
        "{limit:.3g} mm are needed."
    ),
    ProblemKind.COLLAR: (
        "The collar leaves {found:.3g} mm of straight tail before the trunk of {names}, "
        "{limit:.3g} mm are needed: lengthen build.tail_mm or shorten the collar."
    ),
    ProblemKind.COLLAR_FLARE: (
        "The collar of {names} goes over into the tail within {found:.3g} mm, at least "
        "{limit:.3g} mm are needed: lengthen its flare_mm."
    ),
    ProblemKind.SHORT_SEGMENT: (
        "Near {names} the outline has a detail of {found:.2g} mm, too short to draw exactly "
        "({limit:.2g} mm): change the fillet radius or the angle a little."
    ),
}


def parts_problems(
    design: Design, layout: FlatLayout, pattern: OutlineParts
) -> tuple[OutlineProblem, ...]:
    """Return the misfits between the pieces of an outline, in the order of the levels."""
    places = _Places(layout)
    found = [*_widths(design, places, pattern.offset_mm)]
    for kinds in pattern.joints:
        for number in range(len(kinds[0].gaps)):
            # Joints that differ only by the taper of their parents' sides share one problem.
            each = (_gap_problems(places, joint, number, pattern.offset_mm) for joint in kinds)
            found += next(filter(None, map(list, each)), [])
    return (*found, *_tail(design, places, pattern), *_rooms(design, places, pattern))


def drawing_problems(
    layout: FlatLayout, pattern: OutlineParts, contour: Contour
) -> tuple[OutlineProblem, ...]:
    """Return a problem for the shortest segment of a contour, if it is too short to draw."""
    shortest = min(contour.segments, key=lambda segment: segment.length_mm)
    # The mouth's width, the tip's arcs: only designs of microscopic size get here.
    if shortest.length_mm >= LEAST_SEGMENT_MM * (1.0 - 1e-6) and pattern.tail.start_mm[1] < 0.0:
        return ()
    level = int(layout.tree.level[layout.tree.ids.index(shortest.branch)])
    found = (shortest.length_mm, LEAST_SEGMENT_MM)
    problem = _Places(layout).problem(ProblemKind.SHORT_SEGMENT, level, (shortest.branch,), found)
    return (problem,)


def _widths(design: Design, places: _Places, offset_mm: float) -> Iterator[OutlineProblem]:
    widths, pouch = design.build.widths_mm, design.build.pouch
    ends = design.build.end_widths_mm
    for level, width in enumerate(ends, start=1):
        name = places.ids[places.first[level]]
        if width / 2 + offset_mm < LEAST_SEGMENT_MM:
            found = (width / 2 + offset_mm, LEAST_SEGMENT_MM)
            yield places.problem(ProblemKind.VANISHED, level, (name,), found)
        found = (widths[level - 1], ends[level - 2] - LEAST_STEP_MM)
        if level > 1 and found[0] > found[1]:
            parent = places.ids[places.first[level - 1]]
            yield places.problem(ProblemKind.CHILD_WIDTH, level - 1, (parent, name), found)
    limit = ends[-1] + LEAST_STEP_MM
    name = places.ids[places.first[design.depth]]
    if pouch is not None and pouch.flat_width_mm < limit:
        found = (pouch.flat_width_mm, limit)
        yield places.problem(ProblemKind.POUCH_WIDTH, design.depth, (name,), found)
    elif pouch is not None and least_convex_radius_mm(design) + offset_mm < 0.0:
        found = (least_convex_radius_mm(design) + offset_mm, 0.0)
        yield places.problem(ProblemKind.VANISHED, design.depth, (name,), found)


def _gap_problems(
    places: _Places, joint: Joint, number: int, offset_mm: float
) -> Iterator[OutlineProblem]:
    gap = joint.gaps[number]
    names = (places.branch(joint, gap.first.owner), places.branch(joint, gap.second.owner))
    if joint.allowed_mm[number] < 0.0:
        halves = gap.first.half_mm - offset_mm, gap.second.half_mm - offset_mm
        found = (
            crotch_reach_mm(gap.angle_rad, *halves),
            allowed_reach_mm(gap.first, gap.second, joint.disc_mm),
        )
        yield places.problem(ProblemKind.NARROW_CROTCH, joint.level, names, found)
    elif gap.error_mm > WORST_ERROR_MM and min(joint.allowed_mm) >= 0.0:
        found = (gap.error_mm, WORST_ERROR_MM)
        yield places.problem(ProblemKind.SHORT_SEGMENT, joint.level, names, found)


def _tail(design: Design, places: _Places, pattern: OutlineParts) -> Iterator[OutlineProblem]:
    """Check that a collar leaves some straight tail, and that its arcs are not too small."""
    collar, tail = design.build.collar, pattern.tail
    if collar is None:
        return
    room = tail.base_mm[0] - tail.even_mm
    if room < LEAST_SEGMENT_MM:
        yield places.problem(ProblemKind.COLLAR, 1, ("0",), (room, LEAST_SEGMENT_MM))
    rise = abs(collar.flat_width_mm - design.build.widths_mm[0]) / 2
    # Arcs that turn by more than a right angle run back; a radius r takes a flare of
    # sqrt((4 r - rise) rise).
    radius = LEAST_COLLAR_RADIUS_MM + abs(pattern.offset_mm)
    least = max(rise, math.sqrt(max(0.0, (4.0 * radius - rise) * rise)))
    if collar.flare_mm < least:
        yield places.problem(ProblemKind.COLLAR_FLARE, 1, ("0",), (collar.flare_mm, least))
    if -tail.start_mm[1] < LEAST_SEGMENT_MM:
        found = (-tail.start_mm[1], LEAST_SEGMENT_MM)
        yield places.problem(ProblemKind.VANISHED, 1, ("0",), found)


def _rooms(design: Design, places: _Places, pattern: OutlineParts) -> Iterator[OutlineProblem]:
    """Check the straight side that is left between the two ends of every kind of branch."""
    trunk = design.trunk_length_mm
    if level_tapers_rad(design, 1)[0]:
        # The side of a tapered trunk ends where the tail's begins.
        trunk = _side_mm(design, 1, 0)
    else:
        trunk -= pattern.tail.even_mm
    yield from _room(places, pattern, (1, 0), (trunk, 0.0, 0.0))
    for kinds in pattern.joints:
        level = kinds[0].level + 1
        for child in range(design.levels[level - 2].branches):
            right = max(joint.gaps[child].second_used_mm for joint in kinds)
            left = max(joint.gaps[child + 1].first_used_mm for joint in kinds)
            base = (_side_mm(design, level, child), right, left)
            yield from _room(places, pattern, (level, child), base)


def _side_mm(design: Design, level: int, child: int) -> float:
    """Return the length of a branch's side between the discs at its ends.

    Where the larger disc hides the smaller one it is negative: by how much the branch is too short.
    """
    build, length = design.build, level_lengths_mm(design, level)[child]
    least = (build.widths_mm[level - 1] - build.end_widths_mm[level - 1]) / 2.0 / STEEPEST
    if length < least:
        return length - least
    return length * math.cos(level_tapers_rad(design, level)[child])


def _room(
    places: _Places,
    pattern: OutlineParts,
    branch: tuple[int, int],
    base: tuple[float, float, float],
) -> Iterator[OutlineProblem]:
    """Check one branch: ``base`` holds its length and its base's lengths, right and left."""
    level, child = branch
    if level <= len(pattern.joints):
        gaps = pattern.joint(level, child).gaps
        right, left = gaps[0].first_used_mm, gaps[-1].second_used_mm
    else:
        right = left = pattern.tip(child).used_mm
    room = base[0] - max(base[1] + right, base[2] + left)
    if room < LEAST_SEGMENT_MM:
        name = places.ids[places.first[level] + child]
        yield places.problem(ProblemKind.NO_ROOM, level, (name,), (room, LEAST_SEGMENT_MM))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyOutline:
    """The outline of a design."""

    # Open, from the mouth's right corner counter-clockwise around the body to its left corner.
    # With problems it is a sketch for a picture, not a shape to cut.
    contour: Contour
    problems: tuple[OutlineProblem, ...]  # why the contour is not exact; empty if it is


@dataclass(frozen=True, slots=True, kw_only=True)
class PieceEnds:
    """Where the outline of one piece of a robot begins and ends."""

    root: int = 0  # index of the branch that it begins with; the trunk has the tail
    base: OpenEnd | None = None  # the base of any other
    stubs: Mapping[int, OpenEnd] = field(default_factory=dict)  # by the index of their branches


WHOLE_ROBOT = PieceEnds()
"""The whole robot: from the tail to all tips."""


def body_outline(
    design: Design,
    offset_mm: float = 0.0,
    *,
    least_fillet_mm: float = 0.0,
    ends: PieceEnds = WHOLE_ROBOT,
) -> BodyOutline:
    """Return the outline of a design, or of one piece of it, in the coordinates of its flat layout.

    Parameters
    ----------
    offset_mm
        How far outside the lumen's edge the outline runs: half widths and convex radii grow by
        it, fillet radii shrink by it. The mouth stays at the tail's end.
    least_fillet_mm
        Fillets that the offset leaves smaller than this are corners.
    ends
        Where a piece begins and ends. The open end of a stub is a straight segment of the mouth's
        kind; the contour runs through it.

    Examples
    --------
    >>> from vinefab.model.design import Build
    >>> vine = Design(name="vine", trunk_length_mm=100.0, build=Build.standard(1))
    >>> outline = body_outline(vine)
    >>> [segment.part.value for segment in outline.contour.segments]
    ['tail', 'side', 'tip', 'tip', 'side', 'tail']
    >>> [round(edge, 6) for edge in outline.contour.box_mm]
    [-200.0, -20.0, 120.0, 20.0]
    """
    drawn = drawn_of(design)
    stubs = tuple(sorted(ends.stubs.items()))
    made = _kept_outline if design.branch_count <= _MOST_KEPT else _outline
    return made(drawn, offset_mm, least_fillet_mm, (ends.root, ends.base, stubs))


_MOST_KEPT = 200
"""Outlines of more branches are not kept: they take much memory."""


def _outline(
    drawn: DrawnDesign,
    offset_mm: float,
    least_fillet_mm: float,
    piece: tuple[int, OpenEnd | None, tuple[tuple[int, OpenEnd], ...]],
) -> BodyOutline:
    design, (root, base, stubs) = design_drawn(drawn), piece
    ends = PieceEnds(root=root, base=base, stubs=dict(stubs))
    layout = flat_layout(design)
    pattern = outline_parts(design, offset_mm, least_fillet_mm)
    problems = parts_problems(design, layout, pattern)
    if any(problem.kind is ProblemKind.VANISHED for problem in problems):
        pattern = outline_parts(design, 0.0)
    contour = _Walk(layout, pattern, ends).contour()
    return BodyOutline(
        contour=contour, problems=problems or drawing_problems(layout, pattern, contour)
    )


# The search for pieces, the rules and the job of the laser ask for the same outlines in turn.
_kept_outline = lru_cache(maxsize=32)(_outline)


class _Walk:
    """One walk around a tree, which draws one contour."""

    def __init__(self, layout: FlatLayout, pattern: OutlineParts, piece: PieceEnds) -> None:
        self.layout, self.pattern, self.piece = layout, pattern, piece
        self.ids = layout.tree.ids
        self.level = layout.tree.level.tolist()
        self.ends: list[Point] = [(x, y) for x, y in layout.end_mm.tolist()]
        self.heading = layout.heading_rad.tolist()
        self.sibling = [0] * len(self.ids)
        self.children: list[list[int]] = [[] for _ in self.ids]
        for branch, parent in enumerate(layout.tree.parent.tolist()):
            if parent >= 0:
                self.sibling[branch] = len(self.children[parent])
                self.children[parent].append(branch)
        self.pen = Pen([pattern.tail.start_mm])

    def contour(self) -> Contour:
        """Walk from one corner of the mouth to the other."""
        base = self.piece.base
        return self._from_tail() if base is None else self._from_base(base)

    def _from_base(self, base: OpenEnd) -> Contour:
        """Walk from the right corner of a piece's base around it to the left corner."""
        root = self.piece.root
        frame, owner = self._base_frame(root), (self.ids[root],)
        right = self._branch_side(root).end_mm(base, self.pattern.offset_mm)
        left = _reversed(_across_axis(right))
        self.pen = Pen([placed(right.start_mm, frame)])
        self.pen.pieces(right, frame, owner)
        self._around(root)
        self._side(placed(left.start_mm, frame), root)
        self.pen.pieces(left, frame, owner)
        return self.pen.contour()

    def _base_frame(self, branch: int) -> LocalFrame:
        """Return the frame of a branch, which begins where the branch does."""
        x, y = self.layout.start_mm[branch].tolist()
        return LocalFrame((x, y), self.heading[branch])

    def _branch_side(self, branch: int) -> BranchSide:
        """Return the right side of a branch, as far outside the lumen as the outline runs."""
        layout = self.layout
        half, end = float(layout.width_mm[branch]) / 2, float(layout.end_width_mm[branch]) / 2
        lean = taper_rad(half, end, float(layout.tree.length_mm[branch]))
        return BranchSide(half_mm=half + self.pattern.offset_mm, lean_rad=lean)

    def _from_tail(self) -> Contour:
        """Walk from the right corner of the tail's mouth around the body to the left corner."""
        tail, name = self.pattern.tail, self.ids[0]
        for piece in tail.pieces:
            self.pen.go_to(piece.end_mm, piece.part, name, piece.bulge)
        self._around(0)
        # The left side mirrors the right one.
        ends = [tail.start_mm, *(piece.end_mm for piece in tail.pieces)]
        self._side(_mirrored(ends[-1]), 0)
        for piece, end in zip(reversed(tail.pieces), reversed(ends[:-1]), strict=True):
            self.pen.go_to(_mirrored(end), piece.part, name, piece.bulge)
        return self.pen.contour()

    def _around(self, branch: int) -> None:
        """Walk from the base of a branch's right side to the end of its left side."""
        if branch in self.piece.stubs:
            # Along the stub to its mouth, and back.
            end = self._branch_side(branch).end_mm(self.piece.stubs[branch], self.pattern.offset_mm)
            frame, owner = self._base_frame(branch), (self.ids[branch],)
            right, left = _reversed(end), _across_axis(end)
            self._side(placed(right.start_mm, frame), branch)
            self.pen.pieces(right, frame, owner)
            self.pen.go_to(placed(left.start_mm, frame), Part.MOUTH, self.ids[branch])
            self.pen.pieces(left, frame, owner)
            return
        if not self.children[branch]:
            frame = LocalFrame(self.ends[branch], self.heading[branch])
            tip = self.pattern.tip(self.sibling[branch])
            self._side(placed(tip.run.start_mm, frame), branch)
            self.pen.pieces(tip.run, frame, (self.ids[branch],))
            return
        joint = self.pattern.joint(self.level[branch], self.sibling[branch])
        self._gap(joint, 0, branch, branch)
        for number, child in enumerate(self.children[branch], start=1):
            self._around(child)
            self._gap(joint, number, branch, child)

    def _gap(self, joint: Joint, number: int, parent: int, first: int) -> None:
        """Walk from the left of one neighbour at a joint to the right of the next."""
        gap = joint.gaps[number]
        frame = LocalFrame(self.ends[parent], self.heading[parent])
        self._side(placed(gap.run.start_mm, frame), first)
        owners = (self.ids[parent], *(self.ids[child] for child in self.children[parent]))
        self.pen.pieces(gap.run, frame, owners)

    def _side(self, point: Point, branch: int) -> None:
        """Walk straight along a branch; below the trunk's base its side is the tail."""
        if branch > 0:
            self.pen.go_to(point, Part.SIDE, self.ids[branch])
            return
        here = self.pen.points[-1]
        for end, bulge in self._base(here, point):
            part = Part.JOINT if bulge else self._trunk_part(end)
            self.pen.go_to(end, part, self.ids[0], bulge)
        self.pen.go_to(point, self._trunk_part(point), self.ids[0])

    def _base(self, here: Point, point: Point) -> list[tuple[Point, float]]:
        """Return the points and bulges past the trunk's base, where a straight side passes it.

        The side of an even trunk is divided there only if both parts are long enough to draw.
        """
        tail = self.pattern.tail
        way = [(tail.base_mm, 0.0), *((piece.end_mm, piece.bulge) for piece in tail.bend)]
        if here[0] > point[0]:
            ends = [_mirrored(end) for end, _ in reversed(way)]
            way = list(zip(ends, [0.0, *(bulge for _, bulge in reversed(way[1:]))], strict=True))
        if tail.bend:
            return way if min(here[0], point[0]) <= tail.base_mm[0] + 1e-9 else []
        base = way[0][0]
        if (here[0] < base[0]) == (point[0] < base[0]):
            return []
        nearest = min(math.dist(here, base), math.dist(way[-1][0], point))
        # Leaving out the corner of a tapered trunk moves its side.
        least = LEAST_SEGMENT_MM if base[0] else LEAST_CUT_MM
        return way if nearest >= least else []

    def _trunk_part(self, point: Point) -> Part:
        """Return the part of the straight side that leads to a point of the trunk."""
        middle = (self.pen.points[-1][0] + point[0]) / 2
        return Part.TAIL if middle < 0.0 else Part.SIDE


def _mirrored(point: Point) -> Point:
    """Return a point of the right side of a branch on its left side."""
    return point[0], -point[1]


def _across_axis(run: StrokeRun) -> StrokeRun:
    """Return a run of the right side of a branch on its left side."""
    pieces = (StrokeSegment(_mirrored(p.end_mm), -p.bulge, p.part) for p in run.pieces)
    return StrokeRun(_mirrored(run.start_mm), tuple(pieces))


def _reversed(run: StrokeRun) -> StrokeRun:
    """Return a run from its other end."""
    ends = [run.start_mm, *(piece.end_mm for piece in run.pieces)]
    pieces = (
        StrokeSegment(end, -piece.bulge, piece.part)
        for piece, end in zip(reversed(run.pieces), reversed(ends[:-1]), strict=True)
    )
    return StrokeRun(ends[-1], tuple(pieces))
