"""A map as the plan of its rig: plate, obstacles and border in millimetres of the rig.

Polygons are snapped to a grid, cleaned of slivers and slits, joined where they touch in a point,
and thickened where the printer could not print them.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
import shapely.affinity
from numpy.typing import NDArray
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.model.map import Map, Start
from vinefab.model.start import start_pieces
from vinefab.rig.part import GRID_MM, Printer, RigOptions, ThinPlace

Polygons = NDArray[np.object_]
"""Polygons that do not overlap, shape (n,)."""

MOST_CORNERS = 10_000
"""Of a map that becomes a rig: half a minute of work, and finer than any printer makes."""

_MITRE_LIMIT = 5.0


def refuse_fine(world: Map, source: Path | None = None) -> None:
    """Refuse, before any long work, a map with too many corners; ``source`` is its file."""
    if world.wall_count > MOST_CORNERS:
        problem = f"it has {world.wall_count} corners, and a rig may have {MOST_CORNERS}"
        remedy = "import the drawing again (vinefab map import --simplify-mm)"
        raise UnfitInputError(f"map {world.name!r}", problem, remedy, source)


def polygon_parts(*shapes: BaseGeometry | Polygons) -> Polygons:
    """Return all polygons of geometries; points and lines left over by an overlay are dropped."""
    parts = np.concatenate([shapely.get_parts(shape) for shape in shapes])
    parts = shapely.get_parts(parts[shapely.get_dimensions(parts) == 2])
    return np.asarray(parts[~shapely.is_empty(parts)], dtype=object)


def snapped_union(*shapes: BaseGeometry | Polygons) -> Polygons:
    """Return the union's polygons on the grid `GRID_MM`; where two edges meet is a corner."""
    return polygon_parts(shapely.union_all(polygon_parts(*shapes), grid_size=GRID_MM))


def vanishes(pieces: Polygons, width_mm: float) -> NDArray[np.bool_]:
    """Return the mask of polygons that are nowhere thicker than a width."""
    if width_mm <= 0.0:
        return np.zeros(len(pieces), dtype=bool)
    eroded = shapely.buffer(pieces, -0.5 * width_mm, join_style="mitre", quad_segs=1)
    return np.asarray(shapely.is_empty(eroded), dtype=bool)


def without_slivers(pieces: Polygons, width_mm: float) -> tuple[Polygons, int]:
    """Drop the polygons that are nowhere thicker than a width; also return how many."""
    gone = vanishes(pieces, width_mm)
    return pieces[~gone], int(gone.sum())


def without_slits(pieces: Polygons, width_mm: float) -> tuple[Polygons, int]:
    """Fill the holes that are nowhere wider than a width; also return how many."""
    filled = 0
    result = pieces.copy()
    for index in np.flatnonzero(shapely.get_num_interior_rings(pieces) > 0):
        rings = np.asarray(pieces[index].interiors, dtype=object)
        narrow = vanishes(np.asarray(shapely.polygons(rings), dtype=object), width_mm)
        if narrow.any():
            result[index] = Polygon(pieces[index].exterior, list(rings[~narrow]))
            filled += int(narrow.sum())
    return result, filled


def touching_points(pieces: Polygons) -> NDArray[np.float64]:
    """Return the corners, shape (n, 2), at which rings meet themselves or each other."""
    rings = shapely.get_rings(pieces)
    coordinates, ring = shapely.get_coordinates(rings, return_index=True)
    first = np.ones(len(ring), dtype=bool)  # a ring's last corner repeats its first: leave it out
    first[1:] = ring[1:] != ring[:-1]
    unique, count = np.unique(coordinates[~first], axis=0, return_counts=True)
    return np.asarray(unique[count > 1], dtype=np.float64)


