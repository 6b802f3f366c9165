"""The laser's paths around one robot or piece, and the size of a sleeve joint."""

import itertools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
import shapely

from vinefab.core.validation import Floats
from vinefab.model.design import Build, Design, PieceSettings
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour, Part, Segment
from vinefab.model.tree import Partition, Piece, Sleeve
from vinefab.outline.body_outline import (
    WHOLE_ROBOT,
    BodyOutline,
    PieceEnds,
    body_outline,
)
from vinefab.outline.ends import OpenEnd
from vinefab.outline.joint import LEAST_ARC_RADIUS_MM

_OPERATIONS = tuple(Operation)


def closes(contour: Contour) -> bool:
    """Whether a path ends where it began, or past that point on its first segment."""
    if contour.closed:
        return True
    first = next(iter(contour.segments))
    if first.bulge:
        return False
    start, end = np.array(first.start_mm), np.array(first.end_mm)
    last, along = contour.points_mm[-1], end - start
    share = float(np.dot(last - start, along) / np.dot(along, along))
    foot = start + share * along
    meets_mm = 1e-6
    return len(contour) > 2 and -1e-9 <= share <= 1.0 and math.dist(foot, last) < meets_mm


def frees(path: LaserPath) -> bool:
    """Whether a path cuts a piece out of the sheet."""
    return path.operation in (Operation.WELDCUT, Operation.CUT) and closes(path.contour)


def bodies_of_paths(sealed: Iterable[LaserPath]) -> Iterator[tuple[LaserPath, ...]]:
    """Yield the paths that together seal one body, in order: several for a piece with stubs."""
    names = itertools.count()
    for _, runs in groupby(
        sealed, key=lambda path: next(names) if path.contour.closed else path.label or next(names)
    ):
        yield tuple(runs)


def enclosed_mm2(runs: Iterable[LaserPath]) -> float:
    """Return the area within the paths that seal one body, its open ends closed by lines."""
    contours = [path.contour for path in runs]
    ends = np.concatenate([contour.points_mm[[0, -1]] for contour in contours])
    between = Contour.polyline(ends, closed=True).signed_area_mm2 if len(contours) > 1 else 0.0
    return abs(math.fsum(contour.signed_area_mm2 for contour in contours) + between)


def in_order(paths: Iterable[LaserPath]) -> tuple[LaserPath, ...]:
    """Return paths in process order.

    Within an operation, the paths inside the most others come first; ties keep their order.
    """
    given = list(paths)
    depth = dict.fromkeys(range(len(given)), 0)
    rings = {
        row: shapely.Polygon(path.contour.flattened_mm(0.1))
        for row, path in enumerate(given)
        if frees(path)
    }
    for outer, area in rings.items():
        for inner in rings:
            if inner != outer and given[inner].operation is given[outer].operation:
                x, y = given[inner].contour.points_mm[0]
                depth[inner] += bool(shapely.contains_xy(area, x, y))
    order = sorted(
        range(len(given)), key=lambda row: (_OPERATIONS.index(given[row].operation), -depth[row])
    )
    return tuple(given[row] for row in order)


GUIDE = "seal guide"
"""Label of the mark where the cut will run, for a seam that is made by hand inside it."""

WEB_MM = 2.0
"""Film left between the seam and the cut where they are separate (assumed)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyPaths:
    """The paths of one robot."""

    paths: tuple[LaserPath, ...]  # in process order; several to seal a piece with stubs
    outline: BodyOutline  # the outline that forms the body, with its problems
    reach_mm: float  # how far outside the lumen the paths reach
    facts: dict[str, object]  # offsets applied


def weldcut_offset_mm(profile: LaserProfile) -> float:
    """Return the distance of the beam's centre outside the lumen's edge as it cuts and seals.

    The seam that extends inward of the kerf plus half the kerf: the beam melts the seam's whole
    width to both sides of the kerf, and the lumen ends where the seam begins.
    """
    settings = profile.settings(Operation.WELDCUT)
    return settings.seam_width_mm.value + settings.kerf_mm.value / 2.0


def weld_offset_mm(profile: LaserProfile) -> float:
    """Return the distance of a seam's middle outside the lumen's edge, if welded alone."""
    return profile.settings(Operation.WELD).seam_width_mm.value / 2.0


def cut_offset_mm(profile: LaserProfile) -> float:
    """Return the distance of the cut outside the lumen's edge, around a seam welded alone."""
    seam, kerf = profile.settings(Operation.WELD).seam_width_mm, profile.settings(Operation.CUT)
    return seam.value + WEB_MM + kerf.kerf_mm.value / 2.0


