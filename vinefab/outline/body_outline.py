"""The flat layout of a design, and its outline: one walk around its tree, in exact lines and arcs.

From the mouth's right corner up one side of tail and trunk, at each joint on to the next branch
counter-clockwise, around each tip, and back down to the mouth's left corner. The body is always to
the left. Reasons why pieces do not form an exact outline are found first; whether far parts of the
body cross each other is for the rules.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vinefab.core.plain_text import counted
from vinefab.core.validation import LARGEST_MM, Floats, frozen_floats
from vinefab.model.design import Build, Design, Pouch
from vinefab.model.outline import Contour, Part
from vinefab.model.tree import BranchTree
from vinefab.outline.ends import (
    BranchSide,
    Leaf,
    OpenEnd,
    Tail,
    TipStroke,
    least_convex_radius_mm,
    level_fillets_mm,
    tail_of,
    tip_of,
)
from vinefab.outline.joint import (
    LEAST_CUT_MM,
    LEAST_SEGMENT_MM,
    STEEPEST,
    WORST_ERROR_MM,
    Joint,
    JointPlan,
    LocalFrame,
    Pen,
    PlannedSide,
    Point,
    StrokeRun,
    allowed_reach_mm,
    crotch_reach_mm,
    joint_of,
    placed,
    taper_rad,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlatLayout:
    """Every straight part of a design's branches as it lies on the sheet, n of them.

    Without preformed bends these are the branches. The trunk's base is the origin, the trunk points
    along +x and the tail along -x.
    """

    tree: BranchTree  # the straight parts of the planned branches
    start_mm: Floats  # joint where each begins, shape (n, 2)
    end_mm: Floats  # joint or tip where each ends, shape (n, 2)
    heading_rad: Floats  # direction of each, counter-clockwise from +x, shape (n,)
    tail_mm: float  # straight length below the trunk's base
    pouches: tuple[Pouch | None, ...]  # at the end of each

    @property
    def width_mm(self) -> Floats:
        """Lay-flat lumen width where each begins, shape (n,)."""
        return self.tree.width_mm

    @property
    def end_width_mm(self) -> Floats:
        """Lay-flat lumen width where each ends, shape (n,)."""
        return self.tree.end_width_mm

    @property
    def is_leaf(self) -> NDArray[np.bool_]:
        """Whether each has no children, shape (n,)."""
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
    return _layout(DrawnTree.of(design))


def _layout(drawn: "DrawnTree") -> FlatLayout:
    tree = drawn.tree
    start, end, heading = tree.laid_out()
    return FlatLayout(
        tree=tree,
        start_mm=frozen_floats("start_mm", start, 2),
        end_mm=frozen_floats("end_mm", end, 2),
        heading_rad=frozen_floats("heading_rad", heading),
        tail_mm=drawn.build.tail_mm,
        pouches=drawn.pouches,
    )


class DrawnTree:
    """Everything that an outline is drawn from: straight parts, pouches and build.

    It can be a cache's key: equal ones have the same outline.

    Parameters
    ----------
    tree
        The straight parts.
    pouches
        Of each part, None where it has none.
    build
        Tail and collar, and the fillets of necks.
    """

    __slots__ = ("_key", "build", "children", "lean_rad", "pouches", "tree")

    def __init__(self, tree: BranchTree, pouches: tuple[Pouch | None, ...], build: Build) -> None:
        self.tree, self.pouches, self.build = tree, pouches, build
        half, far = tree.width_mm / 2, tree.end_width_mm / 2
        columns = (column.tolist() for column in (half, far, tree.length_mm))
        self.lean_rad = [taper_rad(*row) for row in zip(*columns, strict=True)]
        self.children: list[list[int]] = [[] for _ in range(len(tree))]
        for row, parent in enumerate(tree.parent.tolist()):
            if parent >= 0:
                self.children[parent].append(row)
        self._key = (tree.key, pouches, build)

    @classmethod
    def of(cls, design: Design) -> "DrawnTree":
        """Return the part of a design that its outline is drawn from."""
        tree = design.tree.straight
        ends = zip(tree.branch.tolist(), tree.is_leaf.tolist(), strict=True)
        own = design.pouches
        return cls(
            tree, tuple(own[branch] if leaf else None for branch, leaf in ends), design.build
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DrawnTree) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def leaf(self, row: int) -> Leaf:
        """Return the end of a leaf."""
        tree = self.tree
        return Leaf(
            half_mm=float(tree.end_width_mm[row]) / 2,
            lean_rad=self.lean_rad[row],
            fillet_mm=level_fillets_mm(self.build)[int(tree.level[row]) - 1],
        )

    @property
    def is_elbow(self) -> list[bool]:
        """Whether each part continues as one of its width, behind a bend or as its only child."""
        width, far = self.tree.width_mm.tolist(), self.tree.end_width_mm.tolist()
        return [
            len(below) == 1 and width[below[0]] == far[row]
            for row, below in enumerate(self.children)
        ]

    def joints(self) -> list[list[tuple[JointPlan, list[int]]]]:
        """Return every family of joints: its kinds, and the parts at whose ends each is.

        Joints with the same children below tubes of one width are alike: the shortest of these
        tubes caps the fillets of all. They differ only by the lean of the parent's sides.
        """
        tree, elbow = self.tree, self.is_elbow
        width, far = tree.width_mm.tolist(), tree.end_width_mm.tolist()
        length, angle = tree.length_mm.tolist(), tree.offset_rad.tolist()
        fillet, level = tree.fillet_mm.tolist(), tree.level.tolist()
        alike: dict[tuple[Any, ...], list[int]] = {}
        for row, children in enumerate(self.children):
            if children:
                sides = tuple(
                    PlannedSide(
                        half_mm=width[child] / 2,
                        length_mm=length[child],
                        lean_rad=self.lean_rad[child],
                        angle_rad=angle[child],
                        fillet_mm=fillet[child],
                    )
                    for child in children
                )
                key = level[row], far[row], sides, elbow[row]
                alike.setdefault(key, []).append(row)
        found = []
        for (_, end_mm, sides, is_bend), rows in alike.items():
            shortest_mm = min(length[row] for row in rows)
            leans: dict[float, list[int]] = {}
            for row in rows:
                leans.setdefault(self.lean_rad[row], []).append(row)
            family = []
            for lean, own in leans.items():
                parent = PlannedSide(half_mm=end_mm / 2, length_mm=shortest_mm, lean_rad=lean)
                family.append((JointPlan(parent=parent, children=sides, is_bend=is_bend), own))
            found.append(family)
        return found


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

    MOUTH = "mouth"
    """The sides of the tail do not leave its mouth squarely."""

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
    sentence: str  # the problem and its remedy, with ``{names}`` in place of the branches

    @property
    def message(self) -> str:
        """The problem and its remedy as one sentence, branches by their ids."""
        return self.words(self.branches)

    def words(self, names: Sequence[str]) -> str:
        """Return the sentence with other names for the branches."""
        return self.sentence.format(names=" and ".join(names))


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnJoint:
    """One kind of joint, and where it is."""

    joint: Joint
    plan: JointPlan
    rows: tuple[int, ...]  # the parts at whose ends it is, rising


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlineParts:
    """The pieces that an outline is put together from."""

    offset_mm: float  # how far outside the lumen's edge they run
    tail: Tail  # from the mouth to the trunk's base
    # The joints that differ by the taper of their parents' sides only, together, in the order of
    # the first part that ends there.
    families: tuple[tuple[DrawnJoint, ...], ...]
    ends: tuple[Joint | TipStroke, ...]  # at the end of each part
    bases_mm: tuple[Point, ...]  # lengths of each part's right and left side that its base takes
    number: tuple[int, ...]  # of each part among its parent's children, from 1

    def used_mm(self, row: int) -> tuple[Point, Point]:
        """Return the lengths of a part's right and left side that its base and its end take.

        At the base that is the largest of its family of joints.
        """
        base, end = self.bases_mm[row], self.ends[row]
        if isinstance(end, TipStroke):
            return base, (end.used_mm, end.used_mm)
        return base, (end.gaps[0].first_used_mm, end.gaps[-1].second_used_mm)


def outline_parts(design: Design, offset_mm: float, least_fillet_mm: float = 0.0) -> OutlineParts:
    """Return the pieces of a design's outline at an offset; smaller fillets there are corners."""
    return _outline_parts(DrawnTree.of(design), offset_mm, least_fillet_mm)