def bridged(pieces: Polygons, within: BaseGeometry, radius_mm: float) -> tuple[Polygons, int]:
    """Join what touches in a single point by a small octagon there.

    Two solids that share only an upright edge are no printable body, and a file of triangles
    cannot say on which side each belongs: four triangles meet at one edge.
    """
    bridges = 0
    rounds = 5
    for _ in range(rounds):
        points = touching_points(pieces)
        if not len(points):
            break
        patches = shapely.MultiPoint(points).buffer(radius_mm, quad_segs=2).intersection(within)
        pieces = snapped_union(pieces, patches)
        bridges += len(points)
    return pieces, bridges


def thin_parts(pieces: Polygons, width_mm: float) -> Polygons:
    """Return the parts of polygons that are thinner than a width.

    They are what an opening (shrink, then grow back) loses. Sharp corners lose their tips too:
    what is smaller than twice the width squared is not counted, which is a tip below 12 degrees.
    """
    # Less a step of the grid: a wall of just the width is thick enough, however it was snapped.
    half_mm = max(0.5 * width_mm - GRID_MM, 0.25 * width_mm)
    # Growing back a hair more keeps rounding errors along the edges out of the difference.
    opened = shapely.buffer(
        shapely.buffer(pieces, -half_mm, join_style="mitre", mitre_limit=_MITRE_LIMIT),
        1.001 * half_mm,
        join_style="mitre",
        mitre_limit=_MITRE_LIMIT,
    )
    lost = polygon_parts(shapely.difference(pieces, opened))
    return lost[shapely.area(lost) > 2.0 * width_mm**2]


_STEPS = 4


def patches_for(pieces: Polygons, width_mm: float) -> tuple[Polygons, BaseGeometry]:
    """Return the parts of polygons thinner than a width, and patches that make them that wide.

    The thin parts are shrunk in small steps; what vanishes in a step is their middle line, to
    within that step, and is grown to the full width. A thin wall so becomes at least as thick as
    the width, and at most a quarter thicker. Tips of sharp corners are left as they are, see
    `thin_parts`.
    """
    thin = thin_parts(pieces, width_mm)
    step_mm = 0.5 * width_mm / _STEPS
    hair_mm = 0.01 * width_mm
    left, patches = thin, []
    crumb_share = 0.02
    for _ in range(_STEPS + 1):
        # A hair more and back again: what is left with hardly any width counts as vanished.
        shrunk = shapely.buffer(left, -(step_mm + hair_mm), join_style="mitre")
        inner = polygon_parts(shapely.buffer(shrunk, hair_mm, join_style="mitre"))
        regrown = shapely.buffer(shapely.union_all(inner), 1.02 * step_mm, join_style="mitre")
        middle = polygon_parts(shapely.difference(left, regrown))
        # The first steps leave crumbs in the corners: a disc around each would bulge out.
        middle = middle[shapely.area(middle) > crumb_share * width_mm**2]
        patches += list(shapely.buffer(middle, 0.5 * width_mm, join_style="mitre", mitre_limit=1.5))
        left = inner
    grown = shapely.union_all(patches) if patches else Polygon()
    return thin, shapely.union_all(polygon_parts(grown))


_NEAR_MM = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """The opening for one start."""

    from_border: BaseGeometry  # area of the border wall to leave open, or empty
    from_plate: BaseGeometry  # area of the plate to leave open, or empty
    note: str = ""  # for the person who builds the rig


