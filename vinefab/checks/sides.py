"""The straight sides of branches in the laser's paths, compared with the design."""

import math

import numpy as np

from vinefab.checks.subject import Subject
from vinefab.geometry.crotch import taper_rad
from vinefab.model.outline import Contour, Part, Segment

_NEAR_MM = 1e-3


def excesses_mm(subject: Subject, contour: Contour, offset_mm: float) -> dict[int, float]:
    """Return by how much branches come out wider than designed, as far as both sides are straight.

    A branch of whose sides one is gone is left out: its neighbour's crotch took it, and VF-C03
    says so.

    Parameters
    ----------
    subject
        The design.
    contour
        An outline as it lies on the sheet, open at the mouth.
    offset_mm
        How far outside the lumen it is meant to run.
    """
    flat = _flat(subject, contour)
    rows = {name: row for row, name in enumerate(subject.names)}
    sides: dict[tuple[int, bool], tuple[float, float]] = {}
    for segment in flat.segments:
        if not _is_side(subject, segment):
            continue
        row = rows[segment.branch]
        left, beyond = _beyond_mm(subject, row, segment, offset_mm)
        length = segment.length_mm
        if length > sides.get((row, left), (0.0, 0.0))[0]:
            sides[row, left] = length, beyond
    both = sorted(row for row, left in sides if left and (row, False) in sides)
    return {row: sides[row, True][1] + sides[row, False][1] for row in both}


def _is_side(subject: Subject, segment: Segment) -> bool:
    """Whether a segment is a straight side of a branch; a collar's are as wide as its clamp."""
    if segment.part not in (Part.SIDE, Part.TAIL) or segment.bulge or not segment.branch:
        return False
    collar = subject.design.build.collar
    if segment.part is Part.SIDE or collar is None:
        return True
    return min(segment.start_mm[0], segment.end_mm[0]) > collar.reach_mm - _NEAR_MM - (
        subject.layout.tail_mm
    )


def _flat(subject: Subject, contour: Contour) -> Contour:
    """Return an outline in the coordinates of the flat layout: its two ends are the mouth."""
    first, last = contour.points_mm[0], contour.points_mm[-1]
    angle = math.atan2(*(last - first)[::-1]) - math.pi / 2
    turned = contour.moved(-angle, 0.0, 0.0)
    x, y = (turned.points_mm[0] + turned.points_mm[-1]) / 2.0
    return turned.moved(0.0, -float(x) - subject.layout.tail_mm, -float(y))


def _beyond_mm(
    subject: Subject, row: int, segment: Segment, offset_mm: float
) -> tuple[bool, float]:
    """Return whether a segment lies left of its branch, and how far outside the design at most."""
    layout = subject.layout
    heading, base = layout.heading_rad[row], layout.start_mm[row]
    along = np.array([math.cos(heading), math.sin(heading)])
    ends = np.array([segment.start_mm, segment.end_mm]) - base
    across = ends @ np.array([-along[1], along[0]])
    half, end_half = layout.width_mm[row] / 2.0, layout.end_width_mm[row] / 2.0
    lean_rad = taper_rad(half, end_half, float(layout.tree.length_mm[row]))
    meant = half + offset_mm - np.maximum(ends @ along, 0.0) * math.sin(lean_rad)
    meant /= math.cos(lean_rad)
    if segment.part is Part.TAIL:
        meant = np.full(2, half + offset_mm)
    beyond = np.abs(across) - meant
    return bool(across.mean() > 0.0), float(beyond[np.abs(beyond).argmax()])