def seal_offset_mm(profile: LaserProfile) -> float:
    """Return the distance of the sealing line outside the lumen's edge."""
    return weldcut_offset_mm(profile) if in_one_pass(profile) else weld_offset_mm(profile)


def in_one_pass(profile: LaserProfile, *, separate: bool = False) -> bool:
    """Whether a recipe cuts and seals in one pass, unless ``separate`` asks for two."""
    operations = profile.recipe.by_operation
    return not separate and (Operation.WELDCUT in operations or Operation.WELD not in operations)


def sealed_by_hand(profile: LaserProfile, *, separate: bool = False) -> bool:
    """Whether the sheet leaves a bed between marks and cut, to be sealed by hand."""
    if in_one_pass(profile, separate=separate):
        return False
    seals, cuts = (profile.settings(one).tool for one in (Operation.WELD, Operation.CUT))
    return seals.by_hand and not cuts.by_hand


def draws_by_hand(profile: LaserProfile) -> bool:
    """Whether people seal along lines that no machine marks on the film."""
    operations = profile.recipe.by_operation
    return operations[profile.recipe.seals].tool.by_hand and Operation.MARK not in operations


def reach_mm(profile: LaserProfile, *, separate: bool = False) -> float:
    """Return the reach of a robot's paths outside the lumen's edge."""
    one_pass = in_one_pass(profile, separate=separate)
    return weldcut_offset_mm(profile) if one_pass else cut_offset_mm(profile)


def taken_mm(profile: LaserProfile, *, separate: bool = False) -> float:
    """Return the width outside the lumen's edge in which a robot's beams remove or melt film.

    In one pass the beam melts the seam's width to both sides of the kerf; a cut alone removes the
    kerf. Film that holds begins beyond.
    """
    one_pass = in_one_pass(profile, separate=separate)
    beam = profile.settings(Operation.WELDCUT if one_pass else Operation.CUT)
    rim_mm = beam.seam_width_mm.value if one_pass else 0.0
    return reach_mm(profile, separate=separate) + beam.kerf_mm.value / 2.0 + rim_mm


def bare_sheet_mm(profile: LaserProfile) -> tuple[float, float]:
    """Return width and height that a robot's bare lumen must fit on the bed.

    The rest of the bed is for seam, kerf and the overcut at the mouth.
    """
    rim_mm = 2.0 * (reach_mm(profile) + profile.settings(Operation.CUT).overcut_mm.value)
    wide_mm, high_mm = profile.machine.usable_mm
    return wide_mm - rim_mm, high_mm - rim_mm


def body_paths(
    design: Design, profile: LaserProfile, *, separate: bool = False, ends: PieceEnds = WHOLE_ROBOT
) -> BodyPaths:
    """Return the paths of one robot or piece; ``separate`` welds and cuts in two passes.

    In one pass the outline is cut and sealed, open at its mouths; then come the cuts across them.
    """
    if not in_one_pass(profile, separate=separate):
        return _two_passes(design, profile, ends)
    settings, offset = profile.settings(Operation.WELDCUT), weldcut_offset_mm(profile)
    overcut = profile.settings(Operation.CUT).overcut_mm.value
    outline = body_outline(design, offset, ends=ends)
    name = design.name
    paths = (
        *_sealed(Operation.WELDCUT, outline.contour, f"outline of {name}", name),
        _path(Operation.CUT, mouth_cut(outline.contour, overcut), f"mouth of {name}", name),
        *(
            _path(Operation.CUT, cut, f"stub of {name}", name)
            for cut in stub_cuts(outline.contour, overcut)
        ),
    )
    facts: dict[str, object] = {
        "process": "weldcut: seam and cut in one pass",
        "weldcut_offset_mm": offset,
        "weldcut_seam_mm": settings.seam_width_mm.value,
        "weldcut_kerf_mm": settings.kerf_mm.value,
        "weldcut_passes": settings.passes,
        "cut_passes": profile.settings(Operation.CUT).passes,
        "mouth_overcut_mm": overcut,
    }
    return BodyPaths(paths=paths, outline=outline, reach_mm=offset, facts=facts)