def entry_of(
    start: Start, bounds: Polygon, border: BaseGeometry, solids: BaseGeometry, options: RigOptions
) -> Entry:
    """Return the opening for one start, in the coordinates of the plan.

    Looking back from the start against its heading: if the bounds are within
    ``options.entry_reach_mm``, the border is open there, as wide as ``options.entry_width_mm``
    and the start's sideways spread on both sides, straight along the heading. A start further
    inside gets a round hole of the same width through the plate, so that the robot comes up from
    below; if obstacles leave no room for the hole, nothing is opened and the note says so. A line
    or an area gets an opening for each of its free pieces, as wide as the piece is.
    """
    nothing = Polygon()
    if options.entry_width_mm <= 0.0:
        return Entry(from_border=nothing, from_plate=nothing)
    if start.area is not None:
        return _entry_of_area(start, bounds, border, solids, options)
    base = Point(start.pose.x_mm, start.pose.y_mm)
    reach_mm = options.entry_reach_mm
    ray = _backwards(start, reach_mm + max(1.0, reach_mm) * 1e-6)
    wall_to_hole_mm = 1.0
    hole_segments = 12
    if not ray.intersects(bounds.exterior):
        hole = base.buffer(0.5 * options.entry_width_mm, quad_segs=hole_segments)
        if hole.buffer(wall_to_hole_mm).intersects(solids):
            note = "has no room for a hole in the plate: no entry is made"
            hole = nothing
        else:
            note = "has a hole in the plate: the robot comes up from below"
        return Entry(
            from_border=nothing, from_plate=hole, note=f"a start far from the bounds {note}"
        )
    met = nearest_points(base, ray.intersection(bounds.exterior))[1]
    # So far behind the bounds that the border is surely crossed, also when met at 60 degrees.
    behind_mm = 2.0 * options.border_mm + 2.0 * options.entry_width_mm
    # As wide as the base, moved sideways over the start's range of positions.
    sideways_mm = abs(math.sin(start.pose.heading_rad)) * start.spread_x_mm
    sideways_mm += abs(math.cos(start.pose.heading_rad)) * start.spread_y_mm
    line = _backwards(start, base.distance(met) + behind_mm)
    strip = line.buffer(0.5 * options.entry_width_mm + sideways_mm, cap_style="flat")
    # Not what the strip meets further on: the wall of another room of a winding hall.
    cut = [
        piece for piece in polygon_parts(border.intersection(strip)) if piece.dwithin(met, _NEAR_MM)
    ]
    blocked = strip.intersection(bounds).intersection(solids).area > 0.0
    note = "obstacles narrow the way between the entry and its start" if blocked else ""
    return Entry(from_border=shapely.union_all(cut), from_plate=nothing, note=note)


def _entry_of_area(
    start: Start, bounds: Polygon, border: BaseGeometry, solids: BaseGeometry, options: RigOptions
) -> Entry:
    try:
        pieces = start_pieces(start, bounds.difference(solids))
    except BadInputError:  # closed by making solids printable: only the pose is left
        return entry_of(replace(start, area=None), bounds, border, solids, options)
    cosine, sine = math.cos(start.pose.heading_rad), math.sin(start.pose.heading_rad)
    entries = []
    for piece in pieces:  # as from its rear end, the range as wide as the piece is sideways
        points = shapely.get_coordinates(piece)
        ahead, aside = points @ (cosine, sine), points @ (-sine, cosine)
        rear, middle = float(ahead.min()), 0.5 * float(aside.min() + aside.max())
        half_mm = 0.5 * float(aside.max() - aside.min())
        x_mm, y_mm = rear * cosine - middle * sine, rear * sine + middle * cosine
        across = Start(
            pose=replace(start.pose, x_mm=x_mm, y_mm=y_mm),
            spread_x_mm=abs(sine) * half_mm,
            spread_y_mm=abs(cosine) * half_mm,
        )
        entries.append(entry_of(across, bounds, border, solids, options))
    # Robots come from where the bounds are when moved back: walls next to them stay.
    (x_0, y_0), (x_1, y_1) = _backwards(start, 2.0 * options.border_mm).coords
    behind = [
        shapely.affinity.translate(bounds, share * (x_1 - x_0), share * (y_1 - y_0))
        for share in (0.5, 1.0)
    ]
    opened = shapely.intersection(
        shapely.union_all([entry.from_border for entry in entries]), shapely.union_all(behind)
    )
    if opened.is_empty:
        at_pose = entry_of(replace(start, area=None), bounds, border, solids, options)
        words = "only its pose has an entry, as its line or area is far from the bounds"
        return replace(at_pose, note="; ".join(filter(None, (words, at_pose.note))))
    # No posts are left between openings that stand closer together than an entry is wide.
    least_mm2 = options.entry_width_mm * options.border_mm
    posts = [part for part in polygon_parts(border.difference(opened)) if part.area < least_mm2]
    opened = shapely.union_all([opened, *posts])
    count, wide_mm = len(polygon_parts(opened)), opened.area / max(options.border_mm, _NEAR_MM)
    several = (
        f"{counted(count, 'opening')}, {wide_mm:.0f} mm together"
        if count > 1
        else f"{wide_mm:.0f} mm"
    )
    notes = [f"the border is open for its line or area: {several}"]
    if any(entry.from_border.is_empty for entry in entries):
        notes.append("pieces of it further inside have no entry")
    notes += dict.fromkeys(e.note for e in entries if e.note and not e.from_border.is_empty)
    return Entry(from_border=opened, from_plate=Polygon(), note="; ".join(notes))


