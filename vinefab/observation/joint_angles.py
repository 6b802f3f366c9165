"""The deployed angle of a joint coupon on a photo, from the centre lines of its tubes."""

import math
from pathlib import Path

import numpy as np
import scipy  # its parts load at their first use

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.fabrication.calibration.coupons import JointReading
from vinefab.observation.centre_lines import TracedBranch, TracedTree
from vinefab.observation.film import SeenFilm
from vinefab.observation.observe_photo import Observation

_TRUNK, _CHILD = (0.1, 0.7), (0.5, 0.92)
"""Stretch of a line that counts: away from the joint, where film is wider than a tube, and tip."""

_LEAST_POINTS = 3

_EDGE_POINTS, _EDGE_STEPS = 40, 81
"""Places along an edge, and points across it at each."""

_LEAST_EXPLAINED, _LEAST_SUPPORTED = 0.82, 0.9
"""Share of the film in the lines, and of the lines on film, of a coupon: 0.93 and 0.98 at least on
rendered photos; an elbow explains 0.71 of a pair."""


def joint_reading(seen: Observation, kpa: float) -> JointReading:
    """Return the angle of a joint coupon on a photo, as a row of the coupons' results.

    Parameters
    ----------
    kpa
        Pressure in the coupon.

    Raises
    ------
    BadInputError
        If the photo hardly shows the coupon.
    """
    traced = seen.traced
    shares = traced.film_explained, traced.lines_supported
    if shares[0] < _LEAST_EXPLAINED or shares[1] < _LEAST_SUPPORTED:
        found = f"{100.0 * shares[0]:.0f} % of its film is in lines of {seen.design.name}"
        allowed = "a photo of this coupon alone, launched from --pose"
        raise BadInputError("photo", found, allowed, seen.photo)
    return JointReading(
        coupon=seen.design.name,
        kpa=kpa,
        angle_deg=joint_angle_deg(traced, seen.film),
        source=Path(seen.photo).name,
    )


def joint_angle_deg(traced: TracedTree, film: SeenFilm) -> float:
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
    if count == 2:
        trunk, child = (branch.points_mm for branch in traced.branches)
        one, other = _heading_rad(trunk, _TRUNK), _heading_rad(child, _CHILD)
    else:
        pair = traced.branches[1], traced.branches[2]
        headings = [_heading_rad(child.points_mm, _CHILD) for child in pair]
        turn = math.remainder(headings[1] - headings[0], math.tau)
        one, other = (
            _outer_heading_rad(film, child, heading, side)
            for child, heading, side in zip(
                pair, headings, (-np.sign(turn), np.sign(turn)), strict=True
            )
        )
    return abs(math.degrees(math.remainder(other - one, math.tau)))


def _outer_heading_rad(
    film: SeenFilm, child: TracedBranch, heading_rad: float, side: float
) -> float:
    """Return the direction of the edge of a child that its sibling does not hide.

    Where tubes touch, the lines of both are drawn apart; their outer edges are not.

    Parameters
    ----------
    side
        1 for its left edge, -1 for its right one.
    """
    points, radius = child.points_mm, child.width_mm / 2.0
    along = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    across = side * np.array([-along[1], along[0]])
    end = points[-1] @ along
    places = np.linspace(*_CHILD, _EDGE_POINTS) * (end - points[0] @ along) + points[0] @ along
    # Out from the line, which may stand off the axis by half a radius, past its edge.
    outward = np.linspace(0.0, 2.0 * radius, _EDGE_STEPS)
    middle = np.interp(places, points @ along, points @ across)
    grid = places[:, None, None] * along + (middle[:, None] + outward)[..., None] * across
    share = film.at(grid.reshape(-1, 2), film.sight.plane_mm).reshape(len(places), -1)
    first = np.argmax(share < 0.5, axis=1)
    rows = np.flatnonzero(first > 0)
    if len(rows) < _EDGE_POINTS // 2:
        raise BadInputError("film", "no outer edge of a child", "a photo of the whole coupon")
    inner, outer = share[rows, first[rows] - 1], share[rows, first[rows]]
    steps = first[rows] - 1 + (inner - 0.5) / (inner - outer)
    off = middle[rows] + steps * outward[1]
    # The median of slopes leaves out what shadows and creases add at some places.
    slope = float(scipy.stats.theilslopes(off, places[rows])[0])
    return heading_rad + side * math.atan(slope)


def _heading_rad(line_mm: Floats, stretch: tuple[float, float]) -> float:
    """Return the direction of the straight line through a stretch of a centre line."""
    first, last = (round(share * len(line_mm)) for share in stretch)
    if last - first < _LEAST_POINTS:
        raise BadInputError("film", "a branch that is not seen", "a photo of the whole coupon")
    points = line_mm[first:last]
    along = np.linalg.svd(points - points.mean(axis=0))[2][0]
    along = along * np.sign(along @ (points[-1] - points[0]))
    return math.atan2(along[1], along[0])
