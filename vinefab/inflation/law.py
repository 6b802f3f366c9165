"""The law of flat fans: the pattern of a design in a few microseconds, without a simulation.

A search asks for the patterns of thousands of designs a second. The joints of a level differ only
in their fan and number of children, so that one short table for each of these numbers tells all.
What is cut is simulated: `vinefab.inflation.pattern`.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vinefab.core.validation import Floats
from vinefab.inflation.pattern import strain_at, stretch_at
from vinefab.inflation.table import CHILDREN, FILLET, RATIO, STRAIN, fan_table, flat_fan, scaled
from vinefab.model.design import Build, Design, Trunk, UnevenLevel
from vinefab.model.laser import Material
from vinefab.model.tree import child_lengths_mm

FANS = 361
"""Deployed fans that a law has rows for, a degree apart from 0 on."""

MOST_CHILDREN = 8
"""Fans of more children are taken as designed: joints of five say nothing about theirs."""

LEAST_LENGTH = 0.1
"""Share of its planned length that a child is always cut with, however far the law says it grows
longer: such a child lies within its joint."""

MOST_TURN_RAD = math.radians(0.8)
"""Most by which a fan's outer children are turned so that their tips come near, as in patterns."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FanLaw:
    """Flat fans of so many children at the joints of one level, by their deployed fans.

    Lengths are in widths of the parent.
    """

    angles_rad: Floats  # of each child, shape (FANS, n)
    pull_backs: Floats  # of each child, shape (FANS, n)
    side_offsets: Floats  # of the last child to its left, shape (FANS,)
    passages: Floats  # shape (FANS,)
    least_rad: float  # smallest deployed fan among the simulated ones

    @property
    def rows(self) -> Floats:
        """Everything, of at most `MOST_CHILDREN` children: angles, pull-backs, offset, passage."""
        rows = np.zeros((FANS, 2 * MOST_CHILDREN + 2))
        children = self.angles_rad.shape[1]
        rows[:, :children] = self.angles_rad
        rows[:, MOST_CHILDREN : MOST_CHILDREN + children] = self.pull_backs
        rows[:, -2], rows[:, -1] = self.side_offsets, self.passages
        return rows

    @property
    def passages_as_drawn(self) -> Floats:
        """Passages of joints that are cut as designed, by their flat fans, shape (FANS, 1)."""
        if self.angles_rad.shape[1] == 1:
            return np.full((FANS, 1), self.passages[0])
        # Nothing says that the flat fans of a law rise where they are narrow.
        drawn_rad = np.maximum.accumulate(self.angles_rad[:, -1] - self.angles_rad[:, 0])
        return np.interp(np.radians(np.arange(FANS)), drawn_rad, self.passages)[:, None]


@lru_cache(maxsize=512)
def fan_law(children: int, ratio: float, fillet: float, strain: float, gain: float) -> FanLaw:
    """Return the law of one kind of joint.

    Parameters
    ----------
    children
        From 1 to `MOST_CHILDREN`. More than five turn as five that are as far apart.
    ratio, fillet, strain
        As of `vinefab.inflation.table.flat_fan`.
    gain
        How far joints turn over the simulated, as measured; 1 without a measurement.
    """
    known = min(children, max(CHILDREN))
    whole = np.radians(np.arange(FANS, dtype=np.float64))
    # Of more children than the table has, as many as it has that are as far apart.
    fan = whole * ((known - 1) / (children - 1) if children > 1 else 0.0)
    found = flat_fan(np.array(known), fan, *map(np.array, (ratio, fillet, strain)))
    even, shares = np.linspace(-0.5, 0.5, known), np.linspace(0.0, 1.0, known)
    turned = found.angles_rad[:, :known] - fan[:, None] * even if known > 1 else np.zeros((FANS, 1))
    if gain != 1.0:
        # Film turns by so many times the simulated turn: outer children decide which fan deploys.
        deployed = fan + 2.0 * turned[:, -1] * (1.0 - gain)
        turned = np.column_stack([np.interp(fan, deployed, gain * one) for one in turned.T])
    backs = found.pull_backs[:, :known]
    if children > known:
        places = np.linspace(0.0, 1.0, children)
        turned, backs = (
            np.stack([np.interp(places, shares, row) for row in rows]) for rows in (turned, backs)
        )
    table = fan_table(known)
    place = np.clip(np.array([ratio, fillet, strain]), *np.array([RATIO, FILLET, STRAIN]).T)
    passages, least = np.ones(FANS), 0.0
    if table is not None:
        simulated = table.rows.deployed_fan_deg[table.rows.is_open]
        near = np.clip(np.degrees(fan), simulated.min(), simulated.max())
        passages = np.clip(table.figures[3](scaled(near, np.tile(place, (FANS, 1))))[:, 0], 0.1, 1)
        least = math.radians(float(simulated.min())) if known > 1 else 0.0
        least *= (children - 1) / (known - 1) if known > 1 else 0.0
    outer = np.linspace(-0.5, 0.5, children) if children > 1 else np.zeros(1)
    law = FanLaw(
        angles_rad=whole[:, None] * outer + turned,
        pull_backs=np.ascontiguousarray(backs),
        side_offsets=found.side_offsets,
        passages=passages,
        least_rad=least,
    )
    for array in (law.angles_rad, law.pull_backs, law.side_offsets, law.passages):
        array.setflags(write=False)
    return law