def _two_passes(design: Design, profile: LaserProfile, ends: PieceEnds) -> BodyPaths:
    """Weld the seam, open at its mouths; then cut around it and across them in one go."""
    weld, cut = profile.settings(Operation.WELD), profile.settings(Operation.CUT)
    overcut = cut.overcut_mm.value
    outline = body_outline(design, weld_offset_mm(profile), ends=ends)
    around = body_outline(
        design, cut_offset_mm(profile), least_fillet_mm=LEAST_ARC_RADIUS_MM, ends=ends
    )
    name = design.name
    by_hand = sealed_by_hand(profile, separate=True)
    guided = by_hand and Operation.MARK in profile.recipe.by_operation
    paths = (
        *(_sealed(Operation.MARK, around.contour, f"{GUIDE} of {name}", name) if guided else ()),
        *_sealed(Operation.WELD, outline.contour, f"seam of {name}", name),
        _path(Operation.CUT, closed_cut(around.contour, overcut), f"cut around {name}", name),
    )
    facts: dict[str, object] = {
        "process": "weld and cut: the seam first, then the cut around it"
        if not by_hand
        else "mark, seal by hand off the bed, cut",
        "weld_offset_mm": weld_offset_mm(profile),
        "weld_seam_mm": weld.seam_width_mm.value,
        "weld_passes": weld.passes,
        "web_mm": WEB_MM,
        "cut_offset_mm": cut_offset_mm(profile),
        "cut_kerf_mm": cut.kerf_mm.value,
        "cut_passes": cut.passes,
        "cut_overcut_mm": overcut,
    }
    problems = outline.problems or around.problems
    return BodyPaths(
        paths=paths,
        outline=replace(outline, problems=problems),
        reach_mm=cut_offset_mm(profile),
        facts=facts,
    )


def mouth_cut(outline: Contour, overcut_mm: float) -> Contour:
    """Return the straight cut across the mouth of an open outline."""
    return _across(outline.points_mm[-1], outline.points_mm[0], outline.branches[:1], overcut_mm)


def stub_cuts(outline: Contour, overcut_mm: float) -> Iterator[Contour]:
    """Yield the straight cuts across the open ends of an outline's stubs."""
    for segment in outline.segments:
        if segment.part is Part.MOUTH:
            start, end = np.array(segment.start_mm), np.array(segment.end_mm)
            yield _across(start, end, (segment.branch,), overcut_mm)


def _across(first: Floats, last: Floats, branch: tuple[str, ...], overcut_mm: float) -> Contour:
    """Return a straight cut that runs past both of its ends."""
    along = (last - first) / math.dist(first, last)
    return Contour(
        points_mm=np.array([first - overcut_mm * along, last + overcut_mm * along]),
        bulges=np.zeros(1),
        parts=(Part.MOUTH,),
        branches=branch,
        closed=False,
    )


def _sealed(operation: Operation, outline: Contour, label: str, name: str) -> Iterator[LaserPath]:
    """Yield the runs of an outline between its open ends: the whole outline if it has no stub."""
    for at_mouth, run in groupby(outline.segments, key=lambda part: part.part is Part.MOUTH):
        if not at_mouth:
            yield _path(operation, Contour.from_segments(list(run), closed=False), label, name)


def closed_cut(outline: Contour, overcut_mm: float) -> Contour:
    """Return the cut all around an open outline and across its mouth.

    It begins in the middle of the longest straight segment of the tail, away from crotches and
    tips (of the mouth, if nothing else is straight), and runs past its start by the overcut, so
    that no bridge is left where the laser turns on and off.
    """
    segments = list(outline.segments)
    mouth = Segment(
        start_mm=segments[-1].end_mm,
        end_mm=segments[0].start_mm,
        part=Part.MOUTH,
        branch=segments[0].branch,
    )
    ring = [*segments, mouth]
    straight = [row for row, s in enumerate(segments) if not s.bulge and s.part is Part.TAIL]
    straight = straight or [row for row, s in enumerate(segments) if not s.bulge] or [-1]
    row = max(straight, key=lambda row: ring[row].length_mm) % len(ring)
    before, after = split(ring[row], 0.5)
    around = [after, *ring[row + 1 :], *ring[:row], before]
    if overcut_mm > 0.0:
        around.append(split(after, min(1.0, overcut_mm / after.length_mm))[0])
    return Contour.from_segments(around, closed=False)


