"""Marks on the film around robots and pieces: fold lines, labels, depths of plugs.

Marks lie outside the body, because a mark weakens film under pressure. Labels of pieces lie on film
that is cut away: their letters are written on a piece before it is lifted out.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.core.plain_text import GENERATOR, counted
from vinefab.core.validation import Floats
from vinefab.fabrication.job.passes import closes
from vinefab.fabrication.job.placement import SheetRobot
from vinefab.model.design import Design
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour
from vinefab.model.tree import Partition, Sleeve, piece_label
from vinefab.outline.body_outline import FlatLayout, flat_layout
from vinefab.outline.joint import LocalFrame, Point, placed

_WIDTH, _HEIGHT, _ADVANCE = 4, 6, 6
"""Size of the grid on which letters are drawn, and the step from one letter to the next."""

# Lower case is written as upper case. Each word is a stroke, each pair of digits a point (x, y).
_STROKES = {
    "A": "002640 1333",
    "B": "00063645443342413000 0333",
    "C": "4536160501103041",
    "D": "00062644422000",
    "E": "46060040 0333",
    "F": "460600 0333",
    "G": "45361605011030414323",
    "H": "0006 4046 0343",
    "I": "1636 2620 1030",
    "J": "4641301001",
    "K": "0006 460340",
    "L": "060040",
    "M": "0006234640",
    "N": "00064046",
    "O": "100105163645413010",
    "P": "00063645443303",
    "Q": "100105163645413010 2240",
    "R": "00063645443303 2340",
    "S": "453616050413334241301001",
    "T": "0646 2620",
    "U": "060110304146",
    "V": "062046",
    "W": "0610233046",
    "X": "0046 0640",
    "Y": "062346 2320",
    "Z": "06460040",
    "0": "100105163645413010 1234",
    "1": "152620 1030",
    "2": "05163645440040",
    "3": "0516364544334241301001 1333",
    "4": "30360242",
    "5": "460603334241301001",
    "6": "453616050110304142331302",
    "7": "064610",
    "8": "13040516364544331302011030414233",
    "9": "011030414536160504133344",
    "-": "1333",
    "_": "0040",
    ".": "2021",
    "+": "1333 2422",
    "/": "0046",
    ":": "2122 2425",
    "=": "1232 1434",
}


def unwritten(text: str) -> str:
    """Return the letters of a text that the font lacks, each once.

    >>> unwritten("caché no. 2 é")
    'É'
    """
    return "".join(dict.fromkeys(c for c in text.upper() if c != " " and c not in _STROKES))


def text_width_mm(text: str, height_mm: float) -> float:
    """Return the width of a line of text."""
    return max(0, _ADVANCE * len(text.upper()) - (_ADVANCE - _WIDTH)) * height_mm / _HEIGHT


def text_strokes_mm(text: str, height_mm: float) -> list[Floats]:
    """Return the strokes of one line of text that begins at the origin, each shape (k, 2).

    Examples
    --------
    >>> [stroke.tolist() for stroke in text_strokes_mm("l", 6.0)]
    [[[0.0, 6.0], [0.0, 0.0], [4.0, 0.0]]]
    """
    unit = height_mm / _HEIGHT
    return [
        (np.array([*map(int, word)]).reshape(-1, 2) + np.array([_ADVANCE * place, 0.0])) * unit
        for place, letter in enumerate(text.upper())
        for word in _STROKES.get(letter, "").split()
    ]


def lettered(text: str, corner_mm: tuple[float, float], height_mm: float) -> tuple[Contour, ...]:
    """Return a line of text as open contours, one per stroke.

    Examples
    --------
    >>> [len(stroke.points_mm) for stroke in lettered("T1", (0.0, 0.0), 6.0)]
    [2, 2, 3, 2]
    """
    strokes = text_strokes_mm(text, height_mm)
    return tuple(Contour.polyline(np.array(corner_mm) + s, closed=False) for s in strokes)


CLEAR_MM = 3.5
"""Marks stay this far from everything else: VF-L01 asks for 3 mm."""

TICK_MM = 7.0

_STEP_MM = 5.0
_FIRST_BOXES, _MOST_BOXES = 32, 512
"""Places for a label that are looked at together, at first and at most."""

_LINE = 1.5

Box = tuple[float, float, float, float]


def fold_ticks(design: Design, reach_mm: float) -> list[Contour]:
    """Return the two ends of the fold line of the tail, at the trunk's base, outside the body."""
    first = design.build.widths_mm[0] / 2.0 + reach_mm + CLEAR_MM
    ends = [[[0.0, side * first], [0.0, side * (first + TICK_MM)]] for side in (-1.0, 1.0)]
    return [Contour.polyline(np.array(line), closed=False) for line in ends]