def level_law(build: Build, material: Material, place: int, children: int) -> FanLaw:
    """Return the law of the joints below a level, the trunk's at place 0.

    Joints that differ by a hundredth of the parent's width at most are one: angles change by a
    tenth of a degree.
    """
    width_mm = build.end_widths_mm[place]
    return fan_law(
        children,
        round(build.widths_mm[place + 1] / width_mm, 2),
        round(build.fillet_mm[place] / width_mm, 2),
        strain_at(build, material, width_mm),
        1.0 if material.closing_gain is None else material.closing_gain.value,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class QuickPattern:
    """The flat tree of a design by the law alone."""

    flat: Design
    passages: tuple[float, ...]  # of the joints below each level, the trunk's first
    # By how much deployed fans are narrower than any simulated one, relative to that; summed.
    beyond: float


def quick_pattern(design: Design, material: Material) -> QuickPattern:
    """Return about the flat tree that a design is cut as; the design itself without compensation.

    Angles are within a few degrees of those of `vinefab.inflation.pattern.pattern_of`. Only even
    fans of at most `MOST_CHILDREN` children are compensated.
    """
    build = design.build
    levels, passages, beyond = list(design.levels), list[float](), 0.0
    means_mm = [float(child_lengths_mm(level).mean()) for level in design.levels]
    for place, level in enumerate(design.levels):
        if isinstance(level, UnevenLevel) or level.branches > MOST_CHILDREN:
            passages.append(1.0)
            continue
        law = level_law(build, material, place, level.branches)
        fan_rad = level.fan_rad if level.branches > 1 else 0.0
        if build.compensation == "none":
            passages.append(float(_at(law.passages_as_drawn, fan_rad)[0]))
            continue
        width_mm = build.end_widths_mm[place]
        if fan_rad < law.least_rad:
            beyond += (law.least_rad - fan_rad) / law.least_rad
        # Children stand off their designed axes: turned a little, their tips come nearer.
        offset_mm = width_mm * float(_at(law.side_offsets, fan_rad))
        most_rad = min(MOST_TURN_RAD, fan_rad / 10.0)
        turn_rad = min(max(offset_mm / math.fsum(means_mm[place:]), -most_rad), most_rad)
        fan_rad -= 2.0 * turn_rad
        stretch = stretch_at(build, material, build.widths_mm[place + 1])
        backs_mm = width_mm * _at(law.pull_backs, fan_rad)
        planned_mm = child_lengths_mm(level)
        lengths_mm = np.maximum(planned_mm + backs_mm, LEAST_LENGTH * planned_mm) / stretch
        angles_deg = np.degrees(_at(law.angles_rad, fan_rad))
        levels[place] = UnevenLevel.of_children(angles_deg.tolist(), lengths_mm.tolist())
        passages.append(float(_at(law.passages, fan_rad)))
    if build.compensation == "none":
        return QuickPattern(flat=design, passages=tuple(passages), beyond=0.0)
    trunk_mm = design.trunk_length_mm / stretch_at(build, material, build.widths_mm[0])
    flat = design.changed(
        trunk=Trunk(length_mm=trunk_mm),
        levels=tuple(levels),
        build=build.changed(compensation="none"),
    )
    return QuickPattern(flat=flat, passages=tuple(passages), beyond=beyond)


def _at(rows: Floats, fan_rad: float) -> Floats:
    """Return the row of a deployed fan, between those of whole degrees."""
    place = min(math.degrees(fan_rad), FANS - 1.0)
    row = min(int(place), FANS - 2)
    return np.asarray(rows[row] + (place - row) * (rows[row + 1] - rows[row]))
