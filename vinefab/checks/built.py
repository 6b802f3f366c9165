"""Rules about what came out: widths in the laser's paths, and the files read again."""

import math

import numpy as np

from vinefab.checks.marks import mark_branches, middle_mm
from vinefab.checks.rule import Hit, Limits, Looked, NotLooked, Rule
from vinefab.checks.subject import Subject
from vinefab.model.job import Operation
from vinefab.model.laser import OperationSettings
from vinefab.model.outline import Contour, Part, Segment


def look_built_width(subject: Subject, limits: Limits) -> Looked | NotLooked:
    """VF-W04: both sides of a branch, less seam and kerf, leave the designed lumen between them."""
    if subject.job is None or subject.profile is None:
        return NotLooked(reason="needs a recipe, for seam and kerf")
    operation = Operation.WELDCUT if subject.job.along(Operation.WELDCUT) else Operation.WELD
    settings = subject.profile.settings(operation)
    offset_mm = beam_offset_mm(settings) if operation is Operation.WELDCUT else weld_mm(settings)
    hits, checked = [], 0
    for path in subject.job.along(operation):
        for row, excess_mm in _excesses_mm(subject, path.contour, offset_mm).items():
            checked += 1
            breach = limits.most(abs(excess_mm))
            if breach:
                middle_width_mm = float(
                    subject.layout.width_mm[row] + subject.layout.end_width_mm[row]
                )
                built_mm = middle_width_mm / 2.0 + excess_mm
                hits.append(
                    Hit(
                        message=f"the branch comes out {built_mm:.2f} mm wide in the paths: its "
                        "joint took its sides, or their seam and kerf are not the recipe's",
                        measured=abs(excess_mm),
                        limit=breach.limit,
                        branches=subject.ids(row),
                        at_mm=middle_mm(subject.layout, row),
                        marker=mark_branches(subject.layout, [row]),
                    )
                )
    return Looked(checked=checked, hits=tuple(hits))


def beam_offset_mm(settings: OperationSettings) -> float:
    """Return how far outside the lumen the beam runs to cut and seal in one pass: s + k/2."""
    return settings.seam_width_mm.value + settings.kerf_mm.value / 2.0


def weld_mm(settings: OperationSettings) -> float:
    """Return how far outside the lumen the middle of a seam runs that is welded alone: s/2."""
    return settings.seam_width_mm.value / 2.0


def look_readback(subject: Subject, _: Limits) -> Looked | NotLooked:
    """VF-X01: every file that was written says, read again, what it was meant to say."""
    if subject.readback is None:
        return NotLooked(reason="no file was written and read back")
    hits = [
        Hit(message=f"{name}: {problem}", aspect=name)
        for name, problems in subject.readback.items()
        for problem in problems
    ]
    return Looked(checked=len(subject.readback), hits=tuple(hits))


def _excesses_mm(subject: Subject, contour: Contour, offset_mm: float) -> dict[int, float]:
    """Return by how much branches come out wider than designed, as far as both sides are straight.

    A branch of whose sides one is gone is left out: its neighbour's crotch took it, and VF-C03
    says so.
    """
    flat = _flat(subject, contour)
    rows = {name: row for row, name in enumerate(subject.names)}
    sides: dict[tuple[int, bool], tuple[float, float]] = {}
    for segment in flat.segments:
        if segment.part not in (Part.SIDE, Part.TAIL) or segment.bulge or not segment.branch:
            continue
        row = rows[segment.branch]
        left, beyond = _beyond_mm(subject, row, segment, offset_mm)
        length = segment.length_mm
        if length > sides.get((row, left), (0.0, 0.0))[0]:
            sides[row, left] = length, beyond
    both = sorted(row for row, left in sides if left and (row, False) in sides)
    return {row: sides[row, True][1] + sides[row, False][1] for row in both}


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
    sin = (half - end_half) / layout.tree.length_mm[row]
    meant = (half + offset_mm - np.maximum(ends @ along, 0.0) * sin) / math.sqrt(1.0 - sin**2)
    if segment.part is Part.TAIL:
        meant = np.full(2, half + offset_mm)
    beyond = np.abs(across) - meant
    return bool(across.mean() > 0.0), float(beyond[np.abs(beyond).argmax()])


BUILT_WIDTH = Rule(
    id="VF-W04",
    title="width as built, against the design",
    unit="mm",
    limits={"error": 0.1},
    reason="a forgotten seam and kerf offset narrows an 8 mm branch by 6 to 12 % (computed)",
    look=look_built_width,
)
READBACK = Rule(
    id="VF-X01",
    title="exported files, read again, equal the model",
    reason="programs read files, not intentions",
    look=look_readback,
)