def _backwards(start: Start, length_mm: float) -> LineString:
    pose = start.pose
    back_x, back_y = -math.cos(pose.heading_rad), -math.sin(pose.heading_rad)
    end = (pose.x_mm + length_mm * back_x, pose.y_mm + length_mm * back_y)
    return LineString([(pose.x_mm, pose.y_mm), end])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigPlan:
    """What stands where, before it is split into parts."""

    plate: BaseGeometry  # outline of the base plate; polygons without holes but those of entries
    solids: (
        Polygons  # obstacles and border, polygons shape (n,) that meet nowhere, within the plate
    )
    # the map's point at the plan's (0, 0), the lower left corner of the bounds' box
    origin_mm: tuple[float, float]
    scale: float  # plan millimetres per map millimetre
    # where solids were thinner than the printer's least wall
    thin_places: tuple[ThinPlace, ...] = ()
    thickened: BaseGeometry = field(default_factory=Polygon)  # what was added there
    slivers: int = 0  # pieces dropped
    slits: int = 0  # holes filled
    bridges: int = 0  # touching corners joined
    notes: tuple[str, ...] = ()  # for the person who prints it

    def to_map(self, z_mm: float = 0.0) -> Floats:
        """Return the transform, shape (4, 4), from the plan into map coordinates."""
        matrix = np.diag([1.0 / self.scale] * 3 + [1.0])
        matrix[:3, 3] = *self.origin_mm, z_mm / self.scale
        return matrix

    def on_map(self, shape: BaseGeometry) -> BaseGeometry:
        """Return a shape of the plan in map coordinates."""
        return shapely.transform(shape, lambda points: points / self.scale + self.origin_mm)


