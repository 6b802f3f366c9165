"""Broken slabs: their shapes, how far one goes until it meets another, and when they are near."""

import math
from dataclasses import dataclass

import numpy as np

from vinefab.model.checked import Floats

_TAPER = 0.2
_DEEPEST = 0.35


@dataclass(frozen=True, slots=True, kw_only=True)
class SlabKind:
    """How slabs look.

    Parameters
    ----------
    thickness
        Smallest and largest thickness, as a share of the length; at most 0.8.
    direction_rad, direction_spread_rad
        Slabs lie along the first, counter-clockwise from +x, give or take up to the second.
    raggedness
        0: straight ends; 1: ends broken off at a slant, by a third of the thickness.
    """

    thickness: tuple[float, float]
    direction_rad: float
    direction_spread_rad: float
    raggedness: float


def power_law(rng: np.random.Generator, limits: tuple[float, float], exponent: float) -> float:
    """Draw a length whose density falls with a power of it, between limits.

    Parameters
    ----------
    rng
        Draws one number.
    limits
        Smallest and largest, above 0.
    exponent
        The density is proportional to ``length ** -exponent``.
    """
    low, high = limits
    share = rng.random()
    power = 1.0 - exponent
    if abs(power) < 1e-9:
        return float(low * (high / low) ** share)
    return float((low**power + share * (high**power - low**power)) ** (1.0 / power))


def slab(rng: np.random.Generator, length_mm: float, kind: SlabKind) -> Floats:
    """Return the corners of a slab around the origin: strictly convex, counter-clockwise.

    It is a tapered bar with a broken end at both sides: six corners, four if not ragged.
    """
    low, high = kind.thickness
    thick_mm = length_mm * (low + (high - low) * rng.random())
    ends = [_end(rng, thick_mm, kind.raggedness) for _ in range(2)]
    right = np.array([0.5 * length_mm, 0.0]) + ends[0]
    left = -(np.array([0.5 * length_mm, 0.0]) + ends[1])
    turn = kind.direction_rad + kind.direction_spread_rad * (2.0 * rng.random() - 1.0)
    cosine, sine = math.cos(turn), math.sin(turn)
    turned = np.array([[cosine, sine], [-sine, cosine]])
    return np.asarray(np.concatenate([right, left]) @ turned)


def _end(rng: np.random.Generator, thick_mm: float, raggedness: float) -> Floats:
    """Return the corners of a right end, from below, relative to the middle of a straight one."""
    half_mm = 0.5 * thick_mm * (1.0 - _TAPER * rng.random())
    back_low, back_high, tip = rng.random(3)
    if raggedness == 0.0:
        return np.array([(0.0, -half_mm), (0.0, half_mm)])
    # At least a little, so that the tip stands out and the corner there is one.
    deep_mm = _DEEPEST * raggedness * thick_mm * (0.1 + 0.9 * np.array([back_low, back_high]))
    return np.array([(-deep_mm[0], -half_mm), (0.0, half_mm * (tip - 0.5)), (-deep_mm[1], half_mm)])


def way_to_contact(mover: Floats, host: Floats, way: Floats) -> float:
    """Return how far a convex polygon can move until it touches another; infinity if it misses.

    Parameters
    ----------
    mover, host
        Corners, shape (n, 2); apart from each other.
    way
        Unit vector of the motion.
    """
    ahead = _first_hit(mover, host, way)
    return min(ahead, _first_hit(host, mover, -way))


def _first_hit(points: Floats, corners: Floats, way: Floats) -> float:
    """Return the shortest way from any of the points to any of the edges."""
    edges = np.roll(corners, -1, axis=0) - corners
    from_points = corners - points[:, None]
    slope = way[0] * edges[:, 1] - way[1] * edges[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (from_points[..., 0] * edges[:, 1] - from_points[..., 1] * edges[:, 0]) / slope
        place = (from_points[..., 0] * way[1] - from_points[..., 1] * way[0]) / slope
    hit = (slope != 0.0) & (far >= 0.0) & (place >= 0.0) & (place <= 1.0)
    return float(np.where(hit, far, np.inf).min())