@lru_cache(maxsize=16)
def _outline_parts(drawn: DrawnTree, offset_mm: float, least_fillet_mm: float) -> OutlineParts:
    # Whatever looks at a robot asks for the same few patterns: of its lumen and of its paths.
    number = [0] * len(drawn.tree)
    for children in drawn.children:
        for place, child in enumerate(children, start=1):
            number[child] = place
    families = tuple(
        tuple(
            DrawnJoint(
                joint=joint_of(plan, offset_mm, least_fillet_mm=least_fillet_mm),
                plan=plan,
                rows=tuple(rows),
            )
            for plan, rows in family
        )
        for family in drawn.joints()
    )
    at = {row: one.joint for family in families for one in family for row in one.rows}
    bases_mm = [(0.0, 0.0)] * len(drawn.tree)
    for family in families:
        gaps = [one.joint.gaps for one in family]
        taken = [
            (
                max(one[n].second_used_mm for one in gaps),
                max(one[n + 1].first_used_mm for one in gaps),
            )
            for n in range(len(gaps[0]) - 1)
        ]
        for row in (row for one in family for row in one.rows):
            for child, used_mm in zip(drawn.children[row], taken, strict=True):
                bases_mm[child] = used_mm
    return OutlineParts(
        offset_mm=offset_mm,
        tail=tail_of(drawn.build, drawn.lean_rad[0], offset_mm),
        families=families,
        ends=tuple(
            at[row]
            if children
            else tip_of(drawn.leaf(row), drawn.pouches[row], offset_mm, least_fillet_mm)
            for row, children in enumerate(drawn.children)
        ),
        bases_mm=tuple(bases_mm),
        number=tuple(number),
    )


