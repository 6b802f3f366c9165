"""Shapes of a drawing before it is a map: their frame, repair of rings, joining of loose lines."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, Literal, TypeVar

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.validation import LARGEST_MM, Floats, Ints, positive
from vinefab.model.start import refuse_jagged

Role = Literal["bounds", "obstacle"]

SAME_POINT_MM = 1e-6
"""Points nearer than this are one point: map files hold no finer coordinates."""

_FAR = 10.0


R = TypeVar("R")


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn(Generic[R]):
    """A drawn line, outline or filled area of rings in the units of the source."""

    # A line or outline has one; the rings of a filled area count by even-odd among themselves.
    rings: tuple[R, ...]
    where: str  # its name in messages: ``LINE (handle 2F)``, ``path in line 12``
    # whether the source says that it is closed; the last point need not repeat the first
    closed: bool = True
    # whether the inside is solid wherever it lies; an outline in an outline is a hole
    filled: bool = False
    holes: tuple[R, ...] = ()  # rings that are surely not part of a filled area
    role: Role | None = None  # as the source names it
    # number of the painted element of an SVG drawing that an outline belongs to, None for others
    paint: int | None = None
    even_odd: bool = False  # whether what a ring encloses twice is outside, as the source says
    # widths at both ends of a line that is drawn as wide, in units of the source; only those of a
    # straight line may differ
    wide: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnShape(Drawn[Floats]):
    """A drawn line, outline or filled area whose rings are points, each of shape (n, 2)."""


def as_areas(shapes: tuple[DrawnShape, ...]) -> tuple[DrawnShape, ...]:
    """Return shapes with the outlines of each painted element as one filled area."""
    kept = [shape for shape in shapes if shape.paint is None]
    painted: dict[int, list[DrawnShape]] = {}
    for shape in shapes:
        if shape.paint is not None:
            painted.setdefault(shape.paint, []).append(shape)
    fills = (
        replace(group[0], rings=tuple(shape.rings[0] for shape in group), filled=True, role=None)
        for group in painted.values()
    )
    return (*kept, *fills)


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFrame:
    """How positions in the source become positions in the map."""

    scale_mm_per_unit: float = 1.0  # millimetres of the map per unit of the source
    # x, y: position in the source that becomes the origin of the map
    x: float = 0.0
    y: float = 0.0
    down: bool = False  # whether y points down in the source

    def to_map(self, points: Floats) -> Floats:
        """Return points in the map, mm."""
        away = (points - np.array([self.x, self.y])) * self.scale_mm_per_unit
        return np.asarray(away * np.array([1.0, -1.0 if self.down else 1.0]) + 0.0)

    def place(self, point_mm: Sequence[float] | Floats) -> str:
        """Return a position of the map as text in the coordinates of the source."""
        x = self.x + point_mm[0] / self.scale_mm_per_unit
        y = self.y + point_mm[1] / self.scale_mm_per_unit * (-1.0 if self.down else 1.0)
        digits = 10 if max(abs(x), abs(y)) >= 1e5 else 6
        return f"({x:.{digits}g}, {y:.{digits}g})"


def extent(points: Floats) -> tuple[Floats, Floats]:
    """Return the lower left and upper right corner of points, shape (n, 2), n at least 1."""
    return points.min(axis=0), points.max(axis=0)


def framed(points: Floats, frame: SourceFrame) -> tuple[SourceFrame, float]:
    """Return a frame in which a drawing lies near the origin, and the drawing's larger side.

    A drawing that is farther than ten times its own size from the origin, or farther than a map
    may be, is moved: its lower left corner becomes the map's origin. Survey coordinates come so.
    """
    positive("scale_mm_per_unit", frame.scale_mm_per_unit, 1e9, "mm per unit")
    low, high = extent(points)
    # Halves first: the difference of two huge numbers may not be finite.
    size_mm = float(max(0.5 * high - 0.5 * low)) * frame.scale_mm_per_unit * 2.0
    if size_mm == 0.0:
        raise UnfitInputError(
            "", "the drawing is one single point", "draw lines, outlines or areas"
        )
    least_size_mm = 0.01
    if not least_size_mm <= size_mm <= LARGEST_MM:
        problem = (
            f"the drawing is {size_mm:.6g} mm wide at {frame.scale_mm_per_unit:g} mm per unit, and "
            f"{least_size_mm:g} to {LARGEST_MM:g} mm are allowed"
        )
        raise UnfitInputError("", problem, "set its unit (--scale-mm-per-unit)")
    reach_mm = float(np.abs(frame.to_map(np.array([low, high]))).max())
    if reach_mm <= min(_FAR * size_mm, LARGEST_MM):
        return frame, size_mm
    y = high[1] if frame.down else low[1]
    return (
        SourceFrame(
            scale_mm_per_unit=frame.scale_mm_per_unit, x=float(low[0]), y=float(y), down=frame.down
        ),
        size_mm,
    )


FREE_APART = "free_apart"
"""Fact of a map: the free area that is not part of the region with the start."""


def free_apart(
    mm2: float, place_mm: Sequence[float], *, in_map: bool, other: str
) -> dict[str, object]:
    """Return the fact of free areas that are apart from the one that a map is made for.

    Parameters
    ----------
    mm2, place_mm
        Area of all; a place inside of the largest.
    in_map
        Whether they are free in the map too, though out of reach.
    other
        What reads the source the other way, as a sentence with its option.
    """
    place = [round(float(value), 3) for value in place_mm]
    return {FREE_APART: {"mm2": mm2, "place_mm": place, "in_map": in_map, "other": other}}


@dataclass(slots=True)
class Changes:
    """Counts of the changes between a drawing and its map."""

    frame: SourceFrame  # for positions in messages
    # by kind of change: number, or largest size
    counts: dict[str, object] = field(default_factory=dict)
    layered: bool = False  # whether the source has layers that ``--layer`` can choose
    command: str = "vinefab map import FILE"  # that imports the source, as it was given

    @property
    def layer_advice(self) -> str:
        """What helps to leave shapes out, as the beginning of a list."""
        return "--layer to choose, " if self.layered else ""

    def add(self, what: str, number: int = 1) -> None:
        """Count a change; 0 leaves no entry."""
        if number:
            before = self.counts.get(what, 0)
            self.counts[what] = (before if isinstance(before, int) else 0) + number

    def total(self, what: str, size: float) -> None:
        """Add to a sum of sizes."""
        before = self.counts.get(what, 0.0)
        self.counts[what] = round(size + (before if isinstance(before, float) else 0.0), 6)

    def most(self, what: str, size: float) -> None:
        """Record a size if it is the largest so far."""
        before = self.counts.get(what, 0.0)
        self.counts[what] = max(round(size, 6), before if isinstance(before, float) else 0.0)


def without_repeats(points: Floats, changes: Changes) -> Floats:
    """Return points without those that repeat the one before; a closed ring stays closed."""
    if len(points) < 2:
        return points
    steps = np.hypot(*np.diff(points, axis=0).T)
    if steps.min() > SAME_POINT_MM:
        return points
    kept = np.append(True, steps > SAME_POINT_MM)
    changes.add("duplicate_points_removed", int((~kept).sum()))
    return np.asarray(points[kept])


def ring_polygons(
    points_mm: Floats,
    where: str,
    sliver_mm2: float,
    changes: Changes,
    *,
    even_odd: bool = False,
    may_be_line: bool = True,
) -> list[Polygon]:
    """Return the area inside a ring, as valid polygons.

    A self-crossing ring is cut at its crossings: both lobes of a bow-tie are inside, a hole that
    a bridge joins to its outline is not, spikes vanish. What it encloses twice is inside (the
    nonzero rule) unless the source says even-odd. A ring without area is dropped, but refused if
    it is long and may be meant as a line.
    """
    points = without_repeats(points_mm, changes)
    if len(points) >= 4 or (len(points) == 3 and (points[0] != points[-1]).any()):
        polygon = Polygon(points)
        allowed = "fewer or shorter teeth, no tangle: draw it simpler, or clean the drawing"
        refuse_jagged(where, polygon, allowed)
        if polygon.is_valid and polygon.area > sliver_mm2:
            return [polygon]
        if not polygon.is_valid:
            odd = shapely.make_valid(polygon, method="linework")
            whole = shapely.make_valid(polygon, method="structure", keep_collapsed=False)
            polygons = polygons_of(odd if even_odd else whole, sliver_mm2)
            if polygons:
                changes.add("self_crossings_repaired")
                twice_mm2 = float(whole.area - odd.area)
                if twice_mm2 > sliver_mm2:
                    name = "outside_by_even_odd" if even_odd else "inside_by_nonzero"
                    changes.total(f"enclosed_twice_{name}_mm2", twice_mm2)
                return polygons
    size_mm = float(max(np.ptp(points, axis=0)))
    if may_be_line and size_mm > 10.0 * sliver_mm2**0.5:
        problem = f"an outline {size_mm:.4g} mm long has no area (at most {sliver_mm2:.3g} mm2)"
        place = f"{where} at {changes.frame.place(points[0])}"
        raise UnfitInputError(place, problem, "--wall-mm makes lines walls")
    changes.add("slivers_dropped")
    changes.most("largest_sliver_dropped_mm", size_mm)
    return []


def polygons_of(geometry: BaseGeometry, least_mm2: float = 0.0) -> list[Polygon]:
    """Return the polygons in a geometry that have more than some area."""
    parts = shapely.get_parts(geometry)
    return [part for part in parts if isinstance(part, Polygon) and part.area > least_mm2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A drawn line."""

    points_mm: Floats  # shape (n, 2), n at least 2
    where: str  # its name in messages
    # both ends of the line that is called so, as drawn, shape (2, 2); of a chain, of one part
    drawn_mm: Floats | None = None

    @property
    def ends_mm(self) -> Floats:
        """Both ends of the line as drawn, shape (2, 2)."""
        return self.points_mm[[0, -1]] if self.drawn_mm is None else self.drawn_mm

    @property
    def closed(self) -> bool:
        """Whether it is a ring."""
        return len(self.points_mm) >= 4 and bool((self.points_mm[0] == self.points_mm[-1]).all())

    @property
    def length_mm(self) -> float:
        """Length along it."""
        return float(np.hypot(*np.diff(self.points_mm, axis=0).T).sum())