def plan_of(world: Map, printer: Printer, options: RigOptions) -> RigPlan:
    """Return the plan of a map's rig.

    The border stands outside the bounds. Obstacles are clipped to the bounds, then joined with
    each other and with the border wherever they overlap or touch; holes in the bounds are solid.
    """
    refuse_fine(world)
    origin_mm, scale = (world.bounds.bounds[0], world.bounds.bounds[1]), options.scale

    def on_plan(points: Floats) -> Floats:
        return np.asarray((points - np.array(origin_mm)) * scale, dtype=np.float64)

    bounds, *shapes = shapely.transform([world.bounds, *world.obstacles], on_plan)
    inside = Polygon(bounds.exterior)
    holes = polygon_parts(*(Polygon(ring) for ring in bounds.interiors), Polygon())
    joined = snapped_union(np.array(shapes, dtype=object), holes)
    obstacles, slivers = without_slivers(
        polygon_parts(shapely.intersection(joined, inside)), options.sliver_mm
    )
    border_mitre_limit = 2.0
    # The border, outside the bounds, and the plate below it, each with the entries taken out.
    grown = inside.buffer(options.border_mm, join_style="mitre", mitre_limit=border_mitre_limit)
    plate = shapely.union_all([Polygon(piece.exterior) for piece in polygon_parts(grown)])
    border, blocked = plate.difference(inside), shapely.union_all(obstacles)
    entries = []
    for start in world.starts:
        pose = start.pose
        (x_mm, y_mm), *_ = on_plan(np.array([[pose.x_mm, pose.y_mm]])).tolist()
        on_rig = replace(
            start,
            pose=replace(pose, x_mm=x_mm, y_mm=y_mm),
            spread_x_mm=scale * start.spread_x_mm,
            spread_y_mm=scale * start.spread_y_mm,
            area=start.area and shapely.transform(start.area, on_plan),
            clearance_mm=start.clearance_mm * (1.0 if start.area is None else scale),
        )
        entries.append(entry_of(on_rig, inside, border, blocked, options))
    notes = tuple(
        f"start {index}: {entry.note}" for index, entry in enumerate(entries, 1) if entry.note
    )
    if not world.starts:
        notes = ("the map has no start: the border is closed all around",)
    border = border.difference(shapely.union_all([entry.from_border for entry in entries]))
    plate = plate.difference(shapely.union_all([entry.from_plate for entry in entries]))
    plate = shapely.set_precision(plate, GRID_MM)

    solids, more_slivers = without_slivers(snapped_union(obstacles, border), options.sliver_mm)
    solids, slits = without_slits(solids, options.sliver_mm)
    solids, bridges = bridged(solids, plate, 0.5 * printer.nozzle_mm)
    thin, patches = patches_for(solids, printer.least_wall_mm)
    thickened: BaseGeometry = Polygon()
    if len(thin):
        # Nothing grows over the rim, nor into an entry.
        room = shapely.union_all([inside, border])
        thickened = shapely.intersection(patches, shapely.intersection(plate, room))
        solids, bridged_again = bridged(
            snapped_union(solids, thickened), plate, 0.5 * printer.nozzle_mm
        )
        bridges += bridged_again
    points = [piece.representative_point() for piece in thin]
    return RigPlan(
        plate=plate,
        solids=solids,
        origin_mm=origin_mm,
        scale=scale,
        thin_places=tuple(
            ThinPlace(
                x_mm=origin_mm[0] + point.x / scale,
                y_mm=origin_mm[1] + point.y / scale,
                area_mm2=float(piece.area),
            )
            for piece, point in zip(thin, points, strict=True)
        ),
        thickened=shapely.union_all(polygon_parts(thickened)),
        slivers=slivers + more_slivers,
        slits=slits,
        bridges=bridges,
        notes=notes,
    )


TAB_DEPTH_MM = 8.0
_FREE_MM = 2.0
_STEP_MM = 1.0