MOST_LETTERS = 24
"""Longest name on a label, about as long as its last line: a longer one would cost film."""


def short_name(name: str) -> str:
    """Return a name as it is written on the film: of a long one, its beginning and its end.

    >>> short_name("a_robot_with_a_very_long_name_02")
    'a_robot_with..ng_name_02'
    """
    if len(name) <= MOST_LETTERS:
        return name
    half = MOST_LETTERS // 2
    return f"{name[:half]}..{name[2 - half :]}"


def label_lines(name: str, profile: LaserProfile, part: tuple[int, int]) -> list[str]:
    """Return the lines of a robot's label: name, recipe, version and part number."""
    version = GENERATOR.removeprefix("written by ")
    return [
        short_name(name),
        short_name(profile.recipe.name),
        f"{version} part {part[0]} of {part[1]}",
    ]


class FreeRoom:
    """The area of a sheet that no path occupies.

    Of several robots, ``bodies`` are the areas, so that a label stands next to its robot.
    """

    def __init__(
        self, paths: Sequence[LaserPath], within: Box, bodies: Sequence[shapely.Geometry] = ()
    ) -> None:
        self.within = within
        self.bodies = shapely.STRtree(list(bodies))
        taken = shapely.union_all([region(path.contour) for path in paths])
        # Marks are many and small: each stays a shape apart from that of all paths.
        self._taken: list[shapely.Geometry] = []
        self.take(taken)
        shapely.prepare(self.bodies.geometries)

    def has(self, contour: Contour) -> bool:
        """Whether a mark lies on the sheet, clear of everything else."""
        line = shapely.LineString(contour.points_mm)
        inside = shapely.box(*self.within).buffer(1e-6).covers(line)
        return bool(inside) and not self._near(np.array([line]), CLEAR_MM - 1e-6).any()

    def take(self, shape: shapely.Geometry) -> None:
        """Occupy a shape, so that later marks keep clear of it."""
        shapely.prepare(shape)
        self._taken.append(shape)

    def _near(self, shapes: NDArray[np.object_], by_mm: float) -> NDArray[np.bool_]:
        """Return the mask of shapes within a distance of anything that is occupied."""
        near = np.zeros(len(shapes), dtype=np.bool_)
        for one in self._taken:
            rows = np.flatnonzero(~near)
            near[rows] = shapely.dwithin(one, shapes[rows], by_mm)
        return near

    def box_near(
        self, size_mm: tuple[float, float], to_mm: tuple[float, float], own: int = 0
    ) -> Box | None:
        """Return the free box of a size at a robot whose middle is nearest to a point, or None."""
        # A label that is farther from its robot gets a leader, where the sheet holds several.
        label_beside_mm = 40.0
        for boxes in self._free_boxes(size_mm, to_mm, self._around(own, label_beside_mm)):
            near = boxes
            if len(self.bodies) > 1:  # next to its robot, and nearer to it than to any other
                near = boxes[shapely.dwithin(self.bodies.geometries[own], boxes, label_beside_mm)]
                near = near[self._alone(near, own)]
            if len(near):
                return _bounds(near[0])
        return None

    def box_led(
        self, size_mm: tuple[float, float], to_mm: tuple[float, float], own: int
    ) -> tuple[Box, Contour] | None:
        """Return the free box nearest to a point with a clear leader to a robot, or None."""
        body = self.bodies.geometries[own]
        leader_mm = 80.0  # longest leader
        for boxes in self._free_boxes(size_mm, to_mm, self._around(own, leader_mm)):
            near = boxes[shapely.dwithin(body, boxes, leader_mm)]
            near = near[~shapely.dwithin(body, near, 2.0 * CLEAR_MM)]
            ends = shapely.get_coordinates(shapely.shortest_line(near, body)).reshape(-1, 2, 2)
            share = 1.0 - CLEAR_MM / np.hypot(*(ends[:, 1] - ends[:, 0]).T)
            ends[:, 1] = ends[:, 0] + share[:, None] * (ends[:, 1] - ends[:, 0])
            lines = shapely.linestrings(ends)
            clear = ~self._near(np.asarray(lines), CLEAR_MM - 1e-6)
            # It must not seem to lead to another robot.
            clear &= self._alone(np.asarray(shapely.points(ends[:, 1])), own)
            if clear.any():
                row = int(clear.argmax())
                return _bounds(near[row]), Contour.polyline(ends[row], closed=False)
        return None

    def _around(self, own: int, far_mm: float) -> Box:
        """Return where a label of a robot may lie; anywhere if there is but one robot."""
        if len(self.bodies) < 2:
            return self.within
        x0, y0, x1, y1 = _bounds(self.bodies.geometries[own])
        return x0 - far_mm, y0 - far_mm, x1 + far_mm, y1 + far_mm

    def _free_boxes(
        self, size_mm: tuple[float, float], to_mm: tuple[float, float], around: Box
    ) -> Iterator[NDArray[np.object_]]:
        """Yield the free boxes of a size in a part of the sheet, those nearest to a point first."""
        x0, y0, x1, y1 = self.within
        across = np.arange(x0, x1 - size_mm[0] + 1e-9, _STEP_MM)
        up = np.arange(y0, y1 - size_mm[1] + 1e-9, _STEP_MM)
        across = across[(across + size_mm[0] >= around[0]) & (across <= around[2])]
        up = up[(up + size_mm[1] >= around[1]) & (up <= around[3])]
        x, y = (grid.ravel() for grid in np.meshgrid(across, up))
        away = np.hypot(x + size_mm[0] / 2 - to_mm[0], y + size_mm[1] / 2 - to_mm[1])
        order, done, count = np.argsort(away, kind="stable"), 0, _FIRST_BOXES
        while done < len(order):
            # Ever more at a time: mostly one of the first is free.
            rows = order[done : done + count]
            done, count = done + count, min(2 * count, _MOST_BOXES)
            boxes = shapely.box(x[rows], y[rows], x[rows] + size_mm[0], y[rows] + size_mm[1])
            yield np.asarray(boxes)[~self._near(np.asarray(boxes), CLEAR_MM)]

    def _alone(self, shapes: NDArray[np.object_], own: int) -> NDArray[np.bool_]:
        """Return the mask of shapes clearly nearer to a robot than to any other."""
        mine = shapely.distance(shapes, self.bodies.geometries[own])
        nearer_mm = 1.0  # by so much a label is nearer to its own robot than to any other
        reach = np.asarray(mine + nearer_mm)
        rows, met = self.bodies.query(shapes, predicate="dwithin", distance=reach)
        alone = np.ones(len(shapes), dtype=np.bool_)
        alone[rows[met != own]] = False
        return alone


