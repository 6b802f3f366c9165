"""The flat layout of a design, and its outline: one walk around its tree, in exact lines and arcs.

From the mouth's right corner up one side of tail and trunk, at each joint on to the next branch
counter-clockwise, around each tip, and back down to the mouth's left corner. The body is always to
the left. Reasons why pieces do not form an exact outline are found first; whether far parts of the
body cross each other is for the rules.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vinefab.core.plain_text import counted
from vinefab.core.validation import LARGEST_MM, Floats, frozen_floats
from vinefab.model.design import Build, Design, Level
from vinefab.model.outline import Contour, Part
from vinefab.model.tree import BranchTree, branch_tree
from vinefab.outline.ends import (
    BranchSide,
    OpenEnd,
    Tail,
    TipStroke,
    least_convex_radius_mm,
    tail_of,
    tip_of,
)
from vinefab.outline.joint import (
    LEAST_CUT_MM,
    LEAST_SEGMENT_MM,
    STEEPEST,
    WORST_ERROR_MM,
    Joint,
    LocalFrame,
    Pen,
    Point,
    StrokeRun,
    allowed_reach_mm,
    crotch_reach_mm,
    joint_of,
    level_lengths_mm,
    level_tapers_rad,
    placed,
    taper_rad,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlatLayout:
    """Every branch of a design as it lies on the sheet, n of them.

    The trunk's base is the origin, the trunk points along +x and the tail along -x.
    """

    tree: BranchTree  # the planned branches
    start_mm: Floats  # joint where each branch begins, shape (n, 2)
    end_mm: Floats  # joint or tip where each branch ends, shape (n, 2)
    heading_rad: Floats  # direction of each branch, counter-clockwise from +x, shape (n,)
    width_mm: Floats  # lay-flat lumen width where each branch begins, shape (n,)
    end_width_mm: Floats  # lay-flat lumen width where each branch ends, shape (n,)
    tail_mm: float  # straight length below the trunk's base

    @property
    def is_leaf(self) -> NDArray[np.bool_]:
        """Whether each branch has no children, shape (n,)."""
        return self.tree.is_leaf


def flat_layout(design: Design) -> FlatLayout:
    """Return where every branch of a design lies on the sheet.

    Examples
    --------
    >>> from vinefab.model.design import Build, Level
    >>> fork = Level(branches=2, length_mm=50.0, fan_rad=np.pi)
    >>> design = Design(
    ...     name="t", trunk_length_mm=100.0, levels=(fork,), build=Build.standard(2)
    ... )
    >>> flat_layout(design).end_mm.round(6).tolist()
    [[100.0, 0.0], [100.0, -50.0], [100.0, 50.0]]
    """
    tree = branch_tree(design)
    start, end, heading = np.zeros((len(tree), 2)), np.zeros((len(tree), 2)), np.zeros(len(tree))
    for level in range(1, design.depth + 1):
        rows = np.flatnonzero(tree.level == level)
        if level > 1:
            parents = tree.parent[rows]
            start[rows] = end[parents]
            heading[rows] = heading[parents] + tree.offset_rad[rows]
        along = np.column_stack([np.cos(heading[rows]), np.sin(heading[rows])])
        end[rows] = start[rows] + tree.length_mm[rows, None] * along
    return FlatLayout(
        tree=tree,
        start_mm=frozen_floats("start_mm", start, 2),
        end_mm=frozen_floats("end_mm", end, 2),
        heading_rad=frozen_floats("heading_rad", heading),
        width_mm=frozen_floats("width_mm", np.array(design.build.widths_mm)[tree.level - 1]),
        end_width_mm=frozen_floats(
            "end_width_mm", np.array(design.build.end_widths_mm)[tree.level - 1]
        ),
        tail_mm=design.build.tail_mm,
    )


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

    def used_mm(self, level: int, sibling: int) -> tuple[Point, Point]:
        """Return the lengths of a branch's right and left side that its base and its end take.

        At the base that is the largest of all kinds of joints.
        """
        base, end = (0.0, 0.0), (self.tip(sibling).used_mm,) * 2
        if level > 1:
            gaps = [joint.gaps[sibling : sibling + 2] for joint in self.joints[level - 2]]
            base = (
                max(one.second_used_mm for one, _ in gaps),
                max(two.first_used_mm for _, two in gaps),
            )
        if level <= len(self.joints):
            around = self.joint(level, sibling).gaps
            end = around[0].first_used_mm, around[-1].second_used_mm
        return base, end


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
            for joint in kinds:
                gap = joint.gaps[number]
                if joint.allowed_mm[number] < 0.0:
                    halves = (side.half_mm - pattern.offset_mm for side in (gap.first, gap.second))
                    limit = allowed_reach_mm(gap.first, gap.second, joint.disc_mm)
                    figures = crotch_reach_mm(gap.angle_rad, *halves), limit
                    kind = ProblemKind.NARROW_CROTCH
                elif gap.error_mm > WORST_ERROR_MM and min(joint.allowed_mm) >= 0.0:
                    kind, figures = ProblemKind.SHORT_SEGMENT, (gap.error_mm, WORST_ERROR_MM)
                else:
                    continue
                names = [places.branch(joint, side.owner) for side in (gap.first, gap.second)]
                found.append(places.problem(kind, joint.level, tuple(names), figures))
                break
    return (*found, *_tail(design, places, pattern), *_rooms(design, places, pattern))


def drawing_problems(
    layout: FlatLayout, pattern: OutlineParts, contour: Contour
) -> tuple[OutlineProblem, ...]:
    """Return a problem for the shortest segment of a contour, if it is too short to draw."""
    shortest = min(contour.segments, key=lambda segment: segment.length_mm)
    # The mouth's width, the tip's arcs: only designs of microscopic size get here.
    if (
        shortest.length_mm >= LEAST_SEGMENT_MM * (1.0 - 1e-6)
        and pattern.tail.collar.start_mm[1] < 0.0
    ):
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


def _tail(design: Design, places: _Places, pattern: OutlineParts) -> Iterator[OutlineProblem]:
    """Check that a collar leaves some straight tail, and that its arcs are not too small."""
    collar, tail = design.build.collar, pattern.tail
    if collar is None:
        return
    room = tail.bend.start_mm[0] - tail.even_mm
    if room < LEAST_SEGMENT_MM:
        yield places.problem(ProblemKind.COLLAR, 1, ("0",), (room, LEAST_SEGMENT_MM))
    rise = abs(collar.flat_width_mm - design.build.widths_mm[0]) / 2
    # Arcs that turn by more than a right angle run back; a radius r takes a flare of
    # sqrt((4 r - rise) rise).
    radius = LEAST_COLLAR_RADIUS_MM + abs(pattern.offset_mm)
    least = max(rise, math.sqrt(max(0.0, (4.0 * radius - rise) * rise)))
    if collar.flare_mm < least:
        yield places.problem(ProblemKind.COLLAR_FLARE, 1, ("0",), (collar.flare_mm, least))
    half = -tail.collar.start_mm[1]
    if half < LEAST_SEGMENT_MM:
        yield places.problem(ProblemKind.VANISHED, 1, ("0",), (half, LEAST_SEGMENT_MM))


def _rooms(design: Design, places: _Places, pattern: OutlineParts) -> Iterator[OutlineProblem]:
    """Check the straight side that is left between the two ends of every kind of branch."""
    for level, width in enumerate(design.build.widths_mm, start=1):
        least = (width - design.build.end_widths_mm[level - 1]) / 2.0 / STEEPEST
        lengths, leans = level_lengths_mm(design, level), level_tapers_rad(design, level)
        for child, (length, lean) in enumerate(zip(lengths, leans, strict=True)):
            # Where the larger disc hides the smaller one: by how much the branch is too short.
            side = length - least if length < least else length * math.cos(lean)
            if level == 1 and not lean:  # that of a tapered trunk ends where the tail's begins
                side -= pattern.tail.even_mm
            base, end = pattern.used_mm(level, child)
            room = side - max(base[0] + end[0], base[1] + end[1])
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
    stubs: tuple[tuple[int, OpenEnd], ...] = ()  # each with the index of its branch


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
    made = _kept_outline if design.branch_count <= _MOST_KEPT else _outline
    return made(drawn_of(design), offset_mm, least_fillet_mm, ends)


_MOST_KEPT = 200
"""Outlines of more branches are not kept: they take much memory."""


def _outline(
    drawn: DrawnDesign, offset_mm: float, least_fillet_mm: float, ends: PieceEnds
) -> BodyOutline:
    design = design_drawn(drawn)
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
        self.stubs = dict(piece.stubs)
        self.ids = layout.tree.ids
        self.level = layout.tree.level.tolist()
        self.sibling = [0] * len(self.ids)
        self.children: list[list[int]] = [[] for _ in self.ids]
        for branch, parent in enumerate(layout.tree.parent.tolist()):
            if parent >= 0:
                self.sibling[branch] = len(self.children[parent])
                self.children[parent].append(branch)
        heading = layout.heading_rad.tolist()
        # Frames of each branch, where it begins and where it ends.
        self.begins, self.ends = (
            [LocalFrame((x, y), turn) for (x, y), turn in zip(at.tolist(), heading, strict=True)]
            for at in (layout.start_mm, layout.end_mm)
        )
        self.pen = Pen(pattern.tail.collar.start_mm)

    def contour(self) -> Contour:
        """Walk from the right corner of the mouth, or of a piece's base, to the left corner."""
        root, base = self.piece.root, self.piece.base
        right = self.pattern.tail.collar if base is None else self._open_end(root, base)
        left = right.mirrored().reversed()
        frame, owner = self.begins[root], (self.ids[root],)
        self.pen = Pen(placed(right.start_mm, frame))
        self.pen.pieces(right, frame, owner)
        self._around(root)
        self._side(placed(left.start_mm, frame), root)
        self.pen.pieces(left, frame, owner)
        return self.pen.contour()

    def _open_end(self, branch: int, end: OpenEnd) -> StrokeRun:
        """Return the right side of an open end, from its mouth to the branch's own side."""
        layout, offset = self.layout, self.pattern.offset_mm
        half, far = float(layout.width_mm[branch]) / 2, float(layout.end_width_mm[branch]) / 2
        lean = taper_rad(half, far, float(layout.tree.length_mm[branch]))
        return BranchSide(half_mm=half + offset, lean_rad=lean).end_mm(end, offset)

    def _around(self, branch: int) -> None:
        """Walk from the base of a branch's right side to the end of its left side."""
        if branch in self.stubs:
            # Along the stub to its mouth, and back.
            left = self._open_end(branch, self.stubs[branch]).mirrored()
            right = left.mirrored().reversed()
            frame, owner = self.begins[branch], (self.ids[branch],)
            self._side(placed(right.start_mm, frame), branch)
            self.pen.pieces(right, frame, owner)
            self.pen.go_to(placed(left.start_mm, frame), Part.MOUTH, self.ids[branch])
            self.pen.pieces(left, frame, owner)
            return
        if not self.children[branch]:
            run = self.pattern.tip(self.sibling[branch]).run
            self._side(placed(run.start_mm, self.ends[branch]), branch)
            self.pen.pieces(run, self.ends[branch], (self.ids[branch],))
            return
        joint = self.pattern.joint(self.level[branch], self.sibling[branch])
        owners = (self.ids[branch], *(self.ids[child] for child in self.children[branch]))
        # Into the joint from the parent's side, then from that of each child to the next.
        for gap, first in zip(joint.gaps, (branch, *self.children[branch]), strict=True):
            if first != branch:
                self._around(first)
            self._side(placed(gap.run.start_mm, self.ends[branch]), first)
            self.pen.pieces(gap.run, self.ends[branch], owners)

    def _side(self, point: Point, branch: int) -> None:
        """Walk straight along a branch; below the trunk's base its side is the tail."""
        if branch > 0:
            self.pen.go_to(point, Part.SIDE, self.ids[branch])
            return
        here, bend = self.pen.at_mm, self.pattern.tail.bend
        base = bend.start_mm[0]
        if here[0] > point[0]:
            bend = bend.mirrored().reversed()
        if bend.pieces:
            passes = min(here[0], point[0]) <= base + 1e-9
        else:
            # The side of an even trunk is divided at its base only if both parts are long enough to
            # draw. Leaving out the corner of a tapered trunk moves its side.
            nearest = min(math.dist(here, bend.start_mm), math.dist(bend.start_mm, point))
            passes = (here[0] < base) != (point[0] < base)
            passes &= nearest >= (LEAST_SEGMENT_MM if base else LEAST_CUT_MM)
        if passes:
            self._trunk_side(bend.start_mm)
            self.pen.pieces(bend, self.begins[0], self.ids[:1])
        self._trunk_side(point)

    def _trunk_side(self, point: Point) -> None:
        """Walk straight to a point, along tail or trunk."""
        middle = (self.pen.at_mm[0] + point[0]) / 2
        self.pen.go_to(point, Part.TAIL if middle < 0.0 else Part.SIDE, self.ids[0])