LEAST_STEP_MM = 0.1
"""A child must be narrower than its parent, and a pouch wider than its branch, by this much."""

LEAST_COLLAR_RADIUS_MM = 1.0
"""The arcs that lead from a collar to the trunk's width keep at least this radius (assumed)."""


class _Places:
    """Where the pieces of a pattern first occur: branch ids and coordinates."""

    def __init__(self, layout: FlatLayout) -> None:
        self.layout = layout
        self.ids = layout.tree.ids

    def problem(
        self,
        kind: ProblemKind,
        rows: Sequence[int],
        branches: Sequence[int],
        found: tuple[float, float],
    ) -> OutlineProblem:
        """Return a problem that occurs at the end of some parts; the first of them is named."""
        x, y = self.layout.end_mm[rows[0]].tolist()
        names = tuple(self.ids[branch] for branch in branches)
        sentence = _MESSAGES[kind].format(names="{names}", found=found[0], limit=found[1])
        return OutlineProblem(
            kind=kind,
            branches=names,
            x_mm=x,
            y_mm=y,
            count=len(rows),
            measured_mm=min(max(found[0], -LARGEST_MM), LARGEST_MM),
            limit_mm=found[1],
            sentence=sentence
            if len(rows) == 1
            else f"{sentence} It is so at {counted(len(rows), 'place')} alike.",
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
    ProblemKind.MOUTH: (
        "The sides of the tail of {names} run along its mouth, which is cut straight across from "
        "corner to corner: let the tail end square."
    ),
    ProblemKind.SHORT_SEGMENT: (
        "Near {names} the outline has a detail of {found:.2g} mm, too short to draw exactly "
        "({limit:.2g} mm): change the fillet radius or the angle a little."
    ),
}


