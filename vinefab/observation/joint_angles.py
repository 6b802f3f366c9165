"""The deployed angle of a joint coupon on a photo, from the centre lines of its tubes."""

import math

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.observation.centre_lines import TracedTree

_TRUNK, _CHILD = (0.1, 0.7), (0.5, 0.92)
"""Stretch of a line that counts: away from the joint, where film is wider than a tube, and tip."""

_LEAST_POINTS = 3


def joint_angle_deg(traced: TracedTree) -> float:
    """Return the angle between the axes of a pair, or from a trunk to its only child.

    It is the reading ``joint_angle`` of a table of coupon results.

    Raises
    ------
    BadInputError
        If the design is not a trunk with one or two children, or one of them was not seen.
    """
    count = len(traced.branches)
    if count not in (2, 3):
        allowed = "a trunk with one or two children"
        raise BadInputError("design", counted(count, "branch"), allowed)
    ends = [traced.branches[0], traced.branches[-1]] if count == 2 else traced.branches[1:]
    one, other = (
        _heading_rad(branch.points_mm, _TRUNK if branch is traced.branches[0] else _CHILD)
        for branch in ends
    )
    return abs(math.degrees(math.remainder(other - one, math.tau)))


def _heading_rad(line_mm: Floats, stretch: tuple[float, float]) -> float:
    """Return the direction of the straight line through a stretch of a centre line."""
    first, last = (round(share * len(line_mm)) for share in stretch)
    if last - first < _LEAST_POINTS:
        raise BadInputError("film", "a branch that is not seen", "a photo of the whole coupon")
    points = line_mm[first:last]
    along = np.linalg.svd(points - points.mean(axis=0))[2][0]
    along = along * np.sign(along @ (points[-1] - points[0]))
    return math.atan2(along[1], along[0])