def chained(lines: list[Line], join_mm: float, changes: Changes) -> list[Line]:
    """Return lines joined end to end where exactly two ends meet.

    Ends within `SAME_POINT_MM` meet. Of the loose ends, pairs within ``join_mm`` are joined, the
    nearest first: where their lines meet if that is within ``join_mm`` too, else halfway.
    """
    found: dict[bytes, Line] = {}
    for line in lines:
        cells = np.round(line.points_mm / (2.0 * SAME_POINT_MM)) + 0.0
        found.setdefault(min(cells.tobytes(), cells[::-1].tobytes()), line)
    changes.add("repeated_lines_removed", len(lines) - len(found))
    return _chains(_bridged(_chains(list(found.values())), join_mm, changes))


def _end_nodes(lines: list[Line], same_mm: float) -> Ints:
    """Return the nodes at which each line begins and ends, shape (n, 2); near ends share a node."""
    ends = np.array([line.points_mm[[0, -1]] for line in lines]).reshape(-1, 2)
    pairs = scipy.spatial.cKDTree(ends).query_pairs(same_mm, output_type="ndarray")
    graph = scipy.sparse.coo_array((np.ones(len(pairs)), pairs.T), shape=(len(ends), len(ends)))
    return np.asarray(
        scipy.sparse.csgraph.connected_components(graph, directed=False)[1], dtype=np.int64
    ).reshape(-1, 2)