Cell = tuple[int, int]
"""Row and column of a tile, from 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TileSeam:
    """The straight cut between two neighbouring tiles."""

    # whether it runs along y; the tile that gets the tabs is then the left one, else the lower
    upright: bool
    at_mm: float  # its x when upright, else its y
    # ends along its direction
    low_mm: float
    high_mm: float

    @property
    def line(self) -> shapely.LineString:
        """The cut."""
        ends = [(self.at_mm, self.low_mm), (self.at_mm, self.high_mm)]
        return shapely.LineString(ends if self.upright else [(y, x) for x, y in ends])


def tabs_of(seam: TileSeam, plate: BaseGeometry, solids: shapely.STRtree) -> list[Polygon]:
    """Return the tabs of a seam: dovetails that reach over it to the right or upwards.

    A tab stands only where the plate is whole around it and nothing stands on it: a socket under
    an obstacle would have to be bridged in the air by the printer. Where there is no such place,
    there is no tab.
    """
    end_half_mm = 6.5
    margin_mm = TAB_DEPTH_MM + end_half_mm + _FREE_MM  # clear of the joints of crossing seams
    low, high = seam.low_mm + margin_mm, seam.high_mm - margin_mm
    if high < low:
        return []
    span_per_tab_mm = 90.0
    count = max(1, round((high - low) / span_per_tab_mm))
    ends = np.linspace(low, high, count + 1)
    chosen = []
    neck_half_mm = 4.0
    for left, right in pairwise(ends):
        gap = end_half_mm + _FREE_MM if count > 1 else 0.0
        places = np.arange(np.ceil(left + gap), right - gap + 1e-9, _STEP_MM)
        places = places[np.argsort(np.abs(places - 0.5 * (left + right)), kind="stable")]
        half = end_half_mm + _FREE_MM
        near = np.full_like(places, seam.at_mm - TAB_DEPTH_MM)
        far = np.full_like(places, seam.at_mm + TAB_DEPTH_MM + _FREE_MM)
        sides = (near, places - half, far, places + half)
        boxes = shapely.box(*(sides if seam.upright else (sides[1], near, sides[3], far)))
        is_free = np.asarray(shapely.contains_properly(plate, boxes), dtype=bool)
        is_free[np.unique(solids.query(boxes, predicate="intersects")[0])] = False
        free = places[is_free]
        for at_mm in free[:1].tolist():
            end = seam.at_mm + TAB_DEPTH_MM
            corners = [
                (seam.at_mm, at_mm - neck_half_mm),
                (end, at_mm - end_half_mm),
                (end, at_mm + end_half_mm),
                (seam.at_mm, at_mm + neck_half_mm),
            ]
            chosen.append(Polygon(corners if seam.upright else [(y, x) for x, y in corners]))
    return chosen


def cut_costs_mm(solids: Polygons, axis: int, at_mm: Floats, even_mm: float) -> Floats:
    """Return the costs of cutting polygons along straight lines, in millimetres of cut obstacle.

    A corner within 2 mm of the line counts like 20 mm of obstacle, because a thin tip would be cut
    off; between equals the more even cut is cheaper.

    Parameters
    ----------
    axis
        0 for upright lines, 1 for level ones.
    at_mm
        Their x or y, shape (m,).
    """
    rings = [shapely.get_coordinates(ring)[:-1] for ring in shapely.get_rings(solids)]
    corners = np.concatenate([np.zeros((0, 2)), *rings])
    near = np.sort(corners[:, axis])
    guard_mm = 2.0
    count = np.searchsorted(near, at_mm + guard_mm, side="right")
    count = count - np.searchsorted(near, at_mm - guard_mm)
    # A hair on, where the line runs along an edge: there is an obstacle on one side only.
    ends = np.empty((len(at_mm), 2, 2))
    hair_mm = 1e-9
    ends[:, :, axis] = at_mm[:, None] + hair_mm
    across = corners[:, 1 - axis]
    ends[:, :, 1 - axis] = across.min(initial=0.0), across.max(initial=0.0)
    lines = np.asarray(shapely.linestrings(ends), dtype=np.object_)
    line, piece = shapely.STRtree(solids).query(lines, predicate="intersects")
    cut_mm = shapely.length(shapely.intersection(lines[line], solids[piece]))
    crossed_mm = np.bincount(line, cut_mm, minlength=len(lines))
    corner_cost_mm = 20.0
    return np.asarray(crossed_mm + corner_cost_mm * count + 1e-3 * np.abs(at_mm - even_mm))


_LEAST_TILE_MM = 5.0 * TAB_DEPTH_MM


@dataclass(frozen=True, slots=True, kw_only=True)
class Cuts:
    """The lines of a grid of tiles, the plate's box included."""

    # ascending; tile (row, column) lies between neighbouring values
    x_mm: tuple[float, ...]
    y_mm: tuple[float, ...]
    turned: bool  # whether the tiles are turned by a quarter on the bed

    def cells(self) -> Iterator[tuple[Cell, Polygon]]:
        """Yield row and column of each tile with its rectangle, row by row."""
        for row, (y_low, y_high) in enumerate(pairwise(self.y_mm)):
            for column, (x_low, x_high) in enumerate(pairwise(self.x_mm)):
                yield (row, column), shapely.box(x_low, y_low, x_high, y_high)