def split(segment: Segment, share: float) -> tuple[Segment, Segment]:
    """Return the two parts of a straight segment, cut at a share of its length."""
    (x0, y0), (x1, y1) = segment.start_mm, segment.end_mm
    middle = x0 + share * (x1 - x0), y0 + share * (y1 - y0)
    return replace(segment, end_mm=middle), replace(segment, start_mm=middle)


def _path(operation: Operation, contour: Contour, label: str, name: str) -> LaserPath:
    return LaserPath(operation=operation, contour=contour, label=label, of=name)


STRAIGHT_BEFORE_MM = 3.0
"""Straight stub between its last fillet and the sleeve (assumed)."""

STRAIGHT_AFTER_MM = 5.0
"""Straight branch between the sleeve and the branch's own end (assumed)."""

BESIDE_MM = 1.0
"""Film left on each side between the cuts of two sockets whose stubs share a joint (assumed)."""

BLEND_RATIO = 4.0
"""Length of the blend over how far the socket's edge lies outside the branch's (assumed)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SleeveSize:
    """What all sleeves of a robot share."""

    lap_mm: float  # that socket and plug lie on each other, along the branch
    rise_mm: float  # how far a socket's lumen edge lies outside an even branch's, on each side
    socket_on_stub: bool  # whether outer pieces go into stubs, not over them

    @property
    def blend_mm(self) -> float:
        """Length along the branch from the socket's width to the branch's own."""
        return BLEND_RATIO * self.rise_mm

    @property
    def room_mm(self) -> float:
        """Straight side of a branch that a sleeve takes."""
        return STRAIGHT_BEFORE_MM + self.lap_mm + self.blend_mm + STRAIGHT_AFTER_MM


def sleeve_size(build: Build, profile: LaserProfile, *, separate: bool = False) -> SleeveSize:
    """Return the size of a robot's sleeves.

    A plug is wider than its lumen by the film outside it: the seam on both sides, and the web where
    seam and cut are made apart. A socket is wider by as much and the ease.

    While a robot grows, film that is still inside runs away from the base on the inner faces: there
    the rim of a stub trails, that of an outer part would catch. So deployed, the outer part lies
    outside. Mounted as cut, every face turns: as cut the outer part lies inside the stub.

    Parameters
    ----------
    separate
        Whether the robot is welded and cut in two passes although the recipe has one for both.
    """
    if in_one_pass(profile, separate=separate):
        film_mm = profile.settings(Operation.WELDCUT).seam_width_mm.value
    else:
        film_mm = profile.settings(Operation.WELD).seam_width_mm.value + WEB_MM
    settings = build.pieces or PieceSettings()
    return SleeveSize(
        lap_mm=settings.lap_mm,
        rise_mm=film_mm + settings.ease_mm / 2.0,
        socket_on_stub=build.mounting == "tail_inverted",
    )


def piece_ends(partition: Partition, piece: Piece) -> PieceEnds:
    """Return where the outline of a piece begins and ends."""
    return PieceEnds(
        root=piece.root,
        base=outer_end(partition.sleeve(piece.root)) if piece.root else None,
        stubs=tuple((row, stub_end(partition.sleeve(row))) for row in piece.stubs),
    )


def outer_end(sleeve: Sleeve) -> OpenEnd:
    """Return the base of a sleeve's outer piece."""
    return OpenEnd(rim_mm=sleeve.plug_mm) if sleeve.socket_on_stub else _socket(sleeve)


def stub_end(sleeve: Sleeve) -> OpenEnd:
    """Return the end of a sleeve's stub."""
    return _socket(sleeve) if sleeve.socket_on_stub else OpenEnd(rim_mm=sleeve.plug_mm)


def _socket(sleeve: Sleeve) -> OpenEnd:
    return OpenEnd(
        rim_mm=sleeve.socket_mm,
        blend_mm=(sleeve.plug_mm, sleeve.blend_end_mm),
        rise_mm=sleeve.rise_mm,
    )
