"""What separate weld and cut paths leave of each other, measured in the paths themselves."""

import math
from collections.abc import Iterator
from itertools import groupby

import shapely

from vinefab.checks.subject import Subject
from vinefab.geometry.order import closes
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour, Part


def webs_mm(subject: Subject, profile: LaserProfile) -> Iterator[tuple[float, str]]:
    """Yield the film between each seam of a design and the nearest kerf, and whose it is.

    It is negative where the kerf reaches into the seam. At the mouth the cut is meant to cross it.
    """
    welds = subject.own(Operation.WELD)
    if not welds:
        return
    seam_mm = profile.settings(Operation.WELD).seam_width_mm.value
    kerf_mm = profile.settings(Operation.CUT).kerf_mm.value
    runs = (run for path in subject.own(Operation.CUT) for run in _beside_mouth(path.contour))
    cuts = shapely.union_all([_line(run) for run in runs])
    for path in welds:
        apart_mm = shapely.distance(_line(path.contour), cuts)
        yield apart_mm - (seam_mm + kerf_mm) / 2.0, whose(path, welds)


def overlaps_mm(subject: Subject) -> Iterator[tuple[float, str]]:
    """Yield by how much each cut that goes all around runs past its start, and whose it is."""
    cuts = subject.own(Operation.CUT)
    for path in cuts:
        contour = path.contour
        if closes(contour) and not contour.closed:
            yield math.dist(contour.points_mm[0], contour.points_mm[-1]), whose(path, cuts)


def whose(path: LaserPath, paths: tuple[LaserPath, ...]) -> str:
    """Return words for whose a path is, where that is a question."""
    return f" of {path.label!r}" if len(paths) > 1 else ""


def _beside_mouth(contour: Contour) -> Iterator[Contour]:
    """Yield the runs of a cut that lie before, between and after its mouths."""
    for at_mouth, run in groupby(contour.segments, key=lambda part: part.part is Part.MOUTH):
        if not at_mouth:
            yield Contour.from_segments(list(run), closed=False)


def _line(contour: Contour) -> shapely.LineString:
    return shapely.LineString(contour.flattened_mm())