def cuts_of(
    box_mm: tuple[float, float, float, float],
    solids: Polygons,
    printer: Printer,
    options: RigOptions,
) -> Cuts:
    """Choose the cut lines.

    As few tiles as the bed allows, in the better of the two ways to lay them on it. Each line may
    wander within what the tile size allows, to cross as little obstacle as possible and to stay
    away from obstacles' corners, so that no thin tip is cut off.
    """
    size_mm = box_mm[2] - box_mm[0], box_mm[3] - box_mm[1]
    columns, rows, turn = grid_of(size_mm, printer, options)
    bed_mm = usable_mm(printer, options)
    if turn:
        bed_mm = bed_mm[1], bed_mm[0]
    return Cuts(
        x_mm=_lines((box_mm[0], box_mm[2]), columns, bed_mm[0], solids, 0),
        y_mm=_lines((box_mm[1], box_mm[3]), rows, bed_mm[1], solids, 1),
        turned=turn,
    )


def grid_of(
    size_mm: tuple[float, float], printer: Printer, options: RigOptions
) -> tuple[int, int, bool]:
    """Return the numbers of columns and rows of a plate's tiles, and whether they lie turned."""
    (width_mm, depth_mm), bed_mm = size_mm, usable_mm(printer, options)
    straight = _count(width_mm, bed_mm[0]), _count(depth_mm, bed_mm[1])
    turned = _count(width_mm, bed_mm[1]), _count(depth_mm, bed_mm[0])
    turn = turned[0] * turned[1] < straight[0] * straight[1]
    columns, rows = turned if turn else straight
    if columns * rows > options.most_parts:
        plate = f"a plate of {width_mm:.0f} x {depth_mm:.0f} mm on {printer.name}"
        problem = f"{plate} needs {columns * rows} parts, and {options.most_parts} are allowed"
        remedy = "use a larger bed or a smaller scale, or give more --most-parts"
        raise UnfitInputError("parts", problem, remedy)
    return columns, rows, turn


def usable_mm(printer: Printer, options: RigOptions) -> tuple[float, float]:
    """Return width and depth of the bed inside its margin."""
    margin_mm = 2.0 * options.bed_margin_mm
    return printer.bed_width_mm - margin_mm, printer.bed_depth_mm - margin_mm


def _count(length_mm: float, bed_mm: float) -> int:
    """Return the number of tiles over a length; all but the last carry joints that stick out."""
    if length_mm <= bed_mm:
        return 1
    tile_mm = bed_mm - TAB_DEPTH_MM
    if tile_mm < _LEAST_TILE_MM:
        least_mm = _LEAST_TILE_MM + TAB_DEPTH_MM
        raise BadInputError("printer.bed", bed_mm, f"at least {least_mm:g} mm without its margin")
    return int(np.ceil((length_mm - 1e-9) / tile_mm))


