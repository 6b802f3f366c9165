"""The outline of a design: one walk around its tree, in exact lines and arcs.

From the mouth's right corner up one side of tail and trunk, at each joint on to the next branch
counter-clockwise, around each tip, and back down to the mouth's left corner. The body is always to
the left. Whether far parts of the body cross each other is not the walk's business.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

from vinefab.fabrication.outline.ends import BranchSide, OpenEnd
from vinefab.fabrication.outline.exactness import (
    DrawnDesign,
    OutlineParts,
    OutlineProblem,
    ProblemKind,
    design_drawn,
    drawing_problems,
    drawn_of,
    outline_parts,
    parts_problems,
)
from vinefab.fabrication.outline.gap import taper_rad
from vinefab.fabrication.outline.joint import Joint
from vinefab.fabrication.outline.layout import FlatLayout, flat_layout
from vinefab.fabrication.outline.stroke import (
    LEAST_CUT_MM,
    LEAST_SEGMENT_MM,
    LocalFrame,
    Pen,
    Point,
    StrokeRun,
    StrokeSegment,
    placed,
)
from vinefab.model.design import Design
from vinefab.model.outline import Contour, Part


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
