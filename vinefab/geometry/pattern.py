"""All that repeats in an outline: joints of each level, the tip of every leaf, and the tail."""

from dataclasses import dataclass

from vinefab.geometry.joint import Joint, joint_of, level_tapers_rad
from vinefab.geometry.tail import Tail, tail_of
from vinefab.geometry.tip import Tip, tip_of
from vinefab.model.design import Design


@dataclass(frozen=True, slots=True, kw_only=True)
class Pattern:
    """The pieces that a walk around a design is made of.

    Parameters
    ----------
    offset_mm
        How far outside the lumen's edge they run.
    tail
        From the mouth to the trunk's base.
    joints
        For each level that sprouts, trunk first: one kind of joint, or where the level tapers
        one for each child of a fan.
    tips
        The far end of every leaf: one, or one for each child of a fan.
    """

    offset_mm: float
    tail: Tail
    joints: tuple[tuple[Joint, ...], ...]
    tips: tuple[Tip, ...]

    def joint(self, level: int, sibling: int) -> Joint:
        """Return the joint at the end of a branch."""
        kinds = self.joints[level - 1]
        return kinds[sibling % len(kinds)]

    def tip(self, sibling: int) -> Tip:
        """Return the far end of a leaf."""
        return self.tips[sibling % len(self.tips)]


def pattern_of(design: Design, offset_mm: float) -> Pattern:
    """Return the pieces of a design's outline at an offset."""
    return Pattern(
        offset_mm=offset_mm,
        tail=tail_of(design, offset_mm),
        joints=tuple(
            tuple(
                joint_of(design, level, offset_mm, sibling)
                for sibling in range(_kinds(design, level))
            )
            for level in range(1, design.depth)
        ),
        tips=tuple(
            tip_of(design, offset_mm, lean)
            for lean in level_tapers_rad(design, design.depth)[: _kinds(design, design.depth)]
        ),
    )


def _kinds(design: Design, level: int) -> int:
    """Return how many kinds of ends the branches of a level have: one where all are even."""
    leans = level_tapers_rad(design, level)
    return 1 if len(set(leans)) == 1 else len(leans)