def _lines(
    span_mm: tuple[float, float], count: int, bed_mm: float, solids: Polygons, axis: int
) -> tuple[float, ...]:
    """Place the cuts one after another, each where it costs least."""
    tile_mm = bed_mm - TAB_DEPTH_MM
    lines = [span_mm[0]]
    for index in range(1, count):
        even_mm = span_mm[0] + (span_mm[1] - span_mm[0]) * index / count
        # Even tiles have this much to spare; half of it to either side keeps every tile on the bed.
        spare_mm = max(0.0, tile_mm - (span_mm[1] - span_mm[0]) / count)
        low, high = even_mm - 0.5 * spare_mm, even_mm + 0.5 * spare_mm
        choices = np.arange(np.ceil(low / _STEP_MM), np.floor(high / _STEP_MM) + 1.0) * _STEP_MM
        if len(choices) == 0:
            choices = np.array([round(even_mm, 3)])
        costs_mm = cut_costs_mm(solids, axis, choices, even_mm)
        # To a micrometre: rounding must not tell two lines that cost the same.
        lines.append(float(choices[np.argmin(np.round(costs_mm, 6))]))
    return (*lines, span_mm[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigTile:
    """The plan of one connected part."""

    cell: Cell  # where in the grid it lies
    # outline and its obstacles and border; both snapped, each corner of one on the other's edge
    # being a corner there too
    plate: Polygon
    solids: Polygons


@dataclass(frozen=True, slots=True, kw_only=True)
class Dovetail:
    """A dovetail between two tiles."""

    giver: Cell  # the tile with the tab
    taker: Cell  # the tile with the socket
    # outlines
    tab: Polygon
    socket: BaseGeometry

    @property
    def gap_mm2(self) -> float:
        """Area between tab and socket that stays empty."""
        return float(self.socket.difference(self.tab).area)


def dovetails_of(plan: RigPlan, cuts: Cuts, clearance_mm: float) -> tuple[list[Dovetail], int]:
    """Return the dovetails of all seams between neighbouring tiles, and how many seams have none.

    No room for a joint is not an error: such tiles are glued.
    """
    plate = plan.plate
    shapely.prepare(plate)
    tree = shapely.STRtree(plan.solids)
    joints: list[Dovetail] = []
    bare = 0
    for seam, giver, taker in _seams(cuts):
        tabs = tabs_of(seam, plate, tree)
        bare += not tabs and seam.line.intersects(plate)
        for tab in tabs:
            socket = tab.buffer(clearance_mm, join_style="mitre")
            x_min, y_min, x_max, y_max = socket.bounds
            # What lies before the seam belongs to the giver.
            if seam.upright:
                x_min = seam.at_mm
            else:
                y_min = seam.at_mm
            beyond = shapely.intersection(socket, shapely.box(x_min, y_min, x_max, y_max))
            joints.append(Dovetail(giver=giver, taker=taker, tab=tab, socket=beyond))
    return joints, bare


def rig_tiles(
    plan: RigPlan, cuts: Cuts, joints: Sequence[Dovetail], least_mm: tuple[float, float]
) -> Iterator[RigTile]:
    """Yield the plans of all parts, row by row.

    Parameters
    ----------
    least_mm
        Width of slivers that are left out, and radius of bridges.
    """
    sliver_mm, bridge_mm = least_mm
    tree = shapely.STRtree(plan.solids)
    for cell, rectangle in cuts.cells():
        tabs = [joint.tab for joint in joints if joint.giver == cell]
        sockets = [joint.socket for joint in joints if joint.taker == cell]
        own = shapely.intersection(plan.plate, rectangle, grid_size=GRID_MM)
        own = shapely.union_all([own, *tabs], grid_size=GRID_MM)
        own = shapely.difference(own, shapely.union_all(sockets), grid_size=GRID_MM)
        for plate in without_slivers(polygon_parts(own), max(least_mm))[0]:
            near = plan.solids[np.sort(tree.query(plate))]
            solids = snapped_union(shapely.intersection(near, plate, grid_size=GRID_MM))
            solids, _ = bridged(without_slivers(solids, sliver_mm)[0], plate, bridge_mm)
            # Snapping moved corners on slanted edges by up to half a step: let the plate follow, so
            # that no solid hangs over its edge and no two edges nearly coincide.
            whole = max(snapped_union(solids, plate), key=shapely.area)
            yield RigTile(cell=cell, plate=whole, solids=solids)


def _seams(cuts: Cuts) -> Iterator[tuple[TileSeam, Cell, Cell]]:
    """Yield each seam with the tile that gives tabs and the one that takes them."""
    x, y = cuts.x_mm, cuts.y_mm
    rows, columns = len(y) - 1, len(x) - 1
    for row in range(rows):
        for column in range(1, columns):
            seam = TileSeam(upright=True, at_mm=x[column], low_mm=y[row], high_mm=y[row + 1])
            yield seam, (row, column - 1), (row, column)
    for row in range(1, rows):
        for column in range(columns):
            seam = TileSeam(upright=False, at_mm=y[row], low_mm=x[column], high_mm=x[column + 1])
            yield seam, (row - 1, column), (row, column)
