"""Obstacles and border as loose pieces, each with pegs or pins that hold it on a drilled board."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Point, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.rig.clean import Pieces, pieces_of, snapped_union, without_slivers
from vinefab.rig.options import GRID_MM, RigOptions
from vinefab.rig.plan import RigPlan
from vinefab.rig.split import Cuts

RIM_MM = 0.6
"""Least material around a peg or a pin's hole."""

_SMALLER = 0.6
_CIRCLE_SEGMENTS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Peg:
    """A round peg, or the hole for a pin."""

    # x_mm, y_mm: its middle, in the coordinates of the plan
    x_mm: float
    y_mm: float
    diameter_mm: float  # its diameter

    @property
    def outline(self) -> Polygon:
        """The peg as a polygon of 24 corners."""
        circle = Point(self.x_mm, self.y_mm).buffer(
            0.5 * self.diameter_mm, quad_segs=_CIRCLE_SEGMENTS
        )
        return shapely.set_precision(circle, GRID_MM)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loose:
    """A loose piece of obstacle or border."""

    number: int  # from 1
    outline: Polygon  # where it stands, in the coordinates of the plan
    pegs: tuple[Peg, ...]  # what holds it: two against turning, one, or none where there is no room


def loose_of(
    plan: RigPlan, cuts: Cuts, options: RigOptions, peg_mm: float, most: int
) -> tuple[Loose, ...]:
    """Return all pieces of a plan, numbered from the lower left, row by row."""
    room_mm = max(np.diff(cuts.x_mm)), max(np.diff(cuts.y_mm))
    whole: list[Polygon] = []
    large: list[Polygon] = []
    for piece in plan.solids:
        x_min, y_min, x_max, y_max = piece.bounds
        fits = x_max - x_min <= room_mm[0] and y_max - y_min <= room_mm[1]
        (whole if fits else large).append(piece)
    pieces = pieces_of(*whole, *_divided(large, cuts), Polygon())
    pieces, _ = without_slivers(pieces, options.sliver_mm)
    if len(pieces) > most:
        allowed = f"at most {most} loose pieces: --most-parts allows more, --style plate needs none"
        raise BadInputError("rig.parts", len(pieces), allowed)
    middles = shapely.get_coordinates(shapely.centroid(pieces))
    order = np.lexsort((middles[:, 0], np.round(middles[:, 1] / 20.0)))
    return tuple(
        Loose(number=number, outline=pieces[index], pegs=pegs_in(pieces[index], peg_mm))
        for number, index in enumerate(order.tolist(), 1)
    )


def pegs_in(outline: Polygon, peg_mm: float) -> tuple[Peg, ...]:
    """Return pegs that fit into an outline: the two places farthest apart, or the one with room."""
    for diameter_mm in (peg_mm, _SMALLER * peg_mm):
        reach_mm = 0.5 * diameter_mm + RIM_MM
        room = shapely.buffer(outline, -reach_mm, quad_segs=2)
        if room.is_empty:
            continue
        one, other, apart_mm = _farthest(room)
        if apart_mm >= 1.5 * diameter_mm:
            return _peg(one, diameter_mm), _peg(other, diameter_mm)
        middle = shapely.get_coordinates(shapely.maximum_inscribed_circle(outline, 0.05))[0]
        return (_peg(middle, diameter_mm),)
    return ()


def _peg(point: Floats, diameter_mm: float) -> Peg:
    x_mm, y_mm = np.round(point, 3).tolist()
    return Peg(x_mm=x_mm, y_mm=y_mm, diameter_mm=diameter_mm)


def _farthest(room: BaseGeometry) -> tuple[Floats, Floats, float]:
    """Return the two corners of a region that are farthest apart, and their distance."""
    corners = shapely.get_coordinates(shapely.convex_hull(room))
    away = np.hypot(*(corners[:, None] - corners[None]).transpose(2, 0, 1))
    one, other = np.unravel_index(int(away.argmax()), away.shape)
    return corners[one], corners[other], float(away[one, other])


def _divided(large: list[Polygon], cuts: Cuts) -> Iterator[Pieces]:
    """Yield what pieces too large for the bed leave in each cell of the cuts."""
    if not large:
        return
    for y_low, y_high in zip(cuts.y_mm, cuts.y_mm[1:], strict=False):
        for x_low, x_high in zip(cuts.x_mm, cuts.x_mm[1:], strict=False):
            cell = shapely.box(x_low, y_low, x_high, y_high)
            yield snapped_union(pieces_of(*shapely.intersection(large, cell, grid_size=GRID_MM)))