def _bounds(box: shapely.Geometry) -> Box:
    x0, y0, x1, y1 = shapely.bounds(box).tolist()
    return x0, y0, x1, y1


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelTarget:
    """The target next to which a label is written."""

    near_mm: tuple[float, float]  # where it would best stand
    label: str  # description of its paths
    name: str  # of the design
    own: int  # place of the robot among the bodies


def label_paths(lines: Sequence[str], free: FreeRoom, target: LabelTarget) -> tuple[LaserPath, ...]:
    """Return a text as strokes next to its robot, horizontal or vertical; none without room.

    Where there is room only farther away, a leader shows whose label it is.
    """
    # Letter heights to try, largest first; the smallest keeps strokes over 0.4 mm.
    heights_mm = (4.0, 3.0, 2.5)
    for height in heights_mm:
        found = [
            (box, upright)
            for upright, size in _sizes(lines, height)
            if (box := free.box_near(size, target.near_mm, target.own)) is not None
        ]
        if found:
            middles = [((x0 + x1) / 2.0, (y0 + y1) / 2.0) for (x0, y0, x1, y1), _ in found]
            far = [math.dist(middle, target.near_mm) for middle in middles]
            box, upright = found[far.index(min(far))]
            return _written(lines, free, target, (height, box, upright))
    if len(free.bodies) < 2:
        return ()
    height = heights_mm[-1]
    for upright, size in _sizes(lines, height):
        led = free.box_led(size, target.near_mm, target.own)
        if led is not None:
            paths = _written(lines, free, target, (height, led[0], upright))
            free.take(shapely.LineString(led[1].points_mm))
            return *paths, mark(led[1], f"leader of the {target.label}", target.name)
    return ()


def _sizes(
    lines: Sequence[str], height: float
) -> tuple[tuple[bool, tuple[float, float]], tuple[bool, tuple[float, float]]]:
    """Return the size of a text, horizontal and upright."""
    wide = max(text_width_mm(line, height) for line in lines)
    high = height * (1.0 + _LINE * (len(lines) - 1))
    return (False, (wide, high)), (True, (high, wide))