def _chains(lines: list[Line]) -> list[Line]:
    """Return maximal chains through nodes at which exactly two ends meet.

    Ends are numbered 2 x line, + 1 at its last point. `shapely.line_merge` finds the same chains,
    but leaves open where they begin, which way they run, their order and their lines.
    """
    if not lines:
        return []
    node_of = _end_nodes(lines, SAME_POINT_MM).ravel().tolist()
    at: dict[int, list[int]] = {}
    for index, node in enumerate(node_of):
        at.setdefault(node, []).append(index)
    used = np.zeros(len(lines), dtype=np.bool_)
    chains = []
    # Chains with ends first; the rest are rings, which begin with their first line.
    starts = [end for ends in at.values() if len(ends) != 2 for end in ends]
    for first in [*starts, *range(0, 2 * len(lines), 2)]:
        end, parts = first, list[Floats]()
        while not used[end // 2]:
            used[end // 2] = True
            points = lines[end // 2].points_mm
            parts.append((points if end % 2 == 0 else points[::-1])[1 if parts else 0 :])
            far = end ^ 1
            meeting = at[node_of[far]]
            if len(meeting) != 2:
                break
            end = meeting[0] if meeting[1] == far else meeting[1]
        if parts:
            points = np.concatenate(parts)
            if len(points) >= 4 and node_of[far] == node_of[first]:
                points[-1] = points[0]
            named = lines[first // 2]
            chains.append(Line(points_mm=points, where=named.where, drawn_mm=named.ends_mm))
    return chains


def _line_strings(points: list[Floats]) -> NDArray[np.object_]:
    owner = np.repeat(np.arange(len(points)), [len(own) for own in points])
    return np.asarray(shapely.linestrings(np.concatenate(points), indices=owner))


def _named(parts: list[Floats], lines: list[Line]) -> list[Line]:
    """Return parts of lines, each called as the line that its first segment comes from."""
    begins = shapely.points(np.array([own[:2].mean(axis=0) for own in parts]).reshape(-1, 2))
    tree = shapely.STRtree(_line_strings([line.points_mm for line in lines]))
    nearest = np.asarray(tree.nearest(begins)).tolist()
    return [
        Line(points_mm=own, where=lines[index].where, drawn_mm=lines[index].ends_mm)
        for own, index in zip(parts, nearest, strict=True)
    ]


def _bridged(lines: list[Line], join_mm: float, changes: Changes) -> list[Line]:
    """Return lines with their loose ends moved together in pairs, the nearest first."""
    loose = _loose_ends(lines)
    spots = np.array([_end(lines, end) for end in loose]).reshape(-1, 2)
    if len(spots) < 2:
        return lines
    pairs = scipy.spatial.cKDTree(spots).query_pairs(join_mm, output_type="ndarray")
    gaps = np.hypot(*(spots[pairs[:, 0]] - spots[pairs[:, 1]]).T)
    points = [line.points_mm.copy() for line in lines]
    taken: set[int] = set()
    for order in np.argsort(gaps, kind="stable").tolist():
        one, other = (int(index) for index in pairs[order])
        own = lines[loose[one] // 2]
        folds = loose[one] // 2 == loose[other] // 2 and (
            len(own.points_mm) < 4 or own.length_mm < 3.0 * gaps[order]
        )  # a short line onto itself
        if folds or taken & {one, other}:
            continue
        taken |= {one, other}
        corner = _corner(_leg(lines, loose[one]), _leg(lines, loose[other]), join_mm)
        for end in (loose[one], loose[other]):
            points[end // 2][-1 if end % 2 else 0] = corner
        changes.add("gaps_joined")
        changes.most("largest_gap_joined_mm", float(gaps[order]))
    return [
        Line(points_mm=new, where=line.where, drawn_mm=line.ends_mm)
        for new, line in zip(points, lines, strict=True)
    ]


def _leg(lines: list[Line], end: int) -> Floats:
    """Return an end and the point before it, shape (2, 2)."""
    points = lines[end // 2].points_mm
    return points[[-1, -2]] if end % 2 else points[:2]


def _corner(one: Floats, other: Floats, join_mm: float) -> Floats:
    """Return where two ends are joined: where their lines meet, or halfway between them."""
    middle = 0.5 * (one[0] + other[0])
    along, across = one[0] - one[1], other[0] - other[1]
    turn = float(along[0] * across[1] - along[1] * across[0])
    if turn == 0.0:
        return np.asarray(middle)
    away = other[0] - one[0]
    share = float(away[0] * across[1] - away[1] * across[0]) / turn
    meeting = one[0] + share * along
    far = max(float(np.hypot(*(meeting - leg[0]))) for leg in (one, other))
    return np.asarray(meeting if far <= join_mm else middle)


def _loose_ends(lines: list[Line]) -> list[int]:
    """Return the ends that meet no other end; ends are numbered 2 x line, + 1 at its last point."""
    if not lines:
        return []
    nodes = _end_nodes(lines, SAME_POINT_MM).ravel()
    alone = np.bincount(nodes)[nodes] == 1
    return [int(end) for end in np.flatnonzero(alone)]


def _end(lines: list[Line], end: int) -> Floats:
    return np.asarray(lines[end // 2].points_mm[-1 if end % 2 else 0])


_BEYOND = 1e-3
_MOST_NAMED = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Joined:
    """Loose lines after joining."""

    rings: list[Line]  # closed lines
    open: list[Line]  # lines that enclose nothing


def join(lines: list[Line], join_mm: float, changes: Changes) -> Joined:
    """Join loose lines into rings.

    Lines are chained end to end, see `chained`. Chains that stay open are cut at their crossings:
    ends that stop just short of a line are extended onto it, parts that reach beyond a crossing
    are trimmed, and the faces between them give the rings.
    """
    chains = chained(lines, join_mm, changes)
    rings = [line for line in chains if line.closed]
    rest = [line for line in chains if not line.closed]
    if len(rest) == 0:
        return Joined(rings=rings, open=[])
    more, left = _cut_at_crossings(rest, lines, join_mm, changes)
    return Joined(rings=rings + more, open=left)


def _cut_at_crossings(
    lines: list[Line], drawn: list[Line], join_mm: float, changes: Changes
) -> tuple[list[Line], list[Line]]:
    points = [line.points_mm for line in lines]
    strings = _line_strings(points)
    tree = shapely.STRtree(strings)
    loose = np.array(_loose_ends(lines), dtype=np.int64)
    spots = shapely.points(np.array([_end(lines, end) for end in loose]).reshape(-1, 2))
    found, line = tree.query(spots, predicate="dwithin", distance=join_mm)
    # Only ends that are near a line other than their own.
    for end in np.unique(loose[found[line != loose[found] // 2]]).tolist():
        own, last = end // 2, end % 2 == 1
        spot = lines[own].points_mm[-1 if last else 0]
        near = tree.query(shapely.points(spot), predicate="dwithin", distance=join_mm)
        near = near[near != own]
        if len(near) == 0:
            continue
        target = strings[near[np.argmin(shapely.distance(strings[near], shapely.points(spot)))]]
        onto = shapely.get_coordinates(shapely.shortest_line(shapely.points(spot), target))[1]
        gap_mm = float(np.hypot(*(onto - spot)))
        # A point computed on a line may miss it in the last bit; going beyond surely crosses it.
        ahead = (onto - spot) / gap_mm if gap_mm else _direction(lines[own].points_mm, last=last)
        beyond = onto + _BEYOND * join_mm * ahead
        points[own] = np.insert(points[own], len(points[own]) if last else 0, beyond, axis=0)
        changes.add("ends_led_onto_lines")
        changes.most("largest_gap_joined_mm", gap_mm)
    extended = [
        Line(points_mm=new, where=line.where, drawn_mm=line.ends_mm)
        for new, line in zip(points, lines, strict=True)
    ]
    noded = shapely.union_all(_line_strings([line.points_mm for line in extended]))
    faces, cuts, dangles, _ = shapely.polygonize_full(shapely.get_parts(noded))
    parts = shapely.get_parts(shapely.line_merge(shapely.union_all(np.array([cuts, dangles]))))
    long = shapely.length(parts) > join_mm * (1.0 + 2.0 * _BEYOND)
    trimmed = [part for part in parts[~long] if part.length > 2.0 * _BEYOND * join_mm]
    changes.add("overshoots_trimmed", len(trimmed))
    rings = shapely.get_rings(shapely.get_parts(faces))
    enclosing, left = (
        _named([shapely.get_coordinates(part) for part in found], drawn)
        for found in (rings, parts[long])
    )
    return enclosing, left


def _direction(points: Floats, *, last: bool) -> Floats:
    along = points[-1] - points[-2] if last else points[0] - points[1]
    return np.asarray(along / max(float(np.hypot(*along)), 1e-300))


def refuse_open(
    lines: list[Line],
    join_mm: float,
    changes: Changes,
    closing_mm: float | None,
    size_mm: float,
) -> BadInputError:
    """Return the error that names the open lines, their ends and the options that help."""
    wall_share = 5e-3  # of the drawing's size: a thickness to begin with (assumed)
    wall_mm = float(f"{wall_share * size_mm:.1g}")
    walls = f"--wall-mm {wall_mm:g} --open wall --bounds box --margin-mm 0 --out map.geojson"
    count = len(lines)
    named = "; ".join(open_places(lines[:_MOST_NAMED], changes))
    more = f"; and {count - _MOST_NAMED} more" if count > _MOST_NAMED else ""
    here = "" if closing_mm is None else f" (here --join-mm {closing_mm:.4g} would do)"
    lines_do = "a line does" if count == 1 else f"{count} lines do"
    return UnfitInputError(
        "",
        f"{lines_do} not close within --join-mm ({join_mm:.4g}): {named}{more}",
        f"join the ends{here}, {changes.layer_advice}--open drop to leave them out; or, as of "
        f"a room with door gaps, make them walls ({wall_mm:g} mm thick, assumed): "
        f"{changes.command} {walls}",
    )


def closing_gap_mm(
    lines: list[Line], left: list[Line], most_mm: float, changes: Changes
) -> float | None:
    """Return a width of gaps that, when joined, leaves no line open; None if none was found.

    Parameters
    ----------
    lines, left
        All loose lines, and those that stayed open.
    most_mm
        The widest gap that may be joined.
    """
    ends = np.array([line.points_mm[[0, -1]] for line in left]).reshape(-1, 2)
    gap_mm = float(np.max(scipy.spatial.cKDTree(ends).query(ends, k=[2])[0]))
    # Printed with four digits, so that what is typed is at least the gap.
    typed_mm = float(f"{gap_mm * (1.0 + 1e-3):.4g}")
    if typed_mm > most_mm:
        return None
    return None if join(lines, typed_mm, Changes(changes.frame)).open else typed_mm


def open_places(lines: list[Line], changes: Changes) -> list[str]:
    """Return the name and the ends of each line as drawn, in the coordinates of the source."""
    return [
        f"{line.where} from {changes.frame.place(line.ends_mm[0])} "
        f"to {changes.frame.place(line.ends_mm[1])}"
        for line in lines
    ]


def walls_along(
    lines: list[Line], wall_mm: float, join_mm: float, changes: Changes
) -> list[Polygon]:
    """Return lines as walls of some thickness; walls that meet are one polygon.

    Walls end flat where a line ends; where three or more meet they fill the corner.
    """
    chains = chained(lines, join_mm, changes)
    loose = set(_loose_ends(chains))
    meeting = [end not in loose and not chains[end // 2].closed for end in range(2 * len(chains))]
    walls: list[BaseGeometry] = []
    for index, line in enumerate(chains):
        points = line.points_mm.copy()
        if meeting[2 * index]:
            points[0] = points[0] + 0.5 * wall_mm * _direction(points, last=False)
        if meeting[2 * index + 1]:
            points[-1] = points[-1] + 0.5 * wall_mm * _direction(points, last=True)
        middle = shapely.LinearRing(points) if line.closed else LineString(points)
        wall = shapely.buffer(middle, 0.5 * wall_mm, cap_style="flat", join_style="mitre")
        walls.append(wall)
    changes.add("lines_made_walls", len(chains))
    return polygons_of(shapely.union_all(walls))
