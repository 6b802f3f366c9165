"""The joints of a design, one for each level: all joints of a level are alike."""

import math
from dataclasses import dataclass

from vinefab.geometry.crotch import Gap, crotch_reach_mm
from vinefab.geometry.joint import joint_of, level_tapers_rad
from vinefab.model.design import Design

PARALLEL_RAD = 1e-6
"""Neighbours at a smaller angle never part."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """The joint where one level's children sprout from their parent's tip.

    Parameters
    ----------
    level
        Level of the children, 2 or more.
    joints
        How many such joints the design has.
    parent, first_child
        Indices in the tree of the first of these joints' parent and clockwise-most child.
    gaps
        The gaps around the joint on the lumen's edge, counter-clockwise, the parent's body first
        and last. An owner of 0 in a gap is the parent, 1 the first child, and so on.
    fillet_mm
        Smallest fillet radius that is drawn: the designed one, or less where the angle allows
        no more. Infinite if no gap has room for any fillet.
    """

    level: int
    joints: int
    parent: int
    first_child: int
    gaps: tuple[Gap, ...]
    fillet_mm: float

    def branch(self, owner: int) -> int:
        """Return the tree's index of a gap's owner."""
        return self.parent if owner == 0 else self.first_child + owner - 1


def joints_of(design: Design) -> tuple[Joint, ...]:
    """Return the joint of every level after the trunk."""
    found = []
    parent, count = 0, 1
    for number, level in enumerate(design.levels, start=2):
        drawn = joint_of(design, number - 1, 0.0)
        radii_mm = (min(drawn.fillet_mm, most) for most in drawn.allowed_mm if most >= 0.0)
        found.append(
            Joint(
                level=number,
                joints=count,
                parent=parent,
                first_child=parent + count,
                gaps=drawn.gaps,
                fillet_mm=min(radii_mm, default=math.inf),
            )
        )
        parent, count = parent + count, count * level.branches
    return tuple(found)


def shorter_mm(gap: Gap) -> float:
    """Return the length of the shorter neighbour that a gap's crotch webs.

    Where the outline passes the joint's disc the parent is as it should be, and only the
    children count.
    """
    lengths = [strip.length_mm for strip in (gap.first, gap.second) if strip.owner]
    disc_mm = max(gap.first.half_mm, gap.second.half_mm)
    if gap.reach_mm > disc_mm * (1.0 + 1e-9):
        lengths = [gap.first.length_mm, gap.second.length_mm]
    return min(lengths)


def share_in_crotch(gap: Gap) -> float:
    """Return the reach of a gap's crotch over the length of its shorter neighbour.

    Neighbours that never part give infinity.
    """
    return gap.reach_mm / shorter_mm(gap) if gap.angle_rad > PARALLEL_RAD else math.inf


def bare_gaps(design: Design) -> list[tuple[float, float]]:
    """Return angle and share in the crotch of every kind of gap, without working out fillets.

    Parents that taper count with the side that leans most, children that do as if they were even.

    For each level the gap beside the parent and, between children, the one between the two
    shortest neighbours, in closed form. Fillets are drawn no larger than the crotch allows, so
    these shares are above one half exactly when those of `share_in_crotch` are.

    Returns
    -------
    list of (float, float)
        Angle in radians; share as in `share_in_crotch`, for crotches without fillets.
    """
    found = []
    widths_mm, ends_mm = design.build.widths_mm, design.build.end_widths_mm
    above_mm = design.trunk_length_mm
    for number, level in enumerate(design.levels, start=1):
        wide, narrow = ends_mm[number - 1] / 2.0, widths_mm[number] / 2.0
        shortest_mm = level.length_mm * min(1.0, level.growth)
        fan = level.fan_rad if level.branches > 1 else 0.0
        disc = max(wide, narrow)
        beside = math.pi - fan / 2.0 - max(level_tapers_rad(design, number))
        reach = _bare_reach_mm(beside, (wide, narrow), disc)
        length_mm = shortest_mm if reach <= disc else min(shortest_mm, above_mm)
        found.append((beside, reach / length_mm))
        if level.branches > 1:
            between = fan / (level.branches - 1)
            found.append((between, _bare_reach_mm(between, (narrow, narrow), disc) / shortest_mm))
        above_mm = shortest_mm
    return found


def _bare_reach_mm(angle_rad: float, halves_mm: tuple[float, float], disc_mm: float) -> float:
    """Return how far from the joint two sides part: where they cross, or at the joint's disc."""
    hidden = sum(math.asin(half / disc_mm) for half in halves_mm)
    return disc_mm if hidden <= angle_rad else crotch_reach_mm(angle_rad, *halves_mm)