def _written(
    lines: Sequence[str], free: FreeRoom, target: LabelTarget, place: tuple[float, Box, bool]
) -> tuple[LaserPath, ...]:
    """Return the strokes of a text in a box, which is free no more."""
    height, box, upright = place
    free.take(shapely.box(*box))
    paths = []
    for row, line in enumerate(lines):
        rise = _LINE * height * (len(lines) - 1 - row)
        for stroke in text_strokes_mm(line, height):
            x, y = stroke[:, 0], stroke[:, 1] + rise
            placed = (box[2] - y, box[1] + x) if upright else (box[0] + x, box[1] + y)
            contour = Contour.polyline(np.column_stack(placed), closed=False)
            paths.append(mark(contour, target.label, target.name))
    return tuple(paths)


def mark(contour: Contour, label: str, name: str) -> LaserPath:
    """Return a contour as a path to be marked."""
    return LaserPath(operation=Operation.MARK, contour=contour, label=label, of=name)


def region(contour: Contour) -> shapely.Geometry:
    """Return the area that a path occupies: a line, or all that it encloses."""
    points = contour.flattened_mm(0.05)
    line = shapely.LineString(points)
    if closes(contour) and not contour.closed:
        points = points[:-1]  # without the overcut
    if len(points) < 4:
        return line
    area = shapely.Polygon(points)
    return area if area.is_valid else area.convex_hull


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marking:
    """The marks of a sheet."""

    paths: tuple[LaserPath, ...] = ()
    left_out: tuple[str, ...] = ()  # one message per mark that was left out

    @property
    def facts(self) -> dict[str, object]:
        """The entries of a job's facts."""
        return {"marks_left_out": list(self.left_out)} if self.left_out else {}


def marks_of(
    robots: Sequence[SheetRobot],
    bodies: Sequence[LaserPath],
    profile: LaserProfile,
    within: Box,
    partition: Partition | None = None,
) -> Marking:
    """Return fold lines and labels of robots, or of pieces on one sheet, where there is room."""
    if Operation.MARK not in profile.recipe.by_operation:
        return Marking()
    placed = [robot for robot in robots if robot.placement]
    taken = list(bodies)
    if partition is not None:
        # What seals a piece with stubs is several open paths: its outline encloses it.
        taken = [path for path in bodies if path.operation is Operation.CUT or not path.of]
        taken += [replace(robot.paths[0], contour=robot.outline) for robot in placed]
    free = FreeRoom(taken, within, [body_area(robot) for robot in placed])
    made = [fold_marking(robot, free) for robot in placed if robot.piece in ("", piece_label(0))]
    for path in (path for one in made for path in one.paths):
        free.take(region(path.contour))
    if partition is None:
        for own, robot in enumerate(placed):
            full = label_lines(robot.design.name, profile, (robot.number, robot.count))
            x, y = (robot.outline.points_mm[[0, -1]].sum(axis=0) / 2.0).tolist()
            target = LabelTarget(
                near_mm=(x, y), label=f"label of {robot.title}", name=robot.design.name, own=own
            )
            number = f"{robot.number}/{robot.count}" if robot.count > 1 else ""
            made.append(label_marking(full, {"number": number}, free, target))
    else:
        layout = flat_layout(placed[0].design)
        made += [
            _joint(robot, free, layout, (own, end, sleeve))
            for own, robot in enumerate(placed)
            for sleeve in partition.sleeves
            for end, on in ((SOCKET, sleeve.socket_on), (PLUG, sleeve.plug_on))
            if on == robot.piece
        ]
        made += [
            _piece(robot, free, layout, profile, (own, partition))
            for own, robot in enumerate(placed)
        ]
    return Marking(
        paths=tuple(path for one in made for path in one.paths),
        left_out=tuple(message for one in made for message in one.left_out),
    )


def body_area(robot: SheetRobot) -> shapely.Geometry:
    """Return the area that a robot takes; of a piece with plugs no single path encloses it."""
    if robot.piece:
        return region(robot.outline)
    return max((region(path.contour) for path in robot.paths), key=shapely.area)


def fold_marking(robot: SheetRobot, free: FreeRoom) -> Marking:
    """Return the ends of a robot's fold line; one of them suffices."""
    label = f"fold line of {robot.title}"
    ticks = [robot.on_sheet(tick) for tick in fold_ticks(robot.design, robot.body.reach_mm)]
    paths = tuple(mark(tick, label, robot.design.name) for tick in ticks if free.has(tick))
    return Marking(paths=paths, left_out=() if paths else (f"no room for the {label}",))


