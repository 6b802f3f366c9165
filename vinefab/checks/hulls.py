"""The free distance between hulls of two discs each: tapered branches."""

import math
from dataclasses import dataclass

import numpy as np

from vinefab.model.checked import Floats

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_STEPS = 48
"""Each makes the search interval shorter by the golden ratio: 1e-10 of a branch is left."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hulls:
    """Hulls of two discs, k of them.

    Parameters
    ----------
    start_mm
        Centre of the first disc, shape (k, 2).
    run_mm
        From there to the centre of the second, shape (k, 2).
    half_mm
        Radius of the first, shape (k,).
    growth_mm
        Radius of the second less that of the first, shape (k,).
    """

    start_mm: Floats
    run_mm: Floats
    half_mm: Floats
    growth_mm: Floats

    def place_mm(self, along: Floats) -> Floats:
        """Return places on the axes, 0 at the first disc and 1 at the second, shape (k, 2)."""
        return self.start_mm + along[:, None] * self.run_mm


def hull_gap_mm(one: Hulls, two: Hulls) -> Floats:
    """Return the free distance between pairs of hulls, shape (k,); negative where they overlap.

    Parameters
    ----------
    one, two
        As many of each.
    """
    low, high = np.zeros(len(one.half_mm)), np.ones(len(one.half_mm))
    for _ in range(_STEPS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        lower = _at_mm(one, two, left) <= _at_mm(one, two, right)
        low, high = np.where(lower, low, left), np.where(lower, right, high)
    ends = _at_mm(one, two, np.zeros(len(low))), _at_mm(one, two, np.ones(len(low)))
    return np.minimum(_at_mm(one, two, (low + high) / 2.0), np.minimum(*ends))


def _at_mm(one: Hulls, two: Hulls, along: Floats) -> Floats:
    """Return the least distance from one disc of the first hull to the second hull."""
    radius = one.half_mm + along * one.growth_mm
    return point_gap_mm(one.place_mm(along), two) - radius


def point_gap_mm(points_mm: Floats, hulls: Hulls) -> Floats:
    """Return the distance of points from hulls, one each, negative inside; shape (k,).

    The distance to the disc at place t of the axis, |p - c(t)| - r(t), is least where the line to
    the point stands on the hull's side: the foot of the perpendicular, moved towards the larger
    disc by the lean of the side.
    """
    length = np.maximum(np.hypot(*hulls.run_mm.T), 1e-12)
    unit = hulls.run_mm / length[:, None]
    away = points_mm - hulls.start_mm
    foot = (away * unit).sum(axis=1)
    across = np.abs(away[:, 0] * unit[:, 1] - away[:, 1] * unit[:, 0])
    lean = np.clip(hulls.growth_mm / length, -0.99, 0.99)
    place = foot + across * lean / np.sqrt(1.0 - lean**2)
    along = np.clip(place / length, 0.0, 1.0)
    centre = hulls.place_mm(along)
    gap: Floats = np.hypot(*(points_mm - centre).T) - hulls.half_mm - along * hulls.growth_mm
    return gap
