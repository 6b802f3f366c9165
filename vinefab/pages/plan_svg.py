"""Maps, robots, starts and outlines as SVG text that a page moves: the studio and its snapshots.

Pictures that stay as they are belong to `vinefab.pages.plan`. Here the page takes the parts apart
again: it drags obstacles and starts, shortens branches and changes its colours, so every part is an
element with a class, in the units of the map.

Coordinates are millimetres of the map with y turned over (SVG counts downwards); no transform
stands on the whole. How things look is left to ``templates/plan.css``; the ``<svg>`` around them
has the class ``plan``. Two things are the page's:

- Marks and lines keep their size on screen if the page sets the CSS variable ``--mm-per-px``, the
  millimetres that a pixel shows, on the ``<svg>``: at the beginning and whenever the zoom changes.
- A robot at front length s, without asking anybody: every path with ``data-branch`` shows ``s -
  data-base`` of its length (``stroke-dasharray="LENGTH 1e9"``), nothing if that is not positive,
  all of it from ``data-grown`` on; what has ``data-front`` is seen once s has reached it. Branches
  at rest, contacts and lengths are exact. What grows on is not: a tip that slides along a wall
  turns the stretch behind it, and dashes show that stretch where it comes to lie in the end, so
  that the tip may be centimetres off. The exact shape is `robot_svg` of ``History.at(s)``.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from xml.sax.saxutils import escape

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.map import Map, Pose
from vinefab.model.outline import Contour
from vinefab.model.target import Target
from vinefab.pages.panel import LEVEL_COLOURS
from vinefab.pages.plan import (
    STOP_WORDS,
    UNSEEN_DETAIL,
    Box,
    longer_mm,
    lost_places,
    start_marks,
)
from vinefab.physics.tube import inflated_diameter_mm

_MOST_BRANCHES = 3000
"""A robot of more branches is drawn without detail: one path per level, no marks."""

MOST_OBSTACLES = 10_000
"""A map of more obstacles is drawn as one path: a page could not hold an element for each."""


_COARSE = 5.0
"""Factor of detail that is too fine to be seen on a drawing without detail."""

STOP_SIGNS = {
    Stop.FULL_LENGTH: '<circle r="2.7"/>',
    Stop.HEAD_ON: '<path d="M-3.8-2.3-2.3-3.8 0-1.5 2.3-3.8 3.8-2.3 1.5 0 3.8 2.3 2.3 3.8 0 1.5'
    '-2.3 3.8-3.8 2.3-1.5 0Z"/>',
    Stop.CORNER: '<path d="M0-4.2 4 3H-4Z"/>',
    Stop.PRESSURE: '<path d="M-3.1-3.1H3.1V3.1H-3.1Z"/>',
    Stop.BRANCH: '<path d="M0-4.4 4.4 0 0 4.4-4.4 0Z"/>',
    Stop.NOT_EVERTED: '<circle r="4"/>',
    Stop.NOT_DEPLOYED: '<circle r="5.4"/>',
}
"""Signs of tips by their reason to stop, in pixels around them; the shape alone says it. A ring
around a tip: branches never emerged there."""

CONTACT = '<path d="M0-2.1 2.1 0 0 2.1-2.1 0Z"/>'
"""Sign of a body wrapped around a wall, in pixels around it."""


def ground_svg(world: Map, *, detail: bool = True) -> str:
    """Return bounds, obstacles and the ranges of starts of a map as ``<g class="ground">``.

    Every obstacle is one path with its index as ``data-obstacle``, what is solid around
    the bounds another one without. Without ``detail`` all of them are one path, simplified for a
    small picture.
    """
    longest_mm, apart = longer_mm(world.bounds.bounds), len(world.obstacles) <= MOST_OBSTACLES
    whole = shapely.box(*world.bounds.bounds)
    outside = list[Polygon]()
    if world.bounds.interiors or not world.bounds.equals(whole):
        # A cut may leave lines and points next to polygons.
        parts = shapely.get_parts(shapely.difference(whole, world.bounds)).tolist()
        outside = [part for part in parts if isinstance(part, Polygon)]
    shapes = [world.bounds, *outside, *world.obstacles]
    corners = int(shapely.get_num_coordinates(shapes).sum())
    # A map of more corners is drawn without those that are too fine to be seen.
    most_corners = 10_000
    if not (detail and apart) or corners > most_corners:
        coarse = UNSEEN_DETAIL if detail else _COARSE * UNSEEN_DETAIL
        shapes = shapely.simplify(shapes, coarse * longest_mm).tolist()
    edge, *solid = _rings_paths(shapes)
    if detail and apart:
        rock = [f'<path class="rock" d="{path}"/>' for path in solid[: len(outside)]]
        rock += [
            f'<path class="rock" data-obstacle="{index}" d="{path}"/>'
            for index, path in enumerate(solid[len(outside) :])
        ]
    else:
        rock = [f'<path class="rock merged" d="{"".join(solid)}"/>'] if solid else []
    free, line = f'<path class="free" d="{edge}"/>', f'<path class="bounds" d="{edge}"/>'
    starts = ""
    for mark in start_marks(world, world.bounds.bounds):  # nothing for a single pose
        parts = []
        if mark.fan is not None:
            parts.append(f'<path class="fan" d="{_line_path(mark.fan)}"/>')
        if mark.whole is not None:
            areas = [piece for piece in mark.free if isinstance(piece, Polygon)]
            parts += [f'<path class="fan" d="{path}"/>' for path in _rings_paths(areas)]
            lines = [piece for piece in mark.free if not isinstance(piece, Polygon)]
            parts += [f'<path class="places" d="{_line_path(line)}"/>' for line in lines]
            parts.append(f'<path class="whole" d="{_line_path(mark.whole)}"/>')
        starts += f'<g class="range">{"".join(parts)}</g>' if parts else ""
    return f'<g class="ground">{free}{"".join(rock)}{line}{starts}</g>'


def robot_svg(
    deployment: Deployment,
    widths_mm: Floats,
    *,
    is_growing: NDArray[np.bool_] | None = None,
    detail: bool = True,
) -> str:
    """Return a robot as ``<g class="robot">``: bodies and centrelines by level, the trunk on top.

    Parameters
    ----------
    widths_mm
        Lay-flat width of each branch, shape (n,); where it is 0, only centrelines are drawn.
    is_growing
        Which branches grow on, shape (n,), in an earlier shape: their tips have no mark.
    detail
        Give every branch one path that can be shortened to any front length
        (``data-branch``, ``data-base``, ``data-grown``), and mark contacts and tips. Without it
        a level is one path.
    """
    detail = detail and len(deployment.tree) <= _MOST_BRANCHES
    points = _placed(deployment.points_mm)
    first = deployment.first_point.tolist()
    paths = [_chain_path(points[a:b]) for a, b in pairwise(first)]
    marked = [""] * len(paths)
    if detail:  # by these attributes a page finds a branch and shortens it
        ways = zip(
            deployment.tree.ids,
            deployment.base_mm.tolist(),
            deployment.grown_mm.tolist(),
            strict=True,
        )
        marked = [
            f' data-branch="{name}" data-base="{round(base, 3):.10g}"'
            f' data-grown="{round(grown, 3):.10g}"'
            for name, base, grown in ways
        ]

    def courses(branches: Sequence[int], usual_mm: float | None = None) -> str:
        """Return the paths of some branches; bodies of another width than usual say their own."""
        alike: dict[tuple[int, str], list[int]] = {}
        for branch in branches:
            width_mm = float(widths_mm[branch])
            own = "" if usual_mm in (None, width_mm) else f' stroke-width="{_across(width_mm)}"'
            alike.setdefault((branch if detail else 0, own), []).append(branch)
        return "".join(
            f'<path{marked[rows[0]]}{own} d="{"".join(paths[row] for row in rows)}"/>'
            for (_, own), rows in alike.items()
        )

    parts = []
    for level in range(int(deployment.tree.level.max()), 0, -1):
        out = np.flatnonzero((deployment.tree.level == level) & deployment.deployed).tolist()
        widest_mm = float(widths_mm[deployment.tree.level == level].max())
        # One opacity for the bodies of a level, so that crossings do not darken.
        body = ""
        if widest_mm:
            bodies = courses(out, widest_mm)
            body = f'<g class="body" stroke-width="{_across(widest_mm)}">{bodies}</g>'
        colour, course = (level - 1) % len(LEVEL_COLOURS) + 1, courses(out)
        parts.append(f'<g class="level level-{colour}">{body}<g class="line">{course}</g></g>')
    if detail:
        at_rest = deployment.deployed if is_growing is None else deployment.deployed & ~is_growing
        words = STOP_WORDS[Stop.NOT_DEPLOYED]
        # A ring at every end of the body at which branches never emerged.
        lost = "" if is_growing is not None else "".join(
            f'<g class="mark {stop_class(Stop.NOT_DEPLOYED)}" '
            f'data-front="{_text(place.front_mm)}" transform="translate({_pair(*place.at_mm)})">'
            f"{STOP_SIGNS[Stop.NOT_DEPLOYED]}"
            f"<title>{counted(place.count, 'branch')} {words} (simulated)</title></g>"
            for place in lost_places(deployment)
        )  # fmt: skip
        tips = f'<g class="tips">{lost}{_tips(deployment, points, at_rest)}</g>'
        parts += [_contacts(deployment, points), tips]
    attributes = f'data-full="{_text(deployment.full_mm)}"'
    return f'<g class="robot" {attributes}>{"".join(parts)}</g>'


def outline_svg(contour: Contour) -> str:
    """Return a contour of lines and arcs as one exact path, ``class="outline"``."""
    return f'<path class="outline" d="{contour_path(contour)}"/>'


def contour_path(contour: Contour) -> str:
    """Return a contour as the ``d`` of an SVG path, y turned over; arcs stay arcs."""
    points = [(x, y) for x, y in contour.points_mm.tolist()]
    steps = [f"M{_pair(*points[0])}"]
    ends = points[1:] + points[:1]
    for start, end, bulge in zip(points, ends, contour.bulges.tolist(), strict=False):
        steps.append(f"L{_pair(*end)}" if bulge == 0.0 else _arc(start, end, bulge))
    return "".join(steps) + ("Z" if contour.closed else "")


def area_svg(area: BaseGeometry, name: str) -> str:
    """Return polygons as one path of a class."""
    parts = [part for part in shapely.get_parts(area).tolist() if isinstance(part, Polygon)]
    return f'<path class="{name}" d="{"".join(_rings_paths(parts))}"/>'


def lines_svg(lines_mm: Sequence[Floats], name: str) -> str:
    """Return chains of points as one path of a class."""
    course = "".join(_chain_path(_placed(line)) for line in lines_mm)
    return f'<path class="{name}" d="{course}"/>'


def pose_svg(pose: Pose, size_mm: float) -> str:
    """Return a start as ``<g class="pose">``: a dot and an arrow of a size, both to be grabbed.

    The group alone has the place and the heading in its ``transform``; a page that drags it sets
    ``translate(x -y) rotate(-heading_deg)`` anew.
    """
    neck, barb, dot = (_text(size_mm * share) for share in (0.66, 0.14, 0.12))
    place = f"translate({_pair(pose.x_mm, pose.y_mm)}) rotate({_text(-pose.heading_deg)})"
    return (
        f'<g class="pose" transform="{place}"><path class="shaft" d="M0 0H{neck}"/>'
        f'<path class="handle heading" d="M{_text(size_mm)} 0L{neck} {barb}V-{barb}Z"/>'
        f'<circle class="handle base" r="{dot}"/></g>'
    )


def targets_svg(targets: Sequence[Target], states: Sequence[str] = ()) -> str:
    """Return targets with their tolerance, each a group of its name, with its state if known."""
    parts = []
    for target, state in zip(targets, states or [""] * len(targets), strict=True):
        touched = " touched" if state == "touched" else " missed" if state else ""
        name = escape(target.name, {'"': "&quot;"})
        within = target.shape.buffer(target.tolerance_mm)
        area = f'<path class="within" d="{shape_path(within)}"/>' if within.area > 0.0 else ""
        words = f"{name} {state}" if state else name
        parts.append(
            f'<g class="target{touched}" data-target="{name}">{area}'
            f'<g transform="translate({_pair(*target.middle_mm)})"><g class="sized">'
            f'<circle class="hand" r="12"/><path class="cross" d="M-6 0H6M0-6V6"/>'
            f'<text x="9" y="-7">{words}</text></g></g></g>'
        )
    return "".join(parts)


def frame_svg(place_mm: Callable[[float, float], tuple[float, float]]) -> str:
    """Return the frame of the chosen object, with handles to resize and to turn it.

    Parameters
    ----------
    place_mm
        Gives a place of the frame, from -1 to 1 along its axes.
    """
    corners = [place_mm(*corner) for corner in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    ring = " ".join(_pair(*corner) for corner in corners)
    turn = _pair(*place_mm(1.6, 0))
    handles = (
        f'<g transform="translate({place})"><g class="sized">'
        f'<circle class="handle {name}" r="7"/></g></g>'
        for name, place in (("size", _pair(*corners[2])), ("turn", turn))
    )
    arm = f"M{_pair(*place_mm(1, 0))}L{turn}"
    return f'<path class="frame" d="M{ring}Z{arm}"/>{"".join(handles)}'


def bends_svg(places_mm: Mapping[int, tuple[float, float]]) -> str:
    """Return a handle at each preformed bend of the chosen branch, by its place in the list."""
    return "".join(
        f'<g transform="translate({_pair(*place)})"><g class="sized">'
        f'<rect class="handle bend" data-bend="{bend}" x="-5.5" y="-5.5" width="11" height="11"/>'
        "</g></g>"
        for bend, place in places_mm.items()
    )


def legend_rows() -> list[tuple[str, str]]:
    """Return the signs of a plan, each as SVG around the origin, in pixels, and its meaning."""
    rows = [
        (f'<g class="mark {stop_class(stop)}">{sign}</g>', f"tip {STOP_WORDS[stop]}")
        for stop, sign in STOP_SIGNS.items()
    ]
    contact = f'<g class="contacts">{CONTACT}</g>'
    target = '<g class="target"><path class="cross" d="M-6 0H6M0-6V6"/></g>'
    return [
        *rows, (contact, "body around a wall"), (target, "target; its tolerance around it"),
        ('<path class="rock" d="M-6-6H6V6H-6Z"/>', "obstacle"),
        ('<path class="range-sign" d="M-6-6H6V6H-6Z"/>', "where poses are drawn from"),
    ]  # fmt: skip


def shape_path(shape: BaseGeometry) -> str:
    """Return polygons as the ``d`` of a path."""
    return "".join(_rings_paths(shapely.get_parts(shape).tolist()))


def _line_path(shape: BaseGeometry) -> str:
    """Return a line, or the rings of a polygon, as the ``d`` of a path."""
    lines = shapely.get_rings(shape) if isinstance(shape, Polygon) else [shape]
    return "".join(_chain_path(_placed(shapely.get_coordinates(line))) for line in lines)


def view_box(box_mm: Box, rim_mm: float = 0.0) -> str:
    """Return the ``viewBox`` that shows a box of the map and a rim around it."""
    x_min, y_min, x_max, y_max = box_mm
    size = (x_max - x_min + 2.0 * rim_mm, y_max - y_min + 2.0 * rim_mm)
    return f"{_pair(x_min - rim_mm, y_max + rim_mm)} {_text(size[0])} {_text(size[1])}"


# --- Ground ---------------------------------------------------------------------------------------


def _rings_paths(polygons: Sequence[Polygon]) -> list[str]:
    """Return each polygon as the ``d`` of a path; outer rings run one way and holes the other."""
    oriented = shapely.orient_polygons(np.array(polygons, dtype=np.object_))
    rings, owner = shapely.get_rings(oriented, return_index=True)
    corners_mm, ring = shapely.get_coordinates(rings, return_index=True)
    # Steps between rounded places add up to rounded places: no error gathers, half the text.
    places = np.rint(corners_mm * (100.0, -100.0))
    steps = (np.diff(places, axis=0) / 100.0).tolist()
    texts = [f"{dx:.10g} {dy:.10g}" for dx, dy in steps]
    first = np.searchsorted(ring, np.arange(len(rings) + 1)).tolist()
    begins = (places / 100.0 + 0.0)[first[:-1]].tolist()  # no -0
    paths = [""] * len(polygons)
    for index, (x, y), begin, end in zip(owner.tolist(), begins, first, first[1:], strict=False):
        paths[index] += f"M{x:.10g} {y:.10g}l{' '.join(texts[begin : end - 2])}Z"
    return paths


# --- Robot ----------------------------------------------------------------------------------------


def _placed(points_mm: Floats) -> list[str]:
    """Return points as ``x y``, to a thousandth of a millimetre."""
    placed = np.round(points_mm * (1.0, -1.0), 3) + 0.0  # no -0
    return [f"{x:.10g} {y:.10g}" for x, y in placed.tolist()]


def _chain_path(points: list[str]) -> str:
    if len(points) < 2:
        return f"M{points[0]}h0" if points else ""
    return f"M{points[0]}L{' '.join(points[1:])}"


def _contacts(deployment: Deployment, points: list[str]) -> str:
    """Return a diamond at every contact, with the front length at which a tip came there."""
    first, base_mm = deployment.first_point.tolist(), deployment.base_mm.tolist()
    marks = []
    for branch, base in enumerate(base_mm):
        if first[branch + 1] - first[branch] < 3:
            continue
        strides = np.hypot(*np.diff(deployment.chain_mm(branch), axis=0).T)
        fronts_mm = (base + np.cumsum(strides[:-1])).tolist()
        inner = points[first[branch] + 1 : first[branch + 1] - 1]
        marks += [
            f'<g data-front="{_text(front)}" transform="translate({place})">{CONTACT}</g>'
            for front, place in zip(fronts_mm, inner, strict=True)
        ]
    return f'<g class="contacts">{"".join(marks)}</g>'


def _tips(deployment: Deployment, points: list[str], at_rest: NDArray[np.bool_]) -> str:
    """Return the mark of every tip at rest, with a sentence on its branch."""
    last, stops = deployment.first_point[1:].tolist(), deployment.stop.tolist()
    fronts_mm = (deployment.base_mm + deployment.grown_mm).tolist()
    grown_mm, planned_mm = deployment.grown_mm.tolist(), deployment.tree.length_mm.tolist()
    marks, names = [], deployment.tree.ids
    for branch in np.flatnonzero(at_rest).tolist():
        stop, name = Stop(stops[branch]), names[branch]
        place, front = points[last[branch] - 1], _text(fronts_mm[branch])
        length = f"{grown_mm[branch]:.1f} of {planned_mm[branch]:.1f} mm (simulated)"
        marks.append(
            f'<g class="mark {stop_class(stop)}" data-branch="{name}" '
            f'data-front="{front}" transform="translate({place})">'
            f"{STOP_SIGNS[stop]}<title>{name}: {STOP_WORDS[stop]}, {length}</title></g>"
        )
    return "".join(marks)


def stop_class(stop: Stop) -> str:
    """Return the class of a mark by which a style knows why the branch stopped."""
    return f"stop-{stop.label.replace('_', '-')}"


# --- Lines and arcs -------------------------------------------------------------------------------


_LONG_BULGE = math.tan(0.5)
"""Of an arc of 2 rad. The centre of a longer one would hang on the last digit of its ends."""


def _arc(start: tuple[float, float], end: tuple[float, float], bulge: float) -> str:
    (x0, y0), (x1, y1) = start, end
    chord_mm = math.hypot(x1 - x0, y1 - y0)
    straight_mm = 1e-4  # an arc that bulges less than this is written as a line
    if abs(bulge) * chord_mm < 2.0 * straight_mm:
        return f"L{_pair(x1, y1)}"
    if abs(bulge) > _LONG_BULGE:
        half = math.tan(math.atan(bulge) / 2.0)
        middle = (x0 + x1 + bulge * (y1 - y0)) / 2.0, (y0 + y1 - bulge * (x1 - x0)) / 2.0
        return _arc(start, middle, half) + _arc(middle, end, half)
    radius = f"{chord_mm * (1.0 + bulge**2) / (4.0 * abs(bulge)):.9g}"
    return f"A{radius} {radius} 0 0 {0 if bulge > 0.0 else 1} {_pair(x1, y1)}"


def _pair(x_mm: float, y_mm: float) -> str:
    return f"{_text(x_mm)} {_text(-y_mm)}"


def _across(width_mm: float) -> str:
    """Return how wide a body of some lay-flat width is drawn."""
    return _text(inflated_diameter_mm(width_mm))


def _text(value: float) -> str:
    """Return a number to a thousandth, without zeros at its end."""
    return f"{round(value, 3) + 0.0:.10g}"