def parts_problems(
    drawn: DrawnTree, layout: FlatLayout, pattern: OutlineParts
) -> tuple[OutlineProblem, ...]:
    """Return the misfits between the pieces of an outline, in the order of the branches."""
    places = _Places(layout)
    found = [*_widths(drawn, places, pattern)]
    # Joints that differ only by the taper of their parents' sides share one problem.
    for family in pattern.families:
        rows = sorted(row for one in family for row in one.rows)
        for number in range(len(family[0].joint.gaps)):
            for one in family:
                joint, gap = one.joint, one.joint.gaps[number]
                if joint.allowed_mm[number] < 0.0:
                    halves = (side.half_mm - pattern.offset_mm for side in (gap.first, gap.second))
                    limit = allowed_reach_mm(gap.first, gap.second, joint.disc_mm)
                    figures = crotch_reach_mm(gap.angle_rad, *halves), limit
                    kind = ProblemKind.NARROW_CROTCH
                elif gap.error_mm > WORST_ERROR_MM and min(joint.allowed_mm) >= 0.0:
                    kind, figures = ProblemKind.SHORT_SEGMENT, (gap.error_mm, WORST_ERROR_MM)
                else:
                    continue
                owners = [rows[0], *drawn.children[rows[0]]]
                names = [owners[side.owner] for side in (gap.first, gap.second)]
                found.append(places.problem(kind, rows, names, figures))
                break
    return (*found, *_tail(drawn, places, pattern), *_rooms(drawn, places, pattern))


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
    row = layout.tree.ids.index(shortest.branch)
    found = (shortest.length_mm, LEAST_SEGMENT_MM)
    return (_Places(layout).problem(ProblemKind.SHORT_SEGMENT, [row], [row], found),)


def _widths(drawn: DrawnTree, places: _Places, pattern: OutlineParts) -> Iterator[OutlineProblem]:
    """Check the widths of parts, and of their pouches, each kind once."""
    tree, offset_mm = drawn.tree, pattern.offset_mm
    begins, ends, level = tree.width_mm.tolist(), tree.end_width_mm.tolist(), tree.level.tolist()
    parent, elbow = tree.parent.tolist(), drawn.is_elbow
    alike: dict[tuple[Any, ...], list[int]] = {}
    for row, above in enumerate(parent):
        wide = math.inf if above < 0 or elbow[above] else ends[above]
        kind = level[row], wide, begins[row], ends[row], drawn.pouches[row]
        alike.setdefault(kind, []).append(row)
    for (_, wide, begin, end, pouch), rows in alike.items():
        row = rows[0]
        if end / 2 + offset_mm < LEAST_SEGMENT_MM:
            found = (end / 2 + offset_mm, LEAST_SEGMENT_MM)
            yield places.problem(ProblemKind.VANISHED, rows, [row], found)
        if begin > wide - LEAST_STEP_MM:
            above = sorted({parent[one] for one in rows})
            found = (begin, wide - LEAST_STEP_MM)
            yield places.problem(ProblemKind.CHILD_WIDTH, above, [above[0], row], found)
        limit = end + LEAST_STEP_MM
        if pouch is not None and pouch.flat_width_mm < limit:
            found = (pouch.flat_width_mm, limit)
            yield places.problem(ProblemKind.POUCH_WIDTH, rows, [row], found)
        elif pouch is not None:
            least = min(least_convex_radius_mm(drawn.leaf(one), pouch) for one in rows)
            if least + offset_mm < 0.0:
                yield places.problem(ProblemKind.VANISHED, rows, [row], (least + offset_mm, 0.0))


