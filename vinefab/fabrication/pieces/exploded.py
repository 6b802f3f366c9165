"""The exploded view: the pieces of a robot moved apart, so that none lies on another.

Pieces are moved and not turned: each lies as it does in the robot. Piece by piece, base first, the
stub's axis is tried first, then directions near it. The shortest way that is free and crosses
little is taken.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.validation import Floats
from vinefab.fabrication.job.passes import piece_ends
from vinefab.model.design import Design
from vinefab.model.outline import Contour
from vinefab.model.tree import Partition
from vinefab.outline.body_outline import FlatLayout, body_outline

_DIRECTIONS = 24

_TURN_COST, _CROSSING_COST, _GROWTH_COST = 1.0, 4.0, 0.15
"""Costs of a quarter turn off the stub's axis over the distance, of crossing a piece or line in
least distances, and of a larger picture over its growth."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExplodedView:
    """How far every piece is moved, and where its joints are then."""

    moves_mm: Mapping[str, Floats]  # by label of the piece, shape (2,)
    stubs_mm: Mapping[str, Floats]  # rim of each stub, by label of the joint, shape (2,)
    bases_mm: Mapping[str, Floats]  # rim of each outer piece, by label of the joint, shape (2,)


def piece_lumens(design: Design, partition: Partition) -> dict[str, Contour]:
    """Return the outline of every piece's lumen in the robot's flat layout, by its label."""
    return {
        piece.label: body_outline(design, ends=piece_ends(partition, piece)).contour
        for piece in partition.pieces
    }


def exploded_view(
    partition: Partition, layout: FlatLayout, outlines: Mapping[str, Contour], lead_mm: float
) -> ExplodedView:
    """Return where the pieces lie when they are moved apart.

    Parameters
    ----------
    outlines
        Outline of every piece, by its label, in the coordinates of the flat layout.
    lead_mm
        Least distance from a stub's rim to that of the outer piece; pieces are a fifth of it apart.
    """
    rings = dict[str, Floats]()  # coarsely; of an outline that crosses itself its hull
    flatten_share = 5e-4  # how coarsely outlines are followed, over the robot's size
    for label, contour in outlines.items():
        x0, y0, x1, y1 = contour.box_mm
        tolerance = flatten_share * max(x1 - x0, y1 - y0, 1e-3)
        points = contour.flattened_mm(tolerance)
        shape: BaseGeometry = shapely.simplify(shapely.Polygon(points), tolerance)
        if not shape.is_valid or shape.is_empty:
            shape = shapely.MultiPoint(points).convex_hull
        rings[label] = shapely.get_coordinates(shapely.get_exterior_ring(shape))
    first = partition.pieces[0].label
    stubs, bases = {}, {}
    page = _Page(lead_mm)
    moves = {first: np.zeros(2)}
    page.put(rings[first])
    for sleeve in partition.sleeves:
        heading, start = float(layout.heading_rad[sleeve.branch]), layout.start_mm[sleeve.branch]
        along = np.array([np.cos(heading), np.sin(heading)])
        stub, home = start + sleeve.stub_to_mm * along, start + sleeve.outer_from_mm * along
        stubs[sleeve.label] = stub + moves[sleeve.inner]
        place = page.place(rings[sleeve.label] - home, stubs[sleeve.label], heading)
        moves[sleeve.label] = place - home
        bases[sleeve.label] = place
        page.put(rings[sleeve.label] - home + place)
        page.draw(stubs[sleeve.label], place)
    return ExplodedView(moves_mm=moves, stubs_mm=stubs, bases_mm=bases)


class _Page:
    """What lies in the exploded view so far: pieces and the lines of joints."""

    def __init__(self, lead_mm: float) -> None:
        self.lead_mm = lead_mm
        self.pieces: list[BaseGeometry] = []
        self.lines: list[BaseGeometry] = []

    def put(self, ring_mm: Floats) -> None:
        """Add a piece."""
        self.pieces.append(shapely.Polygon(ring_mm))
        shapely.prepare(self.pieces[-1])

    def draw(self, stub_mm: Floats, base_mm: Floats) -> None:
        """Add the line of a joint."""
        self.lines.append(shapely.LineString([stub_mm, base_mm]))

    def place(self, ring_mm: Floats, stub_mm: Floats, heading_rad: float) -> Floats:
        """Return where the base of a piece comes to lie.

        Parameters
        ----------
        ring_mm
            Outline of the piece, its base's rim at the origin.
        """
        turns = np.arange(_DIRECTIONS) * 2.0 * np.pi / _DIRECTIONS
        along = np.column_stack([np.cos(heading_rad + turns), np.sin(heading_rad + turns)])
        dearer = 1.0 + _TURN_COST * (1.0 - np.cos(turns))
        best, place, away = np.inf, stub_mm, self.lead_mm
        while away < best:
            spots = stub_mm + away * along
            costs = away * dearer + self._extra(ring_mm, stub_mm, spots)
            if costs.min() < best:
                best, place = float(costs.min()), spots[int(costs.argmin())]
            away = away + 0.5 * self.lead_mm if away < 40.0 * self.lead_mm else 1.2 * away
        return place

    def _extra(self, ring_mm: Floats, stub_mm: Floats, spots: Floats) -> Floats:
        """Return the costs of a base's places without distance; infinite where one is not free."""
        shapes = np.asarray(shapely.polygons(ring_mm[None] + spots[:, None]))
        cost = np.zeros(len(spots))
        for piece in self.pieces:
            cost[shapely.dwithin(piece, shapes, 0.2 * self.lead_mm)] = np.inf
        free = np.flatnonzero(np.isfinite(cost))
        if len(free):
            # The pieces and lines that each shape's line, or the shape, crosses. The ends of a line
            # lie on the rims of its two pieces.
            away = spots[free] - stub_mm
            ends = np.stack([stub_mm + 0.05 * away, stub_mm + 0.95 * away], axis=1)
            lines = shapely.linestrings(ends)
            crossed = 1.0 * shapely.intersects(shapes[free], lines)
            for other in (*self.pieces, *self.lines):
                crossed += shapely.intersects(other, lines)
            for line in self.lines:
                crossed += shapely.intersects(line, shapes[free])
            cost[free] += _CROSSING_COST * self.lead_mm * crossed
            around = shapely.total_bounds(np.array(self.pieces))
            boxes = shapely.bounds(shapes[free])
            low, high = np.minimum(boxes[:, :2], around[:2]), np.maximum(boxes[:, 2:], around[2:])
            # How much larger the page becomes.
            growth = (high - low - (around[2:] - around[:2])).sum(axis=1)
            cost[free] += _GROWTH_COST * growth
        return cost
