"""Notches of the drawn outline: film between two sides that is narrower than a limit."""

import math

import shapely

from vinefab.checks.subject import Subject

_ARC_STEPS = 32
_LEAST_MM2 = 0.05
_SLACK_MM = 0.02


def notches(body: shapely.Polygon, width_mm: float) -> list[shapely.Polygon]:
    """Return where a disc of a diameter does not fit into the film around a body.

    Parameters
    ----------
    body
        A valid polygon.
    width_mm
        Diameter of the disc.

    Returns
    -------
    list of Polygon
        What closing the body by the disc adds, slivers left out. A fillet of at least half the
        width adds nothing, nor does film between sides that part from such a fillet on.
    """
    closed = shapely.buffer(body, width_mm / 2.0, quad_segs=_ARC_STEPS)
    closed = shapely.buffer(closed, -width_mm / 2.0, quad_segs=_ARC_STEPS)
    # The chords of both buffers leave a film as thin as their sagitta all around.
    sagitta_mm = width_mm * (1.0 - math.cos(math.pi / (4 * _ARC_STEPS)))
    added = shapely.difference(closed, shapely.buffer(body, _SLACK_MM + sagitta_mm))
    return [part for part in shapely.get_parts(added).tolist() if part.area > _LEAST_MM2]


def between(
    subject: Subject, found: list[shapely.Polygon], branches: tuple[str, ...], within_mm: float
) -> bool:
    """Return whether one of some notches lies near every one of some branches.

    Parameters
    ----------
    subject
        Gives the branches' shapes.
    found
        Notches.
    branches
        Ids of the branches, pouches count with theirs.
    within_mm
        How near a notch must come to each.
    """
    shapes = subject.shapes
    near = []
    for name in branches:
        rows = shapes.branch == subject.names.index(name)
        lines = [
            shapely.LineString([a, b])
            for a, b in zip(shapes.start_mm[rows], shapes.end_mm[rows], strict=True)
        ]
        near.append(list(zip(lines, shapes.half_mm[rows].tolist(), strict=True)))
    return any(
        all(
            min(shapely.distance(notch, line) - half for line, half in one) < within_mm
            for one in near
        )
        for notch in found
    )