def _tail(drawn: DrawnTree, places: _Places, pattern: OutlineParts) -> Iterator[OutlineProblem]:
    """Check the mouth; that a collar leaves some straight tail and its arcs are large enough."""
    collar, tail = drawn.build.collar, pattern.tail
    if not tail.is_square:
        yield places.problem(ProblemKind.MOUTH, [0], [0], (0.0, LEAST_SEGMENT_MM))
    if collar is None:
        return
    room = tail.bend.start_mm[0] - tail.even_mm
    if room < LEAST_SEGMENT_MM:
        yield places.problem(ProblemKind.COLLAR, [0], [0], (room, LEAST_SEGMENT_MM))
    rise = abs(collar.flat_width_mm - drawn.build.widths_mm[0]) / 2
    # Arcs that turn by more than a right angle run back; a radius r takes a flare of
    # sqrt((4 r - rise) rise).
    radius = LEAST_COLLAR_RADIUS_MM + abs(pattern.offset_mm)
    least = max(rise, math.sqrt(max(0.0, (4.0 * radius - rise) * rise)))
    if collar.flare_mm < least:
        yield places.problem(ProblemKind.COLLAR_FLARE, [0], [0], (collar.flare_mm, least))
    half = -tail.collar.start_mm[1]
    if half < LEAST_SEGMENT_MM:
        yield places.problem(ProblemKind.VANISHED, [0], [0], (half, LEAST_SEGMENT_MM))


def _rooms(drawn: DrawnTree, places: _Places, pattern: OutlineParts) -> Iterator[OutlineProblem]:
    """Check the straight side that is left between the two ends of every kind of part."""
    tree = drawn.tree
    columns = (tree.width_mm, tree.end_width_mm, tree.length_mm, tree.level)
    sizes = zip(*(column.tolist() for column in columns), drawn.lean_rad, strict=True)
    alike: dict[tuple[Any, ...], list[int]] = {}
    for row, (width, end_width, length, level, lean) in enumerate(sizes):
        least = (width - end_width) / 2.0 / STEEPEST
        # Where the larger disc hides the smaller one: by how much the part is too short.
        side = length - least if length < least else length * math.cos(lean)
        if row == 0 and not lean:  # that of a tapered trunk ends where the tail's begins
            side -= pattern.tail.even_mm
        base, end = pattern.used_mm(row)
        room = side - max(base[0] + end[0], base[1] + end[1])
        if room < LEAST_SEGMENT_MM:
            alike.setdefault((level, length, pattern.number[row], room), []).append(row)
    for (*_, room), rows in alike.items():
        yield places.problem(ProblemKind.NO_ROOM, rows, rows[:1], (room, LEAST_SEGMENT_MM))


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
    return made(DrawnTree.of(design), offset_mm, least_fillet_mm, ends)


_MOST_KEPT = 200
"""Outlines of more branches are not kept: they take much memory."""


def _outline(
    drawn: DrawnTree, offset_mm: float, least_fillet_mm: float, ends: PieceEnds
) -> BodyOutline:
    layout = _layout(drawn)
    pattern = _outline_parts(drawn, offset_mm, least_fillet_mm)
    problems = parts_problems(drawn, layout, pattern)
    if any(problem.kind is ProblemKind.VANISHED for problem in problems):
        pattern = _outline_parts(drawn, 0.0, 0.0)
    contour = _Walk(layout, drawn, pattern, ends).contour()
    return BodyOutline(
        contour=contour, problems=problems or drawing_problems(layout, pattern, contour)
    )


# The search for pieces, the rules and the job of the laser ask for the same outlines in turn.
_kept_outline = lru_cache(maxsize=32)(_outline)


class _Walk:
    """One walk around a tree, which draws one contour."""

    def __init__(
        self, layout: FlatLayout, drawn: DrawnTree, pattern: OutlineParts, piece: PieceEnds
    ) -> None:
        self.layout, self.pattern, self.piece = layout, pattern, piece
        self.stubs = dict(piece.stubs)
        self.ids, self.children = layout.tree.ids, drawn.children
        self.lean_rad = drawn.lean_rad
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
        half, offset = float(self.layout.width_mm[branch]) / 2, self.pattern.offset_mm
        side = BranchSide(half_mm=half + offset, lean_rad=self.lean_rad[branch])
        return side.end_mm(end, offset)

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
        joint = self.pattern.ends[branch]
        if isinstance(joint, TipStroke):
            self._side(placed(joint.run.start_mm, self.ends[branch]), branch)
            self.pen.pieces(joint.run, self.ends[branch], (self.ids[branch],))
            return
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
