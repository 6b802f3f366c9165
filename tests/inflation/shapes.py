"""Outlines with known inflated shapes, in widths."""

import math

import numpy as np

from vinefab.inflation.mesh import Sheet, StraightSide, sheet_of
from vinefab.model.outline import Contour, Part


def sheet(points, bulges, *, across=8, hoop_strain=0.01, mouth=None, straights=(), width=1.0):
    """Return the sheet of a closed outline; ``mouth`` is the number of its open segment."""
    parts = [Part.MOUTH if number == mouth else Part.SIDE for number in range(len(points))]
    outline = Contour(
        points_mm=np.array(points, dtype=float),
        bulges=np.array(bulges, dtype=float),
        parts=tuple(parts),
        branches=("0",) * len(points),
        closed=True,
    )
    return sheet_of(outline, straights, {"0": width}, across=across, hoop_strain=hoop_strain)


def tube(length=4.0, **options) -> Sheet:
    """Return a tube of width 1 from a mouth at x = 0 to a round end."""
    straight = StraightSide(
        origin=(0.0, 0.0), heading_rad=0.0, begin=0.0, end=length, half_begin=0.5, half_end=0.5
    )
    points = [(0.0, -0.5), (length, -0.5), (length + 0.5, 0.0), (length, 0.5), (0.0, 0.5)]
    quarter = math.tan(math.pi / 8.0)
    bulges = [0.0, quarter, quarter, 0.0, 0.0]
    return sheet(points, [*bulges[:4], 0.0], mouth=4, straights=(straight,), **options)


def disc(**options) -> Sheet:
    """Return a disc of radius 1."""
    return sheet(
        [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)], [math.tan(math.pi / 8.0)] * 4, **options
    )


def ring(radius, turn_rad, **options) -> Sheet:
    """Return a sector of a ring of width 1 that turns left from a mouth to a round end."""
    out, inn = radius + 0.5, radius - 0.5
    center = np.array([0.0, radius])

    def on(size, turn):
        return tuple(center + size * np.array([math.sin(turn), -math.cos(turn)]))

    bulge, tip = math.tan(turn_rad / 8.0), math.tan(math.pi / 8.0)
    end = np.array([math.cos(turn_rad), math.sin(turn_rad)])
    top = np.array(on(radius, turn_rad)) + 0.5 * end
    points = [
        on(out, 0.0),
        on(out, turn_rad / 2),
        on(out, turn_rad),
        tuple(top),
        on(inn, turn_rad),
        on(inn, turn_rad / 2),
        on(inn, 0.0),
    ]
    return sheet(points, [bulge, bulge, tip, tip, -bulge, -bulge, 0.0], mouth=6, **options)
