"""The ends of an outline: the tail with its collar and mouth, rounded tips and pouches.

The tail is in the coordinates of the flat layout: the trunk's base is the origin and the tail lies
along -x. Only its right side is computed; the left one mirrors it.

In the frame of a tip, the origin is the end of the branch's planned length and +x is the branch's
heading. Rounded tips and pouches are centred on the origin: half of a pouch's length lies beyond
the planned length.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

from vinefab.model.design import Build, Pouch
from vinefab.model.outline import Part
from vinefab.model.tree import default_fillet_mm
from vinefab.outline.joint import (
    LEAST_CUT_MM,
    LEAST_SEGMENT_MM,
    WORST_ERROR_MM,
    Point,
    StrokeRun,
    StrokeSegment,
    arc,
    neck,
    neck_length_mm,
    polar,
    turned,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tail:
    """The right side of a tail.

    It leaves the mouth squarely, which `vinefab.fabrication.job.passes` relies on: the mouth is cut
    straight across, past both corners, and VF-L02 lets that cut cross the seam near them alone.
    """

    # From the right corner of the mouth to where the tail is as wide as the trunk.
    collar: StrokeRun
    even_mm: float  # x where that is; beyond the trunk's base only if the collar is too long
    # From the end of the tail's side, at the trunk's base, to where a tapered trunk's side begins.
    bend: StrokeRun

    @property
    def is_square(self) -> bool:
        """Whether it leaves the mouth along the axis."""
        if not self.collar.pieces:
            return True
        first, (x, y) = self.collar.pieces[0], self.collar.start_mm
        chord_rad = math.atan2(first.end_mm[1] - y, first.end_mm[0] - x)
        return abs(chord_rad - 2.0 * math.atan(first.bulge)) < 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenEnd:
    """An open end of a piece: a plug or, widened, a socket; distances are along its branch."""

    rim_mm: float  # where its mouth is
    blend_mm: Point = (0.0, 0.0)  # of a socket: where it begins to narrow, and is done with it
    rise_mm: float = 0.0  # how far its edge lies outside the branch's, on each side


@dataclass(frozen=True, slots=True, kw_only=True)
class BranchSide:
    """The straight right side of a branch; its frame begins where the branch does.

    A tapered branch's sides lean towards its axis. What is drawn along a side is worked out in a
    frame turned by that lean, in which the side is level.
    """

    half_mm: float  # how far the side lies from the axis, where a level side would begin
    lean_rad: float

    def point_mm(self, along_mm: float, rise_mm: float = 0.0) -> Point:
        """Return the point of the side, or of one that lies farther out, at a place on the axis."""
        half = self.half_mm + rise_mm
        level = (along_mm - half * math.sin(self.lean_rad)) / math.cos(self.lean_rad)
        return turned((level, -half), self.lean_rad)

    def end_mm(self, end: OpenEnd, offset_mm: float) -> StrokeRun:
        """Return the right side of an open end, from its mouth to the branch's own side.

        The mouth is nearer to the branch's beginning at a piece's base, and farther on a stub.
        """
        start = self.point_mm(end.rim_mm, end.rise_mm)
        if not end.rise_mm:
            return StrokeRun(start)
        bend = self.point_mm(end.blend_mm[0], end.rise_mm)
        x, y = turned(bend, -self.lean_rad)
        flare = (end.blend_mm[1] - end.blend_mm[0]) / math.cos(self.lean_rad)
        way = math.copysign(1.0, flare)
        placed = [
            StrokeSegment(
                turned((x + way * piece.end_mm[0], y + piece.end_mm[1]), self.lean_rad),
                way * piece.bulge,
                piece.part,
            )
            for piece in transition(abs(flare), (0.0, end.rise_mm), offset_mm, Part.SOCKET)
        ]
        return StrokeRun(start, (StrokeSegment(bend, 0.0, Part.SOCKET), *placed))


def tail_of(build: Build, lean_rad: float, offset_mm: float) -> Tail:
    """Return the tail of a build, below a trunk whose sides lean by an angle."""
    mouth, half, lean = -build.tail_mm, build.widths_mm[0] / 2 + offset_mm, lean_rad
    # Where the trunk tapers, an arc leads from the tail's side to its own. One too short for a
    # laser is drawn as the corner of the two sides, outside it by r (1 / cos(t / 2) - 1), as long
    # as that is nothing: for a length r t of 0.2 mm at most 0.002 mm where the trunk is 5 mm wide
    # or wider.
    length, lost = half * lean, half * (1.0 / math.cos(lean / 2) - 1.0)
    if length < LEAST_SEGMENT_MM or (length < LEAST_CUT_MM and lost <= WORST_ERROR_MM):
        bend = StrokeRun((half * math.tan(lean / 2), -half))
    else:
        arc_ = StrokeSegment(turned((0.0, -half), lean), math.tan(lean / 4), Part.JOINT)
        bend = StrokeRun((0.0, -half), (arc_,))
    collar = build.collar
    if collar is None:
        return Tail(collar=StrokeRun((mouth, -half)), even_mm=mouth, bend=bend)
    wide = collar.flat_width_mm / 2 + offset_mm
    # A straight piece too short to draw is left out.
    start = mouth + (collar.length_mm if collar.length_mm >= LEAST_SEGMENT_MM else 0.0)
    pieces = transition(collar.flare_mm, (start, wide - half), offset_mm)
    straight = [StrokeSegment((start, -wide), 0.0, Part.TAIL)] if start > mouth else []
    shifted = [StrokeSegment((p.end_mm[0], p.end_mm[1] - wide), p.bulge, p.part) for p in pieces]
    run = StrokeRun((mouth, -wide), (*straight, *shifted))
    return Tail(collar=run, even_mm=start + collar.flare_mm, bend=bend)


def transition(
    flare_mm: float,
    start_and_rise_mm: Point,
    offset_mm: float,
    part: Part = Part.COLLAR,
) -> list[StrokeSegment]:
    """Return two arcs that rise from a wider straight side to a narrower one.

    Arcs of one radius r that both turn by t rise 2 r (1 - cos t) over 2 r sin t. An offset keeps
    centres and turns, makes the one that bulges outward larger and the other one smaller.
    """
    start, rise = start_and_rise_mm
    if abs(rise) < 1e-9:
        return []
    turn = 2.0 * math.atan(rise / flare_mm)
    radius = flare_mm / (2.0 * math.sin(abs(turn)))
    outward, inward = radius + offset_mm, radius - offset_mm
    # A mouth wider than the trunk: its side first turns in, around the body's own side.
    first = outward if rise > 0.0 else inward
    middle = start + first * math.sin(abs(turn))
    risen = math.copysign(first * (1.0 - math.cos(turn)), rise)
    bulge = math.tan(turn / 4.0)
    return [
        StrokeSegment((middle, risen), bulge, part),
        StrokeSegment((start + flare_mm, rise), -bulge, part),
    ]


def level_fillets_mm(build: Build) -> tuple[float, ...]:
    """Return the designed fillet radius of every level, the trunk's default first."""
    return (default_fillet_mm(build.widths_mm[0]), *build.fillet_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaf:
    """The end of a leaf, as its pouch sees it."""

    half_mm: float  # distance of its sides from its end
    lean_rad: float  # angle by which they lean towards its axis
    fillet_mm: float  # fillet radius of the neck

    @property
    def rise(self) -> float:
        """How far a fillet between side and shoulder reaches along the shoulder, over its radius.

        1 at a right angle.
        """
        return math.tan(math.pi / 4 + self.lean_rad / 2)

    def half_at_mm(self, x_mm: float) -> float:
        """Return the distance of a side from the axis at a place along it; 0 is the end."""
        return (self.half_mm - x_mm * math.sin(self.lean_rad)) / math.cos(self.lean_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class TipStroke:
    """The outline at the end of a leaf."""

    run: StrokeRun  # from the branch's right side to its left side
    used_mm: float  # how far before the end of the branch its straight sides end


@lru_cache(maxsize=4096)
def tip_of(
    leaf: Leaf, pouch: Pouch | None, offset_mm: float, least_fillet_mm: float = 0.0
) -> TipStroke:
    """Return the far end of a leaf; smaller fillets at a pouch's neck are corners."""
    # A pouch no wider than its branch is a named problem; the bare tip is what can be drawn.
    if pouch is None or pouch.flat_width_mm <= 2.0 * leaf.half_mm:
        return round_tip(leaf.half_mm + offset_mm, leaf.lean_rad)
    return pouch_tip(pouch, leaf, offset_mm, least_fillet_mm)


def round_tip(half_mm: float, lean_rad: float = 0.0) -> TipStroke:
    """Return the round end of a branch of half width ``half_mm``, tangent to its sides."""
    start = turned((0.0, -half_mm), lean_rad)
    pieces = arc((0.0, 0.0), start, math.pi - 2.0 * lean_rad, Part.TIP)
    return TipStroke(run=StrokeRun(start, tuple(pieces)), used_mm=0.0)


def pouch_tip(
    pouch: Pouch, leaf: Leaf, offset_mm: float, least_fillet_mm: float = 0.0
) -> TipStroke:
    """Return a pouch on the end of a branch."""
    round_pouch, lean = pouch.shape == "round", leaf.lean_rad
    fillet = leaf.fillet_mm if round_pouch else corner_radii_mm(pouch, leaf)[0]
    fillet = max(0.0, fillet - offset_mm)
    drawn = Leaf(
        half_mm=leaf.half_mm + offset_mm,
        lean_rad=lean,
        fillet_mm=fillet if fillet >= least_fillet_mm else 0.0,
    )
    if round_pouch:
        pouch_mm = (pouch.radius_mm or 0.0) + offset_mm
        found = neck(drawn.half_mm, pouch_mm, drawn.fillet_mm)
        start = turned((-found.used_mm, -drawn.half_mm), lean)
        enter = polar(pouch_mm, found.angle_rad - math.pi + lean)
        right = []
        if found.radius_mm * found.turn_rad != 0.0:
            right = [StrokeSegment(enter, -math.tan(found.turn_rad / 4.0), Part.FILLET)]
        turn = 2.0 * (math.pi - found.angle_rad - lean)
        middle = arc((0.0, 0.0), enter, turn, Part.POUCH)
    else:
        front = (pouch.length_mm or 0.0) / 2 + offset_mm
        side = (pouch.width_mm or 0.0) / 2 + offset_mm
        # Inward beyond its radius, a rounded corner becomes a sharp one.
        radius = max(0.0, corner_radii_mm(pouch, leaf)[1] + offset_mm)
        axis = (radius - front, radius - side)
        right, start = _shoulder(drawn, axis, radius)
        right += [StrokeSegment((-axis[0], -side), 0.0, Part.POUCH)]
        right += arc((-axis[0], axis[1]), (-axis[0], -side), math.pi / 2, Part.POUCH)
        middle = [StrokeSegment((-axis[0] + radius, -axis[1]), 0.0, Part.POUCH)]
    # The left side mirrors the right one about the branch's axis.
    left = StrokeRun(start, tuple(right)).mirrored().reversed().pieces
    return TipStroke(
        run=StrokeRun(start, (*right, *middle, *left)), used_mm=-turned(start, -lean)[0]
    )


def corner_radii_mm(pouch: Pouch, leaf: Leaf) -> Point:
    """Return neck fillet and corner radius of a rectangular pouch's lumen.

    The shoulder between branch and pouch is shared: the neck gets its designed radius but at most
    half the shoulder, the corner the same radius as long as a quarter of the pouch's length and
    the rest of the shoulder allow.
    """
    length, width = pouch.length_mm or 0.0, pouch.width_mm or 0.0
    shoulder = width / 2 - leaf.half_at_mm(-length / 2)
    inner = min(leaf.fillet_mm, shoulder / 2 / leaf.rise)
    wanted = leaf.fillet_mm if leaf.fillet_mm > 0.0 else shoulder / 2
    outer = min(wanted, shoulder - leaf.rise * inner, length / 4)
    # Between the two the shoulder is straight for at least the shortest segment, or not at all.
    straight = shoulder - leaf.rise * inner - outer
    if 1e-9 < straight < LEAST_SEGMENT_MM:
        grows = outer + straight <= length / 4
        outer += straight if grows else straight - LEAST_SEGMENT_MM
    return inner, outer


def least_convex_radius_mm(leaf: Leaf, pouch: Pouch | None) -> float:
    """Return the smallest convex radius at a leaf's tip on the lumen: of its pouch, or the tip."""
    if pouch is None:
        return leaf.half_mm
    if pouch.shape == "round":
        return pouch.flat_width_mm / 2
    return corner_radii_mm(pouch, leaf)[1]


def _shoulder(leaf: Leaf, axis: Point, radius_mm: float) -> tuple[list[StrokeSegment], Point]:
    """Return the pieces from the branch's side around the back corner, and their start."""
    back, lean, fillet = axis[0] - radius_mm, leaf.lean_rad, leaf.fillet_mm
    ball = back - fillet, -leaf.half_at_mm(back) - leaf.rise * fillet
    if axis[1] - ball[1] > 1e-9:
        # The fillet is gone and the branch's side has risen past the start of the corner's arc.
        x, y = turned(axis, -lean)
        along = math.sqrt(max(0.0, radius_mm**2 - (leaf.half_mm + y) ** 2))
        start = turned((x - along, -leaf.half_mm), lean)
        turn = math.acos(max(-1.0, min(1.0, (axis[1] - start[1]) / max(radius_mm, 1e-12))))
        return arc(axis, start, turn, Part.POUCH), start
    out = turned((0.0, 1.0), lean)
    start = ball[0] + fillet * out[0], ball[1] + fillet * out[1]
    pieces: list[StrokeSegment] = []
    if fillet > 0.0:
        turn = math.pi / 2 + lean
        pieces += [StrokeSegment((back, ball[1]), -math.tan(turn / 4), Part.FILLET)]
    pieces += [StrokeSegment((back, axis[1]), 0.0, Part.POUCH)]
    return [*pieces, *arc(axis, (back, axis[1]), math.pi / 2, Part.POUCH)], start


def pouch_takes_mm(leaf: Leaf, pouch: Pouch | None, offset_mm: float = 0.0) -> float:
    """Return the length of a leaf that its pouch takes, before the end of its planned length.

    Parameters
    ----------
    offset_mm
        How far outside the lumen's edge.
    """
    half_mm, radius_mm = leaf.half_mm, max(0.0, leaf.fillet_mm - offset_mm)
    if pouch is None or pouch.flat_width_mm <= 2.0 * half_mm:
        return 0.0
    if pouch.shape == "round":
        return neck_length_mm(half_mm + offset_mm, (pouch.radius_mm or 0.0) + offset_mm, radius_mm)
    return (pouch.length_mm or 0.0) / 2.0 + offset_mm + radius_mm


def usual_leaf(build: Build) -> Leaf:
    """Return the end of an even leaf of a build's last level."""
    return Leaf(
        half_mm=build.end_widths_mm[-1] / 2.0, lean_rad=0.0, fillet_mm=level_fillets_mm(build)[-1]
    )