def label_marking(
    lines: Sequence[str], short: Mapping[str, str], free: FreeRoom, target: LabelTarget
) -> Marking:
    """Return a label; where all of it has no room, one of its short forms alone.

    Parameters
    ----------
    short
        Short forms by their names; empty ones are left out.
    """
    paths = label_paths(lines, free, target)
    if paths:
        blank = unwritten("".join(lines))
        left_out = (f"no strokes for {blank} in the {target.label}",) if blank else ()
        return Marking(paths=paths, left_out=left_out)
    for what, text in short.items():
        paths = label_paths([text], free, target) if text else ()
        if paths:
            message = f"room only for the {what} in the {target.label}"
            return Marking(paths=paths, left_out=(message,))
    return Marking(left_out=(f"no room for the {target.label}",))


PLUG, SOCKET = "plug", "socket"


def joint_mark(end: str, sleeve: str, title: str) -> str:
    """Return the name of the marks next to a plug or socket."""
    return f"{end} {sleeve} of {title}"


def piece_mark(title: str) -> str:
    """Return the name of a piece's label."""
    return f"label of {title}"


def _at(
    robot: SheetRobot, layout: FlatLayout, branch: int, *places_mm: Point
) -> list[tuple[float, float]]:
    """Return where places lie on the sheet, given along and left of a branch's axis."""
    x, y = layout.start_mm[branch].tolist()
    frame = LocalFrame((x, y), float(layout.heading_rad[branch]))
    flat = np.array([placed(place, frame) for place in places_mm])
    points = robot.on_sheet(Contour.polyline(flat, closed=False)).points_mm
    return [(x, y) for x, y in points.tolist()]


def _joint(
    robot: SheetRobot, free: FreeRoom, layout: FlatLayout, joint: tuple[int, str, Sleeve]
) -> Marking:
    """Return the label next to a plug or socket and, next to a plug, its depth.

    Where no tick has room next to the plug, the label says the depth.
    """
    own, end, sleeve = joint
    name = joint_mark(end, sleeve.label, robot.title)
    beyond = sleeve.plug_mm if end == PLUG else sleeve.socket_mm
    paths: list[LaserPath] = []
    words, left_out = f"{sleeve.label} up", []
    if end == PLUG:
        # As deep as it goes into the socket, on both sides of it.
        first = sleeve.width_mm / 2.0 + robot.body.reach_mm + CLEAR_MM
        for side in (-1.0, 1.0):
            ends = [(sleeve.socket_mm, side * (first + more)) for more in (0.0, TICK_MM)]
            line = np.array(_at(robot, layout, sleeve.branch, *ends))
            tick = Contour.polyline(line, closed=False)
            if free.has(tick):
                paths.append(mark(tick, name, robot.of))
        for path in paths:
            free.take(region(path.contour))
        if not paths:
            words += f" {sleeve.lap_mm:g} mm"
    near, _ = _at(robot, layout, sleeve.branch, (beyond, 0.0), (beyond + 1.0, 0.0))
    target = LabelTarget(near_mm=near, label=name, name=robot.of, own=own)
    label = label_paths([words], free, target)
    if not label:
        left_out.append(f"no room for the label of {name}")
    return Marking(paths=(*paths, *label), left_out=tuple(left_out))


def _piece(
    robot: SheetRobot,
    free: FreeRoom,
    layout: FlatLayout,
    profile: LaserProfile,
    place: tuple[int, Partition],
) -> Marking:
    """Return the label of a piece; where all of it has no room, its letter alone."""
    own, partition = place
    root = next(piece.root for piece in partition.pieces if piece.label == robot.piece)
    middle = float(layout.tree.length_mm[root]) / 2.0 if root else 0.0
    near, _ = _at(robot, layout, root, (middle, 0.0), (middle + 1.0, 0.0))
    target = LabelTarget(near_mm=near, label=piece_mark(robot.title), name=robot.of, own=own)
    copy = f" copy {robot.number} of {robot.count}" if robot.count > 1 else ""
    full = [
        f"{robot.piece} of {counted(len(partition.pieces), 'piece')}{copy}",
        short_name(robot.design.name),
        short_name(profile.recipe.name),
        GENERATOR.removeprefix("written by "),
    ]
    return label_marking(full, {"letter": robot.piece}, free, target)
