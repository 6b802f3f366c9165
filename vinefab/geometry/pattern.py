"""All that repeats in an outline: a joint per level, and the tip of every leaf."""

from dataclasses import dataclass

from vinefab.geometry.joint import Joint, joint_of
from vinefab.geometry.tip import Tip, tip_of
from vinefab.model.design import Design


@dataclass(frozen=True, slots=True, kw_only=True)
class Pattern:
    """The pieces that a walk around a design is made of.

    Parameters
    ----------
    offset_mm
        How far outside the lumen's edge they run.
    mouth_half_mm
        Half the width of the tail as drawn.
    joints
        One per level that sprouts, trunk first.
    tip
        The far end of every leaf.
    """

    offset_mm: float
    mouth_half_mm: float
    joints: tuple[Joint, ...]
    tip: Tip


def pattern_of(design: Design, offset_mm: float) -> Pattern:
    """Return the pieces of a design's outline at an offset."""
    return Pattern(
        offset_mm=offset_mm,
        mouth_half_mm=design.build.widths_mm[0] / 2 + offset_mm,
        joints=tuple(joint_of(design, level, offset_mm) for level in range(1, design.depth)),
        tip=tip_of(design, offset_mm),
    )
